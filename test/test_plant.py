"""The effects of the plant against closed forms, laws and statistics."""

from dataclasses import replace
from itertools import pairwise
from math import exp

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ca_ros.control.waypoint import Waypoint
from ca_ros.detection.detector_settings import ImuSettings
from ca_ros.settings import ParameterError, read, table
from ca_ros.simulation.closed_loop import fly
from ca_ros.simulation.drag import Drag, Wind
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.simulation.rigid_body import RigidBody, euler
from ca_ros.studies.cases import Case
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.motor_lag import lagged
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, NULL_STATE, POSITION, VELOCITY
from strategies import EVERY_EFFECT, HEXAROTOR, rk4

HOVER = np.full(6, np.sqrt(9.81 / (6 * 2.5e-5)))
STOPPED = np.zeros(6)


def plant(state=None, vehicle=HEXAROTOR, integrate=euler, **given):
    given = {f'simulator.{name}': value for name, value in given.items()}
    settings = read(PlantSettings, given, 'simulator.')
    return Plant(body_of(vehicle, settings), settings, state, integrate)


def run(flown, command, steps):
    """Return the true states (steps + 1, 13)."""
    states = [flown.state]
    for _ in range(steps):
        flown.step(command)
        states.append(flown.state)
    return np.array(states)


def falling(**parts):
    state, where = NULL_STATE.copy(), {
        'position': POSITION, 'velocity': VELOCITY, 'omega': ANGULAR_VELOCITY}
    for name, value in parts.items():
        state[where[name]] = value
    return state


# Motors and delays


def test_a_motor_follows_a_step_as_one_minus_exp():
    # 1 - exp(-t / T), in any number of steps.
    for steps in (1, 3, 10):
        speeds = STOPPED
        for _ in range(steps):
            speeds = lagged(0.05, speeds, HOVER, 0.1 / steps)
        np.testing.assert_allclose(speeds, (1.0 - exp(-2.0)) * HOVER, rtol=1e-14)
    slow = plant(motor_time_constant=0.05)
    for _ in range(5):
        slow.step(HOVER)
    np.testing.assert_allclose(slow.speeds, (1.0 - exp(-1.0)) * HOVER, rtol=1e-14)


def test_a_lag_acts_as_late_in_whole_steps_as_in_small_ones():
    def climbed(sub_steps):
        flown = plant(sub_steps=sub_steps, motor_time_constant=0.05)
        flown.speeds = HOVER
        return run(flown, 1.1 * HOVER, 6)[-1][5]

    # The speeds at the end of each step would act 5 ms too early: 0.29 m/s instead of 0.24.
    assert climbed(1.0) == pytest.approx(climbed(100.0), rel=2e-3)


def test_a_late_command_is_the_same_flight_later():
    prompt, late = plant(sub_steps=10.0), plant(sub_steps=10.0, command_delay=0.02)
    rng = np.random.default_rng(0)
    commands = rng.uniform(200.0, 300.0, (20, 6))
    # Without commands the rotors stand still, so for two steps the vehicle falls.
    expected = prompt.restarted(run(prompt.restarted(), STOPPED, 2)[-1])
    for i, command in enumerate(commands):
        late.step(command)
        if i >= 2:
            expected.step(commands[i - 2])
            np.testing.assert_array_equal(late.state, expected.state)


def test_a_late_state_is_the_true_one_of_that_time():
    # 13 ms on a grid of 1 ms: between two states of the grid of 10 ms.
    flown = plant(sub_steps=10.0, state_delay=0.013, integrate=rk4)
    run(flown, STOPPED, 50)
    assert flown.measured[2] == pytest.approx(-0.5 * 9.81 * (0.5 - 0.013) ** 2, rel=1e-12)
    assert flown.state[2] == pytest.approx(-0.5 * 9.81 * 0.5**2, rel=1e-12)
    rest = plant(state_delay=0.05)
    rest.step(STOPPED)
    np.testing.assert_array_equal(rest.measured, NULL_STATE)


@pytest.mark.parametrize('name', ['command_delay', 'state_delay'])
def test_a_delay_that_is_no_multiple_of_the_step_is_refused(name):
    with pytest.raises(ParameterError, match=f'simulator.{name}.* multiple .*0.005 s, got 0.012'):
        plant(sub_steps=2.0, **{name: 0.012})


# Integration


