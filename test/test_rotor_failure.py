"""Rotors that fail in flight: offline and over DDS, announced or not."""

import math
import re
from functools import cache

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from ca_ros import ALLOCATORS, ParameterError, Status, Vehicle, make_allocator
from ca_ros.bringup.bringup import main as bringup
from ca_ros.bringup.flight_options import failure_words
from ca_ros.bringup.options import Plan
from ca_ros.control.controller import Controller
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.problem.audit import audit
from ca_ros.simulation.closed_loop import Change, fly, waypoint_changes
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from ca_ros.studies.dynamic.study import main as dynamic_study
from ca_ros.testing import Diagnostics, wrench
from ca_ros.vehicle.files import find
from nodes import ended, host
from strategies import length, settings_of

HOVER = Waypoint.of(0.0, 0.0, 0.0, 0.0)
NEXT = Waypoint.of(1.2, 1.2, 1.06, 0.0)
"""2.0 m from there."""

ALL = {'hexarotor': 6, 'hexarotor_ppnnpn': 4, 'octorotor': 8, 'x8': 8, 'y6': 6}
FLOWN = length(
    [('hexarotor', 1), ('hexarotor_ppnnpn', 2), ('x8', 5), ('y6', 4)],
    [(vehicle, rotor) for vehicle, rotors in ALL.items() for rotor in range(1, rotors + 1)])
SPUN = [('hexarotor_ppnnpn', 5), ('hexarotor_ppnnpn', 6)]
LOST = 1
"""When the rotor is lost in the flights below [s]."""


@cache
def case_of(vehicle, drag=0.0):
    return Case.load(vehicle, [f'simulator.rotational_drag:={drag}'])


def without(vehicle, rotor):
    health = np.ones(vehicle.n)
    health[rotor - 1] = 0.0
    return vehicle.with_health(health)


def lose(case, rotor, announce=0.1, method='exact', end=75.0):
    """Lose a rotor at hover, then fly to the next waypoint and stay there."""
    failures = RotorFailures((RotorFailure(rotor, LOST),), announce)
    changes = [*case.announced(method, failures), Change(3 * 10**9, waypoint=NEXT)]
    return fly(
        case.controller(), case.allocator(method), case.body(), HOVER, end, changes=changes,
        failures=failures)


def away(flight, start=15.0):
    """Return the greatest distance from the next waypoint after a time [m]."""
    late = flight.position[flight.time >= start]
    return np.linalg.norm(late - NEXT.position, axis=1).max()


# Offline


@pytest.mark.slow
@pytest.mark.parametrize(('vehicle', 'rotor'), FLOWN)
def test_a_vehicle_without_a_rotor_flies_on(vehicle, rotor):
    case = case_of(vehicle)
    assert set(audit(without(case.vehicle, rotor)).lost) <= {'yaw'}
    # The first rotor of each vehicle for a minute more.
    flight = lose(case, rotor, end=length(17.0, 75.0 if rotor == 1 else 20.0))
    assert away(flight) < 0.05
    assert np.degrees(flight.tilt.max()) < 20.0
    # It is commanded until it is known to be lost, and then it rests.
    told = flight.time >= LOST + 0.1 - 1e-9
    assert np.all(flight.speeds[told, rotor - 1] == 0.0)
    assert np.all(flight.speeds[~told, rotor - 1] > 0.0)
    others = np.delete(flight.speeds, rotor - 1, axis=1)
    assert np.all((others >= 40.0) & (others <= 400.0))


