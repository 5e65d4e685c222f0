"""Vehicles whose rotors tilt over ROS: flights, and angles as safe as speeds."""

from math import radians, sqrt

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray, Int8MultiArray

from ca_ros import ParameterError, Vehicle
from ca_ros.allocation import ALLOCATORS
from ca_ros.allocation.rates import PERIOD_MAX, WithinRates
from ca_ros.bringup.flight_options import failure_words
from ca_ros.control.trajectory import Trajectory
from ca_ros.firmware.detector import detector_of
from ca_ros.nodes.allocator import ProblemAllocatorNode
from ca_ros.nodes.allocator_node import AllocatorNode
from ca_ros.nodes.controller import ControllerNode
from ca_ros.nodes.messages import speeds_message, speeds_stamp, wrench_numbers
from ca_ros.nodes.simulator import SimulatorNode
from ca_ros.parameter_files import load
from ca_ros.settings import flat
from ca_ros.simulation.closed_loop import fly, waypoint_changes
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from ca_ros.testing import wrench
from nodes import REST, pose_message, velocity_message

NAME = 'hexarotor_tilting'
HEXAROTOR = Vehicle.load(NAME)
PLANT = ['simulator.servo_time_constant:=0.03', 'simulator.servo_rate:=6.0',
         'simulator.motor_time_constant:=0.02']
SLALOM = 't,x,y,z,heading\n0,0,0,0,0\n1,0.4,-0.4,0,0\n2,0.8,0.4,0,0\n3,1.2,-0.4,0,0\n'
QUARTER = sqrt(0.5)
ROLL = f't,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n0.5,0,0,0,{QUARTER},0,0,{QUARTER}\n'
AWAY = 't,x,y,z,heading\n0,0.2,0.1,0,0.1\n'
RATES = ['rotors.tilt_rate_max:=2.0', 'rotors.acceleration_max:=3000.0',
         'rotors.deceleration_max:=2000.0']
POSE = ['controller.attitude:=pose']
FAULTS = 'drop:=0.05 duplicate:=0.05 reorder:=0.05 delay:=0.001 jitter:=0.002 seed:=5'


# Flights

def test_failures_are_read_and_named():
    stuck = RotorFailure.parse('2@1.5=-0.4rad')
    assert (stuck.rotor, stuck.time, stuck.angle) == (2, 1.5, -0.4)
    assert RotorFailure.parse(str(stuck)) == stuck
    with pytest.raises(ParameterError, match=r'^2@1=3rad: angle: expected -1 to 1 rad'):
        RotorFailures((RotorFailure(2, 1.0, angle=3.0),)).check(HEXAROTOR)
    with pytest.raises(ParameterError, match='no rotor of this vehicle tilts'):
        Vehicle.load('hexarotor').with_stuck_servos([1.0, 0.2])
    again = HEXAROTOR.with_stuck_servos([1.0, 0.2]).with_stuck_servos([1.0, 0.3, 4.0, -1.0])
    assert again.servos.stuck_rotors == [0, 3]
    assert again.servos.lower[[0, 3]].tolist() == [0.3, -1.0]
    assert again.with_stuck_servos(0.0).servos.limits[0].tolist() == [-1.0] * 6


@pytest.mark.parametrize(('name', 'duration', 'goals', 'failures', 'settings'), [
    (NAME, 0.3, AWAY, ['2@0.1=0.05rad'], RATES),
    pytest.param(NAME, 4.0, SLALOM, [], [], marks=pytest.mark.long),
    pytest.param('omnidirectional_gimbals', 3.0, ROLL, [], POSE, marks=pytest.mark.long),
    pytest.param(NAME, 2.0, AWAY, ['3@0.5=-0.3rad'], [], marks=pytest.mark.long),
    pytest.param(NAME, 2.0, AWAY, ['5@0.5'], [], marks=pytest.mark.long),
    pytest.param('tricopter', 1.0, AWAY, [], [], marks=pytest.mark.long),
], ids=['short', 'slalom', 'roll', 'servo', 'rotor', 'tricopter'])
def test_flights_over_ros_equal_those_offline_to_the_last_bit(
        graph, tmp_path, name, duration, goals, failures, settings):
    path, offline = tmp_path / 'goals.csv', tmp_path / 'offline.csv'
    path.write_text(goals)
    given = RotorFailures(tuple(map(RotorFailure.parse, failures)), 0.1)
    process = graph.start(
        'bringup', '--figures', 'none',
        '--vehicle', name, '--mode', 'lockstep', '--duration', str(duration),
        '--trajectory', str(path), '--out', str(tmp_path), *failure_words(given),
        *(['--faults', FAULTS] if settings is RATES else []), '--ros-args',
        *(word for each in [*PLANT, *settings] for word in ('-p', each)))
    case, trajectory = Case.load(name, [*PLANT, *settings]), Trajectory.read(path)
    flight = fly(
        case.controller(), case.allocator('exact'), case.plant(), trajectory.first, duration,
        changes=[*case.announced('exact', given), *waypoint_changes(trajectory)], failures=given)
    flight.write_csv(offline)
    out, err = graph.outlive(process)
    assert 'within bounds' in out, out + err
    assert (tmp_path / 'flight.csv').read_bytes() == offline.read_bytes()
    low, high = case.vehicle.servos.limits
    assert (np.abs(np.diff(flight.angles, axis=0)) > 0.0).any()
    assert ((flight.angles >= low) & (flight.angles <= high)).all()
    if settings is RATES:
        # The angle of a servo that sticks is announced, not commanded.
        free = np.delete(flight.angles, 1, axis=1)
        assert np.abs(np.diff(free, axis=0)).max() <= 0.02 + 1e-12
        assert np.diff(flight.speeds, axis=0).max() <= 30.0 + 1e-9
        assert np.diff(flight.speeds, axis=0).min() >= -20.0 - 1e-9
        assert (flight.angles[flight.time >= 0.2, 1] == 0.05).all()
    if goals is SLALOM:
        assert flight.tilt.max() < radians(3.0)
    if goals is ROLL:
        assert np.degrees(flight.attitude_error(trajectory.last)) < 1.0
        assert np.abs(flight.position).max() < 0.3


