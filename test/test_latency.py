"""The node benchmark, over real processes; what it measures is not for a test to judge."""

import json
import math
import signal
import sys

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message

from ca_ros.evaluation.latency.__main__ import flown
from ca_ros.evaluation.latency.figures import measure, summary
from ca_ros.evaluation.latency.side import Block, LatencyError


def start(graph, *arguments):
    """Start the benchmark as `benchmark` does."""
    return graph.start_silent(
        sys.executable, '-m', 'ca_ros.evaluation.latency', '--quick', *arguments)


@pytest.mark.slow
def test_the_figures_are_complete_and_consistent(graph, tmp_path):
    out = tmp_path / 'latency.json'
    _, err = graph.outlive(start(graph, '--rates', '50', '--out', str(out)))
    assert out.is_file(), err
    figures = json.loads(out.read_text())
    assert list(figures['rates']) == ['50']
    rate = figures['rates']['50']
    for kind in ('allocator', 'echo'):
        side = rate[kind]
        assert 0.0 < side['p50'] <= side['p99'] <= side['p99.9']
        assert 0 < side['answered'] <= side['sent']
        assert side['sent'] - side['answered'] <= side['late'] <= side['sent']
        assert figures['sustained'][kind] >= 1.0
        # It would have failed if one of these had not been answered.
        assert figures['in_turn'][kind] > 0.0
    assert rate['ratio_p50'] > 0.0
    for name in ('sustained', 'in_turn'):
        part = figures[name]
        # One round, so the ratio is that of the rates.
        assert part['ratio'] == pytest.approx(part['allocator'] / part['echo'])


def test_a_wrong_vehicle_ends_it_in_one_line_and_leaves_nothing_behind(graph, tmp_path):
    process = start(graph, '--vehicle', 'nope', '--out', str(tmp_path / 'x'))
    _, err = graph.outlive(process)
    assert process.returncode == 1
    assert err.splitlines()[-1].startswith('latency: ')
    assert 'nope' in err.splitlines()[-1]
    assert graph.alive() == []


@pytest.mark.parametrize('options', [
    ('--rates', '0'), ('--rates', 'nan'), ('--rates', '250,fast'), ('--rates', '1e9'),
    ('--out', 'no/such/folder/x')])
def test_a_wrong_option_is_refused_before_anything_is_measured(graph, tmp_path, options):
    process = start(graph, '--out', str(tmp_path / 'x'), *options)
    _, err = graph.outlive(process)
    assert process.returncode != 0
    assert 'Traceback' not in err
    last = err.splitlines()[-1]
    assert last.startswith('latency: ')
    assert options[0] in last
    assert not (tmp_path / 'x').exists()


@pytest.mark.parametrize('kind', ['allocator', 'echo'])
def test_a_node_that_dies_is_named_and_nothing_is_left_behind(graph, tmp_path, kind):
    process = start(graph, '--out', str(tmp_path / 'x'))

    def nodes():
        return [
            child for child in graph.alive()
            if any(word.endswith(f'.{kind}') for word in child.cmdline())]

    graph.spin_until(nodes, 'the node')
    nodes()[0].kill()
    _, err = graph.outlive(process)
    assert process.returncode == 1
    assert err.splitlines()[-1] == f'latency: the {kind} ended with exit code -9'
    assert not (tmp_path / 'x').exists()
    assert graph.alive() == []


def test_an_interrupt_ends_it_and_its_nodes(graph, tmp_path):
    process = start(graph, '--out', str(tmp_path / 'x'))
    graph.spin_until(lambda: len(graph.alive()) >= 3, 'the nodes')
    _, err = graph.end(process, signal.SIGINT)
    assert process.returncode == 128 + signal.SIGINT
    assert 'interrupted' in err.splitlines()[-1]
    assert graph.alive() == []


def test_a_summary_by_hand():
    latencies = np.array([1e-3, 2e-3, 3e-3, 2e-3, math.nan])
    delays = np.array([0.0, 0.0, 0.0, 1e-3, 0.0])
    figures = summary(latencies, delays, 2.5e-3)
    assert (figures['p50'], figures['sent'], figures['answered']) == (2e-3, 5, 4)
    # The third is late, the fourth for having gone out late, and the fifth was never answered.
    assert figures['late'] == 3
    with pytest.raises(LatencyError):
        summary(np.full(3, math.nan), np.zeros(3), 1.0)


class Written:
    """A side whose blocks are written down: all latencies of a block are the same [ms]."""

    def __init__(self, kind, latencies):
        self.kind, self.latencies = kind, iter(latencies)

    def ask(self, rate, count):
        return Block(np.full(count, 1e-3 * next(self.latencies)), np.zeros(count), rate)


def test_a_ratio_is_that_of_neighbours_in_time():
    # A machine that slows down threefold, and stalls once, does not show in the ratios 2, 9 and 2.
    sides = [Written('allocator', [2.0, 9.0, 6.0]), Written('echo', [1.0, 1.0, 3.0])]
    figures = measure(sides, [100.0], 3, 0.1, lambda: None)['100']
    assert figures['ratio_p50'] == figures['ratio_p99'] == pytest.approx(2.0)
    assert figures['allocator']['p50'] == pytest.approx(6e-3)
    assert figures['echo']['p50'] == pytest.approx(1e-3)


def test_the_commands_are_those_of_a_flight():
    commands = [deserialize_message(command, WrenchStamped) for command in flown('hexarotor')]
    assert len(commands) == 1000
    assert all(0.2 < command.wrench.force.z < 24.0 for command in commands)
    assert len({command.wrench.torque.z for command in commands}) > 100
    assert commands[-1].wrench.force.z == pytest.approx(9.81, rel=0.2)