@pytest.mark.long
@pytest.mark.parametrize(('vehicle', 'rotor'), SPUN)
def test_a_spin_is_named_by_the_audit_and_bounded_by_drag_alone(vehicle, rotor):
    report = audit(without(case_of(vehicle).vehicle, rotor))
    assert report.lost == ('yaw',)
    assert abs(report.spin_torque) == pytest.approx(0.036, abs=0.001)
    assert 'it spins' in str(report)
    drag = 5e-4
    flight = lose(case_of(vehicle, drag), rotor)
    assert away(flight) < 0.05
    # Drag balances the torque: c r^2 = tau.
    spin = math.copysign(math.sqrt(abs(report.spin_torque) / drag), report.spin_torque)
    assert flight.angular_velocity[-1, 2] == pytest.approx(spin, rel=1e-3)
    with pytest.raises(FloatingPointError):
        lose(case_of(vehicle), rotor)


@pytest.mark.parametrize('rotor', range(1, 5))
def test_a_quadrotor_without_a_rotor_cannot_fly_and_the_audit_says_so(rotor):
    assert {'roll', 'pitch'} <= set(audit(without(Vehicle.load('quadrotor'), rotor)).lost)


@pytest.mark.parametrize('vehicle', length(['hexarotor', 'x8'], ALL))
def test_an_unannounced_loss_is_fatal(vehicle):
    try:
        flight = lose(case_of(vehicle), 1, announce=None, end=16.0)
    except FloatingPointError:
        return
    assert away(flight) > 5.0


@pytest.mark.slow
@pytest.mark.parametrize(
    'method', length(['direct'], ['pseudo_inverse', 'conventional', 'direct']))
def test_the_other_methods_fly_on_too(method):
    flight = lose(case_of('hexarotor'), 1, method=method, end=17.0)
    assert away(flight) < 0.05


# No rotor is left

@pytest.mark.parametrize('health', [[0.0] * 6, [0.0, 1e-300, 5e-324, 1e-10, 0.0, 1e-12]])
@pytest.mark.parametrize('method', ALLOCATORS)
def test_without_any_rotor_every_method_leaves_them_at_rest(method, health):
    vehicle = audit(Vehicle.load('hexarotor').with_health(health)).vehicle
    allocator = make_allocator(method, vehicle)
    m = len(vehicle.axes)
    for u in (np.zeros(m), np.eye(m)[0] * 9.81, np.full(m, 1e6)):
        answer = allocator.allocate(u)
        assert answer.status is Status.INEXACT
        np.testing.assert_array_equal(answer.speeds, np.zeros(6))
    batch = allocator.allocate_batch(np.zeros((3, m)))
    assert set(batch.status.tolist()) == {Status.INEXACT}
    np.testing.assert_array_equal(batch.speeds, np.zeros((3, 6)))
    wrench = Controller.from_settings(vehicle, settings_of({})).wrench(
        np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), np.zeros(3), NEXT)
    np.testing.assert_array_equal(wrench, np.zeros(m))


# The command line

@pytest.mark.parametrize(('text', 'expected'), [
    ('1@2', (1, 2.0, 0.0)), ('3@2.5=0.4', (3, 2.5, 0.4)), ('12@0=1', (12, 0.0, 1.0)),
    ('1@1e-3', (1, 1e-3, 0.0))])
def test_a_failure_is_read(text, expected):
    failure = RotorFailure.parse(text)
    assert (failure.rotor, failure.time, failure.health) == expected
    assert RotorFailure.parse(str(failure)) == failure


@pytest.mark.parametrize('text', [
    '', '1', '@2', '1@', '0@2', '-1@2', '1.5@2', 'a@2', '1@-1', '1@nan', '1@inf', '1@2=', '1@2=2',
    '1@2=-0.1', '1@2=nan', '1@2=0.4=0.3', '1 @2@3'])
def test_what_is_no_failure_is_refused(text):
    with pytest.raises(ValueError, match=r'expected|numbered'):
        RotorFailure.parse(text)