# Safety

def made(graph, kind, **over):
    values = flat(load(NAME)) | over
    return graph.add_node(kind(context=graph.context, parameter_overrides=[
        Parameter(name, value=value) for name, value in values.items()]))


def test_the_simulator_joins_speeds_and_angles_by_stamp_and_drops_wrong_ones(graph):
    node = made(graph, SimulatorNode, mode='lockstep')
    speeds, angles = (
        graph.publisher(Float64MultiArray, f'command/{name}')
        for name in ('motor_speed', 'tilt_angle'))
    moved = graph.listen(Float64MultiArray, 'tilt_angle')
    graph.connect('simulator')
    good = np.linspace(-1.0, 1.0, 6)
    for values, stamps, key in (
        (good, (0, 5), 'without the other part'),
        (good + 0.1, (0, 0), 'dropped: bounds'),
        (good - 0.1, (0, 0), 'dropped: sign'),
        (np.where(good > 0.9, np.nan, good), (0, 0), 'dropped: numbers'),
        (good[:5], (0, 0), 'dropped: length'),
    ):
        def send(values=values, stamps=stamps):
            angles.publish(speeds_message(values, stamps[1]))
            speeds.publish(speeds_message(np.full(6, 250.0), stamps[0]))
        graph.spin_until(lambda key=key: node.diagnostics.counts[key], key, repeat=send)
        assert not node.diagnostics.counts['served']
        assert not any(np.any(each.data) for each in moved)
    def send():
        speeds.publish(speeds_message(np.full(6, 250.0), 0))
        angles.publish(speeds_message(good, 0))
    graph.spin_until(lambda: node.diagnostics.counts['served'], 'a step', repeat=send)
    graph.spin_until(lambda: moved and np.array_equal(moved[-1].data, good), 'the angles')
    assert speeds_stamp(moved[-1]) == 0


def test_without_commands_the_angles_stay_and_after_a_failure_they_are_its(graph):
    node = made(graph, AllocatorNode)
    command = graph.publisher(WrenchStamped, 'command/wrench')
    speeds, angles = (
        graph.listen(Float64MultiArray, f'command/{name}')
        for name in ('motor_speed', 'tilt_angle'))
    graph.connect('allocator')
    u = [2.0, 0.0, 9.81, 0.0, 0.0, 0.0]
    def expired():
        answered = [m for m in angles if speeds_stamp(m) == 7]
        return answered and speeds_stamp(angles[-1]) is speeds_stamp(speeds[-1]) is None
    graph.spin_until(expired, 'a timeout', repeat=lambda: command.publish(wrench(u, 7)))
    answer = node.belief.built.method.allocate(u)
    [first, *_] = [m for m in angles if speeds_stamp(m) == 7]
    assert first.layout.dim[0].label == 'tilt angle [rad]'
    assert first.data.tobytes() == answer.angles.tobytes()
    assert angles[-1].data == first.data
    assert speeds[-1].data.tobytes() == HEXAROTOR.idle_speeds.tobytes()
    [result] = node.set_parameters([Parameter('rotors.stuck_servos', value=[2.0, -0.7])])
    assert result.successful, result.reason
    graph.spin_until(lambda: angles[-1].data[1] == -0.7, 'the angle at which it sticks')
    [result] = node.set_parameters([Parameter('rotors.stuck_servos', value=[2.0, 1.7])])
    assert result.reason == 'rotors.stuck_servos: angle: expected -1 to 1 rad, got 1.7'


