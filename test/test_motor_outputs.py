"""The allocator's throttles and pulse widths, its battery, and problems without a vehicle."""

import signal

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from numpy.testing import assert_allclose, assert_array_equal
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from ca_ros import AllocationProblem, Exact, ParameterError, Vehicle
from ca_ros.nodes import battery as voltages
from ca_ros.nodes.allocator import ProblemAllocatorNode, rows_of
from ca_ros.nodes.topics import STANDING
from ca_ros.testing import Diagnostics, wrench
from ca_ros.vehicle.files import read
from nodes import host

BatteryState = pytest.importorskip('sensor_msgs.msg').BatteryState

CURVE = {
    'rotors.thrust_curve.speeds': [50.0, 100.0, 200.0, 400.0],
    'rotors.thrust_curve.thrusts': [0.06, 0.3, 1.2, 3.9],
    'rotors.thrust_curve.throttles': [0.05, 0.2, 0.5, 1.0],
    'rotors.thrust_curve.pwm': [1100.0, 1900.0], 'rotors.speed_max_per_volt': 25.0,
}


def test_throttles_pulses_and_the_voltage(graph, capfd, monkeypatch):
    monkeypatch.setattr(voltages, 'TIMEOUT', 0.5)
    options = CURVE | {'timeout_action': 'hold'}
    words = [word for name, value in options.items() for word in ('-p', f'{name}:={value}')]
    host(graph, 'allocator', *words)
    vehicle = Vehicle.from_parameters(read('hexarotor') | CURVE)
    sender = graph.publisher(WrenchStamped, 'command/wrench')
    battery = graph.publisher(BatteryState, 'battery')
    got = {name: graph.listen(Float64MultiArray, f'command/{name}')
           for name in ('motor_speed', 'throttle', 'pwm')}
    diagnostics = Diagnostics(graph)
    stamp = 0

    def answers(u):
        """Return speeds, throttles and pulse widths for a wrench."""
        nonlocal stamp
        stamp += 1
        label, expected = f'stamp {stamp}', wrench(u, stamp)

        def last():
            found = [list(filter(lambda m: m.layout.dim[1].label == label, each))
                     for each in got.values()]
            return [each[-1] for each in found] if all(found) else None

        graph.spin_until(last, f'the answers to {u}', lambda: sender.publish(expected))
        return [np.array(message.data) for message in last()]

    hover = [0.0, 0.0, 9.81, 0.1, 0.0, 0.0]
    speeds, throttles, pulses = answers(hover)
    assert_array_equal(speeds, Exact(vehicle).allocate(hover[2:]).speeds)
    assert_array_equal(throttles, vehicle.throttles(speeds))
    assert_array_equal(pulses, 1100.0 + 800.0 * throttles)
    assert got['throttle'][-1].layout.dim[0].label == 'throttle'
    assert got['pwm'][-1].layout.dim[0].label == 'pulse width [us]'
    assert_allclose(answers([0.0, 0.0, 100.0, 0.0, 0.0, 0.0])[0], 400.0)

    # At 12 V the rotors reach 300 rad/s, and a speed needs a greater throttle.
    sagging = vehicle.at_voltage(12.0)
    battery.publish(BatteryState(voltage=12.0))
    # Commands have ceased, and what the node holds keeps the new bound.
    graph.spin_until(lambda: got['motor_speed'][-1].data[0] == 300.0, 'less speed')
    assert got['motor_speed'][-1].layout.dim[1].label == 'no stamp'
    speeds, throttles, _ = answers(hover)
    assert_array_equal(speeds, Exact(sagging).allocate(hover[2:]).speeds)
    assert_array_equal(throttles, sagging.throttles(speeds))
    assert throttles.max() > vehicle.throttles(speeds).max()

    # Absurd voltages change nothing; without sound ones a warning begins.
    for absurd in (float('nan'), float('inf'), -12.0, 0.0, 1.7, 4.0, 16800.0):
        battery.publish(BatteryState(voltage=absurd))
    diagnostics.wait(
        'allocator', lambda _, text, values: 'no sound voltage for 0.5 s: 12 V holds' in text,
        'no voltage')
    assert_allclose(answers([0.0, 0.0, 100.0, 0.0, 0.0, 0.0])[0], 300.0)
    assert 'refused battery: ' in capfd.readouterr().err


def matrix_message(matrix, offset=0):
    layout = MultiArrayLayout(
        dim=[MultiArrayDimension(size=size) for size in np.shape(matrix)], data_offset=offset)
    return Float64MultiArray(layout=layout, data=np.ravel(matrix).tolist())


