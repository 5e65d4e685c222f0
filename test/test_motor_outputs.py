"""The allocator's throttles and pulse widths, its battery, and problems without a vehicle."""

import signal

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from numpy.testing import assert_allclose, assert_array_equal
from std_msgs.msg import Float64MultiArray

from ca_ros import AllocationProblem, Exact, ParameterError, Vehicle
from ca_ros.nodes import belief
from ca_ros.nodes.allocator import rows_of
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
    monkeypatch.setattr(belief, 'BATTERY_TIMEOUT', 0.5)
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


def test_a_problem_without_a_vehicle_in_the_node(graph):
    process = graph.start('allocator', '--vehicle', 'admire')
    sender = graph.publisher(WrenchStamped, 'command/wrench')
    received = graph.listen(Float64MultiArray, 'command/effectors')
    demand = wrench([0.0, 0.0, 0.0, 1.5, 1.0, -0.2], 7)
    graph.spin_until(
        lambda: any(m.layout.dim[1].label == 'stamp 7' for m in received),
        'effectors', lambda: sender.publish(demand))
    answer = next(m for m in received if m.layout.dim[1].label == 'stamp 7')
    admire = AllocationProblem.load('admire')
    assert_array_equal(answer.data, Exact(admire).allocate([1.5, 1.0, -0.2]).effectors)
    names = 'canards', 'right elevons', 'left elevons', 'rudder'
    assert answer.layout.dim[0].label == ', '.join(f'{name} [rad]' for name in names)
    # Commands cease: the values nearest to zero.
    graph.spin_until(lambda: received[-1].layout.dim[1].label == 'no stamp', 'the timeout action')
    assert_array_equal(received[-1].data, admire.resting_thrusts)
    _, err = graph.end(process, signal.SIGTERM)
    assert 'Traceback' not in err
    assert process.returncode == 0


def test_axes_are_components_of_the_wrench_by_name():
    assert rows_of(['roll', 'pitch', 'yaw']) == [3, 4, 5]
    assert rows_of(['surge', 'sway', 'yaw']) == [0, 1, 5]
    for wrong in (['axis_1', 'yaw'], ['yaw', 'torque_z']):
        with pytest.raises(ParameterError, match=r'^problem\.axes: .* expected different ones of'):
            rows_of(wrong)