def test_a_rotor_cannot_fail_twice_at_the_same_time_nor_after_the_flight(capsys, tmp_path):
    failures = RotorFailure(1, 1.0), RotorFailure(2, 1.0), RotorFailure(1, 1.5)
    assert [time / 1e9 for time in RotorFailures(failures).times] == [1.0, 1.5]
    words = '--fail 1@1=0.5: rotor 1 fails twice at 1 s'
    with pytest.raises(ParameterError, match=r'^1@1=0\.5: rotor 1 fails twice at 1 s'):
        RotorFailures((*failures, RotorFailure(1, 1.0, 0.5)))
    for command in (bringup, dynamic_study):
        assert command(['--fail', '1@1', '--fail', '1@1=0.5', '--out', str(tmp_path)]) == 1
        assert capsys.readouterr().err.endswith(f': {words}\n')
        assert command(['--fail', '1@2', '--duration', '2', '--out', str(tmp_path)]) == 1
        assert capsys.readouterr().err.endswith(': --fail 1@2: --duration is 2 s\n')


def test_failures_and_announcements_have_their_times():
    failures = RotorFailures(
        (RotorFailure(2, 1.0, 0.5), RotorFailure(2, 1.05), RotorFailure(1, 3.0)))
    sound = Vehicle.load('quadrotor')
    assert failures.times == [1_000_000_000, 1_050_000_000, 3_000_000_000]
    assert failures.announced_times == [1_100_000_000, 1_150_000_000, 3_100_000_000]
    assert failures.after(sound, 999_999_999) is sound
    for time, health in ((1_000_000_000, [1, 0.5, 1, 1]), (1_100_000_000, [1, 0, 1, 1])):
        assert failures.after(sound, time).health.tolist() == health
    for time, health in ((1_100_000_000, [1, 0.5, 1, 1]), (4_000_000_000, [0, 0, 1, 1])):
        assert failures.known(sound, time).health.tolist() == health
        assert failures.announced(4, time)[0].tolist() == health
    # What is announced makes no rotor sounder than it was.
    weak = sound.with_health([1.0, 0.4, 0.3, 1.0])
    assert failures.known(weak, 1_100_000_000).health.tolist() == [1.0, 0.4, 0.3, 1.0]
    never = RotorFailures(failures.failures, None)
    assert (never.times, never.announced_times) == (failures.times, [])
    assert never.known(sound, 4_000_000_000).health.tolist() == [1.0] * 4
    for each in (failures, never, RotorFailures()):
        assert RotorFailures.read(each.words, each.announce) == each


@pytest.mark.slow
def test_a_rotor_that_is_not_there_cannot_fail(tmp_path, capsys):
    for command in (bringup, dynamic_study):
        assert command(['--fail', '7@1', '--out', str(tmp_path)]) == 1
        assert '--fail 7@1: the vehicle has 6 rotors' in capsys.readouterr().err


# Over DDS

@pytest.mark.long
@pytest.mark.parametrize('announce', [0.1, None])
def test_failures_and_waypoints_over_dds_equal_those_offline_to_the_last_bit(
        graph, tmp_path, announce):
    path = tmp_path / 'square.csv'
    path.write_text('t,x,y,z,heading\n0,1,0,1,0\n0.5,1,1,1,1.5\n1,0,1,1.5,-1.5\n')
    failures = RotorFailures((RotorFailure(1, 0.3), RotorFailure(2, 0.805, 0.5)), announce)
    process = graph.start(
        'bringup', '--figures', 'none',
        '--mode', 'lockstep', '--duration', '1.5', '--trajectory', str(path),
        '--out', str(tmp_path), *failure_words(failures))
    out, _ = ended(graph, process, 1)
    words = 'MISSED', 'heading is given up', 'rotor 1 lost, rotor 2 at 50 %', 'within bounds'
    assert [word for word in words if word not in out] == []
    case, trajectory = case_of('hexarotor'), Trajectory.read(path)
    fly(
        case.controller(), case.allocator('exact'), case.body(), trajectory.first, 1.5,
        changes=[*case.announced('exact', failures), *waypoint_changes(trajectory)],
        failures=failures,
    ).write_csv(tmp_path / 'offline.csv')
    assert (tmp_path / 'flight.csv').read_bytes() == (tmp_path / 'offline.csv').read_bytes()