@pytest.mark.parametrize(('integrate', 'order'), [(euler, 1), (rk4, 4)])
def test_the_order_of_the_integrators_on_a_spinning_body(integrate, order):
    # Torque-free, with three different moments; Euler's equations solved independently.
    vehicle = replace(HEXAROTOR, inertia=np.diag([0.01, 0.02, 0.025]))
    start = falling(omega=[3.0, 4.0, -2.0])

    def rates(_, y):
        (p, q, r), (x, y_, z, w) = y[:3], y[3:]
        spin = np.cross(vehicle.inertia @ y[:3], y[:3]) / np.diag(vehicle.inertia)
        return [*spin, *0.5 * np.array([
            w * p + y_ * r - z * q, w * q + z * p - x * r, w * r + x * q - y_ * p,
            -x * p - y_ * q - z * r])]

    exact = solve_ivp(
        rates, (0.0, 0.4), np.concatenate([start[ANGULAR_VELOCITY], start[ATTITUDE]]),
        method='DOP853', rtol=1e-13, atol=1e-13).y[:, -1]
    errors = []
    for sub_steps in (1.0, 2.0, 4.0):
        after = run(plant(start, vehicle, integrate=integrate, sub_steps=sub_steps), STOPPED, 40)
        errors.append(np.linalg.norm(after[-1][[10, 11, 12, 6, 7, 8, 9]] - exact))
    for coarse, fine in pairwise(errors):
        assert 0.8 * 2**order < coarse / fine < 1.25 * 2**order
    assert errors[0] < {1: 0.2, 4: 1e-5}[order]


# Drag and wind


def test_the_terminal_velocity_is_weight_over_drag():
    # m g / c = 9.81 / 2 m/s, along the body's z axis; v(t) = v_end (1 - exp(-c t / m)).
    flown = plant(linear_drag=[0.5, 0.5, 2.0], integrate=rk4)
    states = run(flown, STOPPED, 1000)
    assert states[100, 5] == pytest.approx(-9.81 / 2.0 * (1.0 - exp(-2.0)), rel=1e-7)
    np.testing.assert_allclose(states[-1][VELOCITY], [0.0, 0.0, -9.81 / 2.0], rtol=1e-8)


def test_a_vehicle_drifts_to_the_wind():
    # v(t) = wind (1 - exp(-c t / m)), while the rotors carry the weight.
    flown = plant(linear_drag=0.5, wind=[3.0, -2.0, 0.0], integrate=rk4)
    velocity = run(flown, HOVER, 200)[-1][VELOCITY]
    np.testing.assert_allclose(velocity, (1.0 - exp(-1.0)) * np.array([3.0, -2.0, 0.0]), atol=1e-6)