def test_a_late_copy_has_the_same_answer_and_changes_no_later_one(graph):
    """In lockstep, also after parameters and the waypoint have changed."""
    node = made(graph, AllocatorNode, mode='lockstep', **{
        'rotors.tilt_rate_max': 2.0, 'rotors.acceleration_max': 3000.0})
    control = made(graph, ControllerNode, mode='lockstep')
    command, waypoint, pose, velocity = (graph.publisher(kind, name) for kind, name in (
        (WrenchStamped, 'command/wrench'), (PoseStamped, 'command/pose'),
        (PoseStamped, 'local_position/pose'), (TwistStamped, 'local_position/velocity_body')))
    angles = graph.listen(Float64MultiArray, 'command/tilt_angle')
    wrenches = graph.listen(WrenchStamped, 'command/wrench')
    graph.connect('allocator')
    graph.connect('controller')
    demands = {time: [force, 0.0, 9.81, 0.0, 0.0, 0.0] for time, force in (
        (1, 0.5), (10_000_000, 1.0), (20_000_000, 1.5))}

    def ask(time):
        count = len(angles)
        command.publish(wrench(demands[time], time))
        graph.spin_until(lambda: len(angles) > count, 'angles')
        return angles[-1].data.tobytes()

    last, before, first = node._last, 1 - round(1e9 * PERIOD_MAX), node.belief.built.method
    answers = [ask(time) for time in (1, 10_000_000)]
    [result] = node.set_parameters([Parameter('rotors.stuck_servos', value=[2.0, 0.05])])
    assert result.successful, result.reason
    assert [ask(time) for time in (1, 10_000_000)] == answers
    methods = first, first, node.belief.built.method
    for (time, u), method in zip(demands.items(), methods, strict=True):
        last, before = WithinRates(method).allocate(u, last, time, before).command, time
    assert ask(20_000_000) == last[6:].tobytes()

    def fly_to(x):
        before = control.waypoint
        waypoint.publish(pose_message((x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0))
        graph.spin_until(lambda: control.waypoint is not before, 'the waypoint')

    def see(time):
        wrenches.clear()
        pose.publish(pose_message(*REST[:2], time))
        velocity.publish(velocity_message(*REST[2:], time))
        graph.spin_until(lambda: [m for m in wrenches if m.header.stamp.sec == time], 'a wrench')
        return wrench_numbers(wrenches[-1])

    fly_to(1.0)
    answer = see(1)
    fly_to(2.0)
    assert see(1) == answer != see(2)


def test_what_takes_no_rotors_that_tilt_refuses_them_in_one_line(graph):
    takers = [name for name, kind in ALLOCATORS.items() if kind.takes_vectors]
    with pytest.raises(ParameterError, match='exact, pseudo_inverse, ') as refusal:
        made(graph, AllocatorNode, **{'allocation.method': 'direct'})
    assert all(name in str(refusal.value) for name in takers)
    with pytest.raises(ParameterError, match='takes fixed rotors only; expected none that tilt'):
        detector_of(HEXAROTOR, {})
    with pytest.raises(ParameterError, match='PseudoInverse does not keep the rates'):
        made(graph, AllocatorNode, **{
            'allocation.method': 'pseudo_inverse', 'rotors.tilt_rate_max': 1.0})


@pytest.mark.parametrize(('mode', 'stamp'), [('realtime', 7), ('lockstep', 0)])
def test_effectors_in_sets_of_a_problem_without_a_vehicle(graph, tmp_path, mode, stamp):
    file = tmp_path / 'boat.yaml'
    file.write_text("""problem:
  axes: [surge, sway]
  matrix: [[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]
  sets: [{disc: 2.0}, {interval: [0.2, 1.0]}]
""")
    node = graph.add_node(ProblemAllocatorNode(context=graph.context, parameter_overrides=[
        Parameter('problem', value=str(file)), Parameter('mode', value=mode)]))
    command = graph.publisher(WrenchStamped, 'command/wrench')
    effectors, saturation = (
        graph.listen(kind, name) for kind, name in (
            (Float64MultiArray, 'command/effectors'), (Int8MultiArray, 'allocator/saturation')))
    graph.connect('allocator')
    u = [1.0, 0.5, 0.0, 0.0, 0.0, 0.0]
    graph.spin_until(
        lambda: len(saturation) > 1, 'answers', repeat=lambda: command.publish(wrench(u, stamp)))
    [*_, answer] = [each for each in effectors if speeds_stamp(each) == stamp]
    # By hand: x = (1, 0.5) - (f, f) / 2 and least x^2 + f^2 at f = 0.5.
    np.testing.assert_allclose(answer.data, [0.75, 0.25, 0.5], atol=1e-12)
    assert answer.layout.dim[0].label == '1.1, 1.2, 2'
    assert list(saturation[-1].data) == [0, 0]
    assert node.belief.built.at_rest('idle', node._last).tolist() == [0.0, 0.0, 0.2]