@pytest.mark.long
def test_a_vehicle_that_starts_without_a_rotor_is_judged_by_what_it_has(graph, tmp_path):
    process = graph.start(
        'bringup', '--figures', 'none',
        '--mode', 'lockstep', '--duration', '1', '--out', str(tmp_path),
        '--waypoint', '0', '0', '0', '--heading', '0', '--ros-args',
        '-p', 'rotors.health:=[0.0, 1.0, 1.0, 1.0, 1.0, 1.0]',
        '-p', 'allocation.lost_axes:=drop')
    out, _ = ended(graph, process, 0)
    for words in ('reached: 0.', 'the heading is given up', 'within bounds'):
        assert words in out


def test_a_node_without_any_rotor_leaves_them_at_rest_with_every_method(graph):
    host(graph, 'allocator', '-p', 'mode:=lockstep')
    wrenches = graph.publisher(WrenchStamped, 'command/wrench')
    speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
    said = Diagnostics(graph)
    node = graph.connect('allocator')
    command = wrench(9.81)
    for method, option in (('exact', 'weights'), ('conventional', 'weight')):
        wrong = {'allocation.method': method, f'allocation.{method}.{option}': [1.0, 2.0]}
        for health in (1.0, 0.0):
            result = node.set_atomically({**wrong, 'rotors.health': health})
            assert not result.successful
            assert f'{option}: expected 1' in result.reason
    for method in ALLOCATORS:
        for health in (1.0, 0.0) if method != 'exact' else (1.0, 1e-300, 1.0, 0.0):
            for result in node.set({'allocation.method': method, 'rotors.health': health}):
                assert result.successful, result.reason
            command.header.stamp.sec += 1
            expected = f'stamp {command.header.stamp.sec}000000000'
            wrenches.publish(command)

            def answered():
                return speeds and speeds[-1].layout.dim[1].label == expected  # noqa: B023

            graph.spin_until(answered, f'an answer of {method}')
            assert bool(np.any(speeds[-1].data)) == (health == 1.0)
            if health < 1.0:
                # The status before the answer may have that of the answer before.
                said.wait(
                    '/allocator', lambda level, text, _: level == b'\2' and 'cannot hover' in text
                    and not re.search(r'\bEXACT\b', text), 'an error, and no exact answer')
            else:
                said.wait('/allocator', lambda level, _, __: level < b'\2', 'no error')


def test_a_rotor_that_the_vehicle_has_not_is_refused_before_the_nodes_start():
    failures = RotorFailures((RotorFailure.parse('9@1'),))
    plan = Plan(Trajectory.to(Waypoint.of(1.0, 1.0, 1.0, 0.0)), failures, vehicle='hexarotor')
    with pytest.raises(ParameterError, match='--fail 9@1: the vehicle has 6 rotors'):
        plan.commands()


def test_the_vehicle_whose_rotors_fail_is_that_of_the_namespace(tmp_path):
    names = 'hexarotor', 'quadrotor'
    shipped = [yaml.safe_load(find(name).read_text())['/**'] for name in names]
    file = tmp_path / 'two.yaml'
    file.write_text(yaml.safe_dump(dict(zip(('/a/**', '/b/**'), shipped, strict=True))))
    failures = RotorFailures((RotorFailure.parse('6@1'),))
    trajectory = Trajectory.to(Waypoint.of(1.0, 1.0, 1.0, 0.0))
    Plan(trajectory, failures, vehicle=str(file), namespace='/a').commands()
    with pytest.raises(ParameterError, match='--fail 6@1: the vehicle has 4 rotors'):
        Plan(trajectory, failures, vehicle=str(file), namespace='/b').commands()
    # Other files may have other rotors.
    ros = ['--ros-args', '--params-file', str(find('hexarotor'))]
    Plan(trajectory, failures, vehicle='quadrotor', ros=ros).commands()