def test_rotor_drag_by_hand():
    # Six rotors at 200 rad/s, 1e-5: 6 * 1e-5 * 200 * 2 m/s = 0.024 N against the motion, and
    # nothing along the rotors' axes.  The rotors are in the plane of the centre: no torque.
    drag, speeds = Drag(rotor=1e-5), np.full(6, 200.0)
    force, torque = drag.wrench(HEXAROTOR, np.array([2.0, 0.0, 5.0]), np.zeros(3), speeds)
    np.testing.assert_allclose(force, [-0.024, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(torque, 0.0, atol=1e-15)
    # A yaw rate of 3 rad/s moves each hub at 1.2 m/s: 6 * 1e-5 * 200 * 1.2 * 0.4 N m.
    force, torque = drag.wrench(HEXAROTOR, np.zeros(3), np.array([0.0, 0.0, 3.0]), speeds)
    np.testing.assert_allclose(force, 0.0, atol=1e-15)
    np.testing.assert_allclose(torque, [0.0, 0.0, -6 * 1e-5 * 200.0 * 1.2 * 0.4], atol=1e-15)
    # A rotor that turns backwards has the same drag.
    back, _ = drag.wrench(HEXAROTOR, np.array([2.0, 0.0, 5.0]), np.zeros(3), -speeds)
    np.testing.assert_allclose(back, [-0.024, 0.0, 0.0], atol=1e-15)


def test_drag_acts_along_the_axes_of_the_body():
    # Heading left, the body's x axis is north.
    state = falling(velocity=[1.0, 1.0, 0.0])
    state[ATTITUDE] = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
    rate = RigidBody(HEXAROTOR, Drag(linear=np.array([0.1, 0.5, 0.0]))).derivative(state, HOVER)
    np.testing.assert_allclose(rate[VELOCITY], [-0.5, -0.1, 0.0], atol=1e-12)


@pytest.mark.parametrize('step', [0.05, 0.2])
def test_gusts_have_their_variance_and_correlation_at_any_step(step):
    # 1 / exp(1) after the correlation time; 5000 correlation times of samples.
    intensity = np.array([0.5, 1.0, 2.0])
    wind = Wind(np.array([1.0, 2.0, 3.0]), intensity, 0.4, np.random.default_rng(0))
    gusts = np.array([wind(step) for _ in range(round(2000.0 / step))]) - [1.0, 2.0, 3.0]
    lag = round(0.4 / step)
    correlation = np.mean(gusts[:-lag] * gusts[lag:], axis=0) / intensity**2
    # Standard errors: sqrt(2 * 0.4 / 2000) = 2 % of the variance.
    np.testing.assert_allclose(gusts.std(axis=0) / intensity, 1.0, atol=0.05)
    np.testing.assert_allclose(correlation, exp(-1.0), atol=0.08)
    np.testing.assert_allclose(gusts.mean(axis=0) / intensity, 0.0, atol=0.08)


def test_wind_without_drag_is_refused():
    with pytest.raises(ParameterError, match=r'simulator\.wind .* set simulator\.linear_drag'):
        plant(wind=[1.0, 0.0, 0.0])
    with pytest.raises(ParameterError, match=r'simulator\.gust_intensity act through the drag'):
        plant(gust_intensity=1.0, rotational_drag=1e-3)


# Ground


def test_the_ground_holds_the_vehicle_until_it_lifts_off():
    flown = plant(ground='flat', motor_time_constant=0.1, integrate=rk4)
    np.testing.assert_array_equal(run(flown, STOPPED, 50)[-1], NULL_STATE)
    # The lagging rotors carry the weight from (1 - exp(-t / T)) 1.2 = 1 on, t = 0.179 s.
    states = run(flown, 1.2 * HOVER, 100)
    np.testing.assert_array_equal(states[:17, 2], 0.0)
    assert np.all(states[19:, 2] > 0.0)


@pytest.mark.parametrize('integrate', [euler, rk4])
def test_a_fall_ends_on_the_ground(integrate):
    start = falling(position=[0.0, 0.0, 2.0], velocity=[1.0, 0.0, 0.0], omega=[0.0, 1.0, 0.0])
    states = run(plant(start, ground='flat', integrate=integrate), STOPPED, 100)
    assert states[:, 2].min() == 0.0
    # sqrt(2 h / g) = 0.639 s.
    assert np.argmax(states[:, 2] == 0.0) in (64, 65)
    np.testing.assert_array_equal(states[-1], states[70])
    np.testing.assert_array_equal(states[-1][[3, 4, 5, 10, 11, 12]], 0.0)


# Mismatch


def test_a_mismatch_is_the_vehicle_with_scaled_coefficients():
    factors = {
        'simulator.mass_factor': 1.1, 'simulator.thrust_factor': [0.9, 1.0, 1.0, 1.1, 1.0, 0.8],
        'simulator.torque_factor': 1.5}
    other = body_of(HEXAROTOR, read(PlantSettings, factors, 'simulator.')).vehicle
    k_f = HEXAROTOR.thrust_coefficient * factors['simulator.thrust_factor']
    expected = replace(
        HEXAROTOR, mass=1.1, thrust_coefficient=k_f, thrust_coefficient_reverse=k_f,
        torque_coefficient=1.5 * HEXAROTOR.torque_coefficient)
    assert other.mass == expected.mass
    np.testing.assert_allclose(other.thrusts(HOVER), k_f * HOVER**2, rtol=1e-15)
    # The reaction torque is k_tau omega^2, whatever k_f is.
    np.testing.assert_allclose(
        (rotor_wrenches(other) * other.thrusts(HOVER))[5],
        1.5 * (rotor_wrenches(HEXAROTOR) * HEXAROTOR.thrusts(HOVER))[5], rtol=1e-12)
    start = falling(omega=[0.1, 0.2, 0.3])
    np.testing.assert_array_equal(
        RigidBody(other).derivative(start, HOVER), RigidBody(expected).derivative(start, HOVER))


# Sensors


def test_noise_and_bias_have_their_statistics():
    noise = {'position': 0.01, 'velocity': [0.02, 0.03, 0.04], 'attitude': 0.05,
             'angular_velocity': 0.06}
    bias = {'position': [0.1, 0.2, 0.3], 'velocity': 0.4, 'attitude': [0.0, 0.0, 0.2],
            'angular_velocity': -0.5}
    start = NULL_STATE.copy()
    start[ATTITUDE] = Rotation.from_euler('XYZ', [0.3, -0.4, 1.0]).as_quat()
    flown = plant(
        start, ground='flat', **{f'{part}_noise': value for part, value in noise.items()},
        **{f'{part}_bias': value for part, value in bias.items()})
    measured = np.array([flown.step(STOPPED) for _ in range(4000)])
    np.testing.assert_array_equal(flown.state, start)
    turned = Rotation.from_quat(start[ATTITUDE]).inv() * Rotation.from_quat(measured[:, ATTITUDE])
    found = np.column_stack([measured[:, :6], turned.as_rotvec(), measured[:, ANGULAR_VELOCITY]])
    three = np.ones(3)
    spread = np.concatenate([value * three for value in noise.values()])
    # Standard errors: sigma / sqrt(4000) of the mean, sigma / sqrt(8000) of sigma.
    np.testing.assert_allclose(
        (found.mean(axis=0) - np.concatenate([value * three for value in bias.values()])) / spread,
        0.0, atol=0.06)
    np.testing.assert_allclose(found.std(axis=0) / spread, 1.0, atol=0.05)
    # White: no sample tells of the next, no component of another.
    white = (found - found.mean(axis=0)) / spread
    assert np.abs(np.mean(white[1:] * white[:-1], axis=0)).max() < 0.07
    assert np.abs(np.corrcoef(white.T) - np.eye(12)).max() < 0.07


# The whole plant


def test_all_off_is_the_rigid_body_to_the_last_bit():
    flown, state = plant(), NULL_STATE
    body, rng = RigidBody(HEXAROTOR), np.random.default_rng(0)
    for _ in range(100):
        command = rng.uniform(40.0, 400.0, 6)
        state = body.step(state, command, 0.01)
        assert flown.step(command).tobytes() == state.tobytes()
        assert flown.speeds.tobytes() == command.tobytes()


def flight(seed):
    case = Case.load('hexarotor')
    given = {**case.parameters, **EVERY_EFFECT, 'simulator.seed': seed}
    settings = read(PlantSettings, given, 'simulator.')
    flown = Plant(body_of(case.vehicle, settings), settings)
    return fly(case.controller(), case.allocator('exact'), flown, Waypoint.of(1, 1, 1, 0.5), 0.2)


def test_the_seed_decides_every_bit():
    one, same, other = flight(3.0), flight(3.0), flight(4.0)
    for name in ('position', 'attitude', 'velocity', 'angular_velocity', 'speeds'):
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name), name)
        assert np.any(getattr(one, name) != getattr(other, name)), name


