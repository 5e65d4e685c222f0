"""`ca_ros.testing` itself; the tests of the nodes and docs/testing.md use the rest of it."""

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rclpy

from ca_ros import Vehicle, control_allocation_matrix, make_allocator
from ca_ros.process.parameters import _parameters
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.testing import Graph, Lockstep, executable, processes
from ca_ros.testing.domain import used
from ca_ros.vehicle.state import ANGULAR_VELOCITY, NULL_STATE, POSITION

PYTHON = sys.executable

DEAF = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
print('deaf')
time.sleep(1000.0)
"""

EXIT_3 = """
import signal, sys, time
from pathlib import Path
signal.signal(signal.SIGINT, lambda *_: sys.exit(3))
print('ready')
time.sleep(1000.0)
"""


def ready(graph, process):
    """Wait until a process has printed something."""
    graph.spin_until(lambda: graph.output(process)[0], 'output')
    return process


# The plugin

@pytest.mark.slow
def test_the_fixture_names_what_is_not_installed(tmp_path):
    (tmp_path / 'test_it.py').write_text('def test_it(graph): pass')
    script = 'import sys, pytest; sys.modules["rclpy"] = None; pytest.main(["-q"])'
    run = subprocess.run(
        [PYTHON, '-c', script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert 'the fixture graph needs rclpy' in run.stdout


FAILING = """
import sys
def test_it(graph):
    process = graph.start(sys.executable, '-uc', '''EXIT_3''')
    graph.spin_until(lambda: graph.output(process)[0], 'output')
    raise ZeroDivisionError
"""


def test_the_report_of_a_failed_test_has_the_output_of_its_processes(graph, tmp_path):
    file = tmp_path / 'test_it.py'
    file.write_text(FAILING.replace('EXIT_3', EXIT_3))
    out, _ = graph.outlive(graph.start(PYTHON, '-m', 'pytest', '-q', str(file)))
    assert re.search(r'Captured python -uc \d+, running call -+\nready\n', out), out
    # The exit code of the process does not matter any more.
    assert '1 failed' in out
    assert ' error' not in out


# The environment

def test_the_environment_is_that_of_the_graph_and_then_as_before(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '102')
    monkeypatch.delenv('FASTDDS_BUILTIN_TRANSPORTS', raising=False)
    with Graph(OTHER='1') as graph:
        assert os.environ['ROS_DOMAIN_ID'] == str(graph.domain) != '102'
        assert os.environ['FASTDDS_BUILTIN_TRANSPORTS'] == 'UDPv4'
        assert os.environ['OTHER'] == '1'
    assert os.environ['ROS_DOMAIN_ID'] == '102'
    assert not {'FASTDDS_BUILTIN_TRANSPORTS', 'OTHER'} & {*os.environ}


def test_graphs_have_domains_of_their_own_unless_one_joins_another():
    with Graph() as one, Graph() as two, Graph(ROS_DOMAIN_ID=str(one.domain)) as joined:
        assert one.domain != two.domain
        assert joined.domain == one.domain


def test_a_domain_in_use_is_not_claimed(graph):
    assert graph.node.get_name() == 'test'
    assert graph.domain in used()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(('127.0.0.1', 7400 + 250 * 7 + 249))
        assert 7 in used()


# Processes

def test_an_executable_of_any_ros_package_is_found_by_its_name(tmp_path, monkeypatch):
    file = tmp_path / 'lib' / 'some_package' / 'some_node'
    file.parent.mkdir(parents=True)
    file.touch(0o755)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path), prepend=os.pathsep)
    assert executable('some_node') == [str(file)]
    assert Path(executable('allocator')[-1]).name == 'allocator'
    assert Path(executable('sh')[0]).is_file()
    with pytest.raises(FileNotFoundError, match="no executable 'no_node'"):
        executable('no_node')


def test_the_exit_code_after_the_test_is_checked():
    with Graph() as graph:
        ready(graph, graph.start(PYTHON, '-uc', EXIT_3, exit_codes=(0, 3)))
    said = r'exit code 3 after SIGINT: expected 0\n(.*\n)*ready'
    with pytest.raises(AssertionError, match=said), Graph() as graph:
        ready(graph, graph.start(PYTHON, '-uc', EXIT_3))


def test_a_process_that_survives_the_test_is_killed_and_named(monkeypatch):
    monkeypatch.setattr(processes, 'DEADLINE', 0.3)
    with pytest.raises(AssertionError, match='survived its end by SIGINT'), Graph() as graph:
        process = ready(graph, graph.start(PYTHON, '-uc', DEAF))
    assert process.returncode == -signal.SIGKILL


def test_a_process_that_fails_before_the_end_of_the_test_fails_the_test():
    said = r'ended by itself, exit code 7\n(.*\n)*out of fuel'
    crash = 'print("out of fuel"); raise SystemExit(7)'
    with pytest.raises(AssertionError, match=said), Graph() as graph:
        graph.start(PYTHON, '-c', crash).wait()
    with Graph() as graph:
        graph.start(PYTHON, '-c', crash, exit_codes=(0, 7)).wait()


def test_the_end_of_a_process_ends_a_wait_with_its_last_words(graph):
    process = graph.start(PYTHON, '-c', 'raise SystemExit("out of fuel")')
    with pytest.raises(AssertionError, match=r'landed: .*, exit code 1: out of fuel'):
        graph.spin_until(lambda: False, 'landed')
    assert graph.outlive(process) == ('', 'out of fuel\n')


KILLED = """
import os, signal, sys
from ca_ros.testing import Graph