def test_a_problem_without_a_vehicle_in_the_node(graph):
    process = graph.start('allocator', '--vehicle', 'admire')
    sender = graph.publisher(WrenchStamped, 'command/wrench')
    matrices, healths = (
        graph.node.create_publisher(Float64MultiArray, name, STANDING)
        for name in ('effectiveness', 'effector_health'))
    received = graph.listen(Float64MultiArray, 'command/effectors')
    diagnostics = Diagnostics(graph)
    admire, u, stamp = AllocationProblem.load('admire'), [1.5, 1.0, -0.2], 0

    def answer():
        """Return the answer to a new message, and its label."""
        nonlocal stamp
        stamp += 1
        label, demand = f'stamp {stamp}', wrench([0.0, 0.0, 0.0, *u], stamp)
        graph.spin_until(
            lambda: any(m.layout.dim[1].label == label for m in received),
            'effectors', lambda: sender.publish(demand))
        return next(m for m in received if m.layout.dim[1].label == label)

    def settles(allocator):
        """Wait until answers are those of an allocator."""
        expected = allocator.allocate(u).effectors.tolist()
        graph.spin_until(lambda: answer().data.tolist() == expected, f'answers of {allocator!r}')

    assert_array_equal(answer().data, Exact(admire).allocate(u).effectors)
    names = 'canards', 'right elevons', 'left elevons', 'rudder'
    assert answer().layout.dim[0].label == ', '.join(f'{name} [rad]' for name in names)

    # Another airspeed; then the rudder sticks, the left elevons are weak, and both recover.
    faster = Exact(admire).with_matrix(1.3 * admire.gamma)
    matrices.publish(matrix_message(1.3 * admire.gamma))
    settles(faster)
    healths.publish(Float64MultiArray(data=[1.0, 1.0, 0.5, 1.0, 4.0, 0.1]))
    settles(faster.with_health([1.0, 1.0, 0.5, 1.0], stuck={4: 0.1}))
    diagnostics.wait(
        'allocator', lambda *status: status[2].get('stuck effectors') == '4', 'a stuck effector')
    matrices.publish(matrix_message(admire.gamma))
    settles(Exact(admire).with_health([1.0, 1.0, 0.5, 1.0], stuck={4: 0.1}))
    # Without elevons the rudder rolls and yaws: the other axes keep their places in the wrench.
    healths.publish(Float64MultiArray(data=[1.0, 0.0, 0.0, 1.0]))
    settles(Exact(admire).with_health([1.0, 0.0, 0.0, 1.0]))

    # What is wrong is refused, and changes nothing.
    matrices.publish(matrix_message(admire.gamma.T))
    healths.publish(Float64MultiArray(data=[2.0] * 4))
    diagnostics.wait(
        'allocator', lambda _, text, values: 'yaw lost' in text
        and values['lost effectors'] == '2, 3' and values.get('refused matrices') == '1'
        and values.get('refused health') == '1', 'a lost axis and what is refused')
    settles(Exact(admire).with_health([1.0, 0.0, 0.0, 1.0]))
    healths.publish(Float64MultiArray(data=[1.0] * 4))
    settles(Exact(admire))

    # Commands cease: the values nearest to zero.
    graph.spin_until(lambda: received[-1].layout.dim[1].label == 'no stamp', 'the timeout action')
    assert_array_equal(received[-1].data, admire.resting_thrusts)
    _, err = graph.end(process, signal.SIGTERM)
    assert 'Traceback' not in err
    assert 'expected 3 rows, one per axis, of 4 numbers, one per effector' in err
    assert process.returncode == 0


def test_wrong_matrices_and_health_of_effectors_are_refused(graph):
    node = graph.add_node(ProblemAllocatorNode(
        context=graph.context, parameter_overrides=[Parameter('problem', value='admire')]))
    gamma, built = AllocationProblem.load('admire').gamma, node.belief.built
    for wrong in (
            matrix_message(gamma.T), matrix_message(gamma[:2]), matrix_message(gamma.ravel()),
            matrix_message(gamma, offset=1), Float64MultiArray(data=gamma.ravel().tolist()),
            matrix_message(np.where(gamma == 0.0, np.inf, gamma)), matrix_message(np.ones((3, 4))),
            matrix_message(1e-9 * gamma)):
        node.belief._receive_matrix(wrong)
    for wrong in (
            [1.0] * 3, [1.0] * 5, [2.0] * 4, [-0.1] * 4, [np.nan] * 4, [1.0] * 4 + [4.0, 2.0],
            [1.0] * 4 + [5.0, 0.0], [1.0] * 4 + [1.5, 0.0]):
        node.belief._receive_announcement(Float64MultiArray(data=wrong), 'effector_health')
    counts = node.diagnostics.counts
    assert (counts['refused matrices'], counts['refused health']) == (8, 8)
    assert node.belief.built is built
    # What is in force already is not made anew.
    node.belief._receive_matrix(matrix_message(gamma))
    node.belief._receive_announcement(Float64MultiArray(data=[1.0] * 4), 'effector_health')
    assert node.belief.built is built


def test_axes_are_components_of_the_wrench_by_name():
    assert rows_of(['roll', 'pitch', 'yaw']) == [3, 4, 5]
    assert rows_of(['surge', 'sway', 'yaw']) == [0, 1, 5]
    for wrong in (['axis_1', 'yaw'], ['yaw', 'torque_z']):
        with pytest.raises(ParameterError, match=r'^problem\.axes: .* expected different ones of'):
            rows_of(wrong)
