"""The node benchmark, over real processes; what it measures is not for a test to judge."""

import json
import math
import signal
import sys

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message

from ca_ros.nodes.latency import LatencyError, flown, summary


def start(graph, *arguments):
    """Start the benchmark as `benchmark` does."""
    return graph.start_silent(
        sys.executable, '-m', 'ca_ros.nodes.latency', '--quick', *arguments)


@pytest.mark.slow
def test_the_figures_are_complete_and_consistent(graph, tmp_path):
    out = tmp_path / 'latency.json'
    _, err = graph.outlive(
        start(graph, '--rates', '50', '--out', str(out)), patience=100.0)
    assert out.is_file(), err
    figures = json.loads(out.read_text())
    assert list(figures['rates']) == ['50']
    rate = figures['rates']['50']
    for kind in ('allocator', 'echo'):
        side = rate[kind]
        assert 0.0 < side['p50'] <= side['p99'] <= side['p99.9']
        assert 0 < side['answered'] <= side['sent']
        assert side['sent'] - side['answered'] <= side['late'] <= side['sent']
        assert figures['sustained'][kind] >= 200.0
    # Of three pairs of blocks: the same order of size as the ratio of all.
    assert 0.1 < rate['ratio_p50'] / (rate['allocator']['p50'] / rate['echo']['p50']) < 10.0
    assert figures['sustained']['ratio'] > 0.0


def test_a_wrong_vehicle_ends_it_in_one_line_and_leaves_nothing_behind(graph, tmp_path):
    process = start(graph, '--vehicle', 'nope', '--out', str(tmp_path / 'x'))
    _, err = graph.outlive(process)
    assert process.returncode == 1
    assert err.splitlines()[-1].startswith('latency: ')
    assert 'nope' in err.splitlines()[-1]
    assert graph.alive() == []


def test_an_interrupt_ends_it_and_its_nodes(graph, tmp_path):
    process = start(graph, '--out', str(tmp_path / 'x'))
    graph.spin_until(lambda: len(graph.alive()) >= 3, 'the nodes')
    _, err = graph.end(process, signal.SIGINT)
    assert process.returncode == 128 + signal.SIGINT
    assert 'interrupted' in err.splitlines()[-1]
    assert graph.alive() == []


def test_a_summary_by_hand():
    latencies = np.array([1e-3, 2e-3, 3e-3, math.nan])
    figures = summary(latencies, 2.5e-3)
    assert (figures['p50'], figures['sent'], figures['answered']) == (2e-3, 4, 3)
    # The third is late and the fourth was never answered.
    assert figures['late'] == 2
    with pytest.raises(LatencyError):
        summary(np.full(3, math.nan), 1.0)


def test_the_commands_are_those_of_a_flight():
    commands = [deserialize_message(command, WrenchStamped) for command in flown('hexarotor')]
    assert len(commands) == 501
    assert all(0.2 < command.wrench.force.z < 24.0 for command in commands)
    assert commands[-1].wrench.force.z == pytest.approx(9.81, rel=0.2)