graph = Graph().__enter__()
print(graph.start(sys.executable, '-c', 'import time; time.sleep(1000.0)').pid)
sys.stdout.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_processes_of_a_killed_test_end(graph):
    out, _ = graph.outlive(graph.start(PYTHON, '-c', KILLED))
    graph.spin_until(lambda: not os.path.exists(f'/proc/{out.strip()}'), 'the end of the process')


# Nodes

def test_a_node_on_another_context_is_refused(graph):
    with Graph() as other:
        stranger = rclpy.create_node('stranger', context=other.context)
        with pytest.raises(ValueError, match=r'stranger: create the node with context=graph\.'):
            graph.add_node(stranger)
        stranger.destroy_node()


def test_steps_in_lockstep_equal_those_without_ros_to_the_last_bit(graph):
    vehicle = Vehicle.load('quadrotor')
    rng = np.random.default_rng(0)
    thrusts = rng.uniform(vehicle.thrust_min, vehicle.thrust_max, (20, vehicle.n))
    wrenches = thrusts @ control_allocation_matrix(vehicle).T
    lockstep = Lockstep(graph, 'quadrotor')
    allocator, body, state = make_allocator('exact', vehicle), RigidBody(vehicle), NULL_STATE
    for u in wrenches:
        position, _, _, rates = lockstep.step([0.0, 0.0, *u])
        state = body.step(state, allocator.allocate(u).speeds, 0.01)
        assert position.tobytes() == state[POSITION].tobytes()
        assert rates.tobytes() == state[ANGULAR_VELOCITY].tobytes()
    flight = lockstep.run(until=0.19)
    assert flight.speeds[-1].tobytes() == allocator.allocate(wrenches[-1]).speeds.tobytes()
    np.testing.assert_array_equal(flight.time, np.arange(20) * 10_000_000 / 1e9)
    head, first, *others = dict(graph.report())['lockstep'].splitlines()
    assert 'rates [rad/s]' in head
    np.testing.assert_allclose(
        [*map(float, first.split())], [*np.zeros(7), *wrenches[0]], rtol=5e-3)
    assert len(others) == 10


def test_numbers_of_a_parameter_may_be_mixed():
    [parameter] = _parameters({'rotors.health': [0.0, 1, 1]})
    assert parameter.value == [0.0, 1.0, 1.0]
    assert [type(each) for each in parameter.value] == [float] * 3
