"""The measurement of the nodes, over real processes; its values are not judged here."""

import json
import math
import signal
import sys

import numpy as np
import pandas as pd
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message

from ca_ros.evaluation.latency.client import LatencyError, flown
from ca_ros.evaluation.latency.latency import measure, metrics

MEASURE = """
import json, signal, sys
from ca_ros.evaluation.latency import latency
latency.RATES = (50.0,)
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    json.dump(latency.measure_nodes('hexarotor', True), open(sys.argv[1], 'w'))
except (latency.LatencyError, KeyboardInterrupt) as error:
    sys.exit(repr(error))
"""


def start(graph, out):
    return graph.start(sys.executable, '-c', MEASURE, str(out))


@pytest.mark.slow
def test_the_metrics_are_complete_and_consistent(graph, tmp_path):
    out = tmp_path / 'latency.json'
    _, err = graph.outlive(start(graph, out))
    assert out.is_file(), err
    found = json.loads(out.read_text())
    assert list(found['rates']) == ['50']
    rate = found['rates']['50']
    for kind in ('allocator', 'echo'):
        own = rate[kind]
        assert 0.0 < own['p50'] <= own['p99'] <= own['p99.9']
        assert 0 < own['answered'] <= own['sent']
        assert own['sent'] - own['answered'] <= own['late'] <= own['sent']
        assert found['sustained'][kind] >= 1.0
    assert rate['ratio']['p50'] > 0.0
    # One round, so the ratio is that of the rates.
    rates = found['sustained']
    assert rates['ratio'] == pytest.approx(rates['allocator'] / rates['echo'])


def test_a_node_that_dies_is_named_and_an_interrupt_ends_both(graph, tmp_path):
    process = start(graph, tmp_path / 'x')

    def nodes():
        return [
            child for child in graph.alive()
            if any(word.endswith('.echo') for word in child.cmdline())]

    graph.spin_until(nodes, 'the node')
    nodes()[0].kill()
    _, err = graph.outlive(process)
    assert 'the echo ended with exit code -9' in err
    assert graph.alive() == []

    process = start(graph, tmp_path / 'x')
    graph.spin_until(lambda: len(graph.alive()) >= 3, 'the nodes')
    _, err = graph.end(process, signal.SIGINT)
    assert 'KeyboardInterrupt' in err
    assert graph.alive() == []
    assert not (tmp_path / 'x').exists()


def block(latencies, delays=0.0):
    return pd.DataFrame({'sent': 0.0, 'delay': delays, 'latency': latencies})


def test_metrics_by_hand():
    latencies = np.array([1e-3, 2e-3, 3e-3, 2e-3, math.nan])
    found = metrics(block(latencies, [0.0, 0.0, 0.0, 1e-3, 0.0]), 2.5e-3)
    assert (found['p50'], found['sent'], found['answered']) == (2e-3, 5, 4)
    # The third is late, the fourth because it was sent late, and the fifth was never answered.
    assert found['late'] == 3
    with pytest.raises(LatencyError):
        metrics(block(np.full(3, math.nan)), 1.0)


class Recorded:
    """A client with given blocks: all latencies of a block are the same [ms]."""

    def __init__(self, latencies):
        self.latencies = iter(latencies)

    def ask(self, rate, count):
        return block(np.full(count, 1e-3 * next(self.latencies)))


def test_a_ratio_is_that_of_neighbours_in_time():
    # A machine that slows down threefold, and stalls once, does not show in the ratios 2, 9 and 2.
    clients = {'allocator': Recorded([2.0, 9.0, 6.0]), 'echo': Recorded([1.0, 1.0, 3.0])}
    found = measure(clients, [100.0], 3, 0.1)['100']
    assert found['ratio'] == {'p50': pytest.approx(2.0), 'p99': pytest.approx(2.0)}
    assert found['allocator']['p50'] == pytest.approx(6e-3)
    assert found['echo']['p50'] == pytest.approx(1e-3)


def test_the_commands_are_those_of_a_flight():
    commands = [deserialize_message(command, WrenchStamped) for command in flown('hexarotor')]
    assert len(commands) == 1000
    assert all(0.2 < command.wrench.force.z < 24.0 for command in commands)
    assert len({command.wrench.torque.z for command in commands}) > 100
    assert commands[-1].wrench.force.z == pytest.approx(9.81, rel=0.2)