@pytest.mark.slow
def test_every_parameter_has_an_effect():
    def moved(given):
        settings = read(PlantSettings, given, 'simulator.')
        imu = ImuSettings(imu_position=[0.0, 0.0, 0.0])
        flown = Plant(body_of(HEXAROTOR, settings), settings, imu=imu)
        return [[*flown.step(1.3 * HOVER), *flown.specific_force] for _ in range(20)]

    every = moved(EVERY_EFFECT)
    for name, parameter in table(PlantSettings, 'simulator.').items():
        without = 10.0 if name == 'simulator.sub_steps' else parameter.default
        # A stopped rotor differs from one that turns only after a loss; servos tilt rotors.
        if name in ('simulator.time_step', 'simulator.lost_rotors') or 'servo' in name:
            continue
        assert moved({**EVERY_EFFECT, name: without}) != every, name


def test_the_initial_state_is_that_of_the_parameters():
    flown = plant(
        initial_position=[1.0, 2.0, 3.0], initial_velocity=[4.0, 5.0, 6.0],
        initial_attitude=[0.0, 0.0, 2.0, 2.0], initial_angular_velocity=[7.0, 8.0, 9.0])
    np.testing.assert_allclose(
        flown.measured, [1, 2, 3, 4, 5, 6, 0, 0, np.sqrt(0.5), np.sqrt(0.5), 7, 8, 9], rtol=1e-15)
    # The square of this number is zero.
    assert plant(initial_attitude=[0.0, 0.0, 1e-200, 0.0]).measured[8] == 1.0


def test_a_flight_leaves_its_plant_alone():
    case = Case.load('hexarotor', ['simulator.position_noise:=0.01'])
    flown = case.plant()
    loop = case.controller(), case.allocator('exact'), flown, Waypoint.of(1.0, 0.0, 0.0, 0.0), 0.5
    np.testing.assert_array_equal(fly(*loop).position, fly(*loop).position)
    np.testing.assert_array_equal(flown.state, NULL_STATE)
    with pytest.raises(ValueError, match='time_step: the plant has its own'):
        fly(*loop, time_step=0.01)


# Accelerometer


def test_an_accelerometer_feels_thrust_and_its_own_circle_but_no_weight():
    """In hover with a turn about z, 0.1 m off the axis; at rest before the first command."""
    imu = ImuSettings(imu_position=[0.1, 0.0, 0.0], specific_force_noise=1e-9)
    state = falling(omega=[0.0, 0.0, 2.0])
    flown = Plant(RigidBody(HEXAROTOR), PlantSettings(sub_steps=5), state, imu=imu)
    np.testing.assert_allclose(flown.specific_force, [-0.4, 0.0, 9.81], atol=1e-6)
    flown.step(1.1 * HOVER)
    np.testing.assert_allclose(flown.specific_force, [-0.4, 0.0, 1.21 * 9.81], atol=1e-6)
    flown.step(STOPPED)
    np.testing.assert_allclose(flown.specific_force, [-0.4, 0.0, 0.0], atol=1e-6)


def test_an_accelerometer_is_as_late_as_the_state_and_changes_no_bit_of_a_flight():
    settings = read(PlantSettings, EVERY_EFFECT, 'simulator.')
    imu = ImuSettings(imu_position=[0.05, 0.0, 0.02])
    body = body_of(HEXAROTOR, settings)
    without, flown = Plant(body, settings), Plant(body, settings, imu=imu)
    for _ in range(50):
        np.testing.assert_array_equal(without.step(HOVER), flown.step(HOVER))
    assert without.specific_force is None
    late = Plant(RigidBody(HEXAROTOR), PlantSettings(state_delay=0.02), imu=imu)
    up = [late.specific_force[2] for _ in range(5) if late.step(1.5 * HOVER) is not None]
    np.testing.assert_allclose(up, 9.81 * np.array([1.0, 1.0, 2.25, 2.25, 2.25]), atol=2.0)


def test_vibration_has_the_frequencies_of_the_rotors_and_is_aliased():
    """Rotors of 2 pi 103 rad/s, sampled at 100 Hz, shake at 3 Hz, their blades at 6 Hz."""
    settings = PlantSettings(vibration=3.0, specific_force_bias=[0.1, 0.2, -0.3])
    imu = ImuSettings(imu_position=[0.0, 0.0, 0.0], specific_force_noise=1e-9)
    speed = 2.0 * np.pi * 103.0
    vehicle = replace(HEXAROTOR, speed_max=np.full(6, 2.0 * speed))
    flown = Plant(RigidBody(vehicle), settings, imu=imu)
    flown.step(np.full(6, speed))
    turned = []
    for _ in range(100):
        before = flown.state
        flown.step(np.full(6, speed))
        felt = (flown.state - before)[VELOCITY] / 0.01 + [0.0, 0.0, 9.81]
        turned.append(flown.specific_force - felt)
    spectrum = np.abs(np.fft.rfft(turned, axis=0)) / 100.0
    np.testing.assert_allclose(np.mean(turned, axis=0), [0.1, 0.2, -0.3], atol=1e-6)
    np.testing.assert_allclose(np.delete(spectrum, [0, 3, 6], axis=0), 0.0, atol=1e-6)
    assert min(spectrum[3, 0], spectrum[6, 2]) > 1e-3
    # The unbalance turns about z.
    np.testing.assert_allclose(spectrum[3, 0], spectrum[3, 1], rtol=1e-6)
    np.testing.assert_allclose([*spectrum[6, :2], spectrum[3, 2]], 0.0, atol=1e-6)


def test_vibration_is_as_strong_as_a_sine_of_its_amplitude():
    imu = ImuSettings(imu_position=[0.0, 0.0, 0.0], specific_force_noise=1e-9)
    vehicle = replace(HEXAROTOR, speed_max=HOVER)
    felt = []
    for seed in range(300):
        flown = Plant(RigidBody(vehicle), PlantSettings(vibration=3.0, seed=seed), imu=imu)
        flown.step(HOVER)
        felt.append(flown.specific_force - [0.0, 0.0, 9.81])
    # The variance of a sine is half of its squared amplitude, 4.5; 300 samples give it to 8 %.
    np.testing.assert_allclose(np.mean(np.square(felt), axis=0), 4.5, rtol=0.3)
