"""Unannounced rotor failures: detected, named, flown on with; and what is none."""

import re
from copy import deepcopy
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.stats import norm

from ca_ros import Exact
from ca_ros.control.waypoint import Waypoint
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.detection.hypothesis_test import HypothesisTest
from ca_ros.detection.kernel_detector import KernelDetector, packed
from ca_ros.detection.lag_check import LagCheck
from ca_ros.detection.leads import gathered, owed
from ca_ros.detection.motor_model import CommandedRotors, settling_of
from ca_ros.detection.naming import ODDS
from ca_ros.detection.noise_estimator import UsualMotion
from ca_ros.detection.stuck_servos import stuck_servos
from ca_ros.detection.suspicion import Suspicion
from ca_ros.kernel import extension
from ca_ros.settings import ParameterError, read
from ca_ros.simulation.closed_loop import Change, fly
from ca_ros.simulation.rigid_body import velocity_in_body
from ca_ros.studies.cases import Case
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.motor_lag import lagged
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle
from strategies import HEXAROTOR, length

REALISTIC = [
    'detector.motor_time_constant:=0.05', 'detector.delay:=0.01',
    'simulator.motor_time_constant:=0.05', 'simulator.command_delay:=0.01',
    'simulator.position_noise:=0.01', 'simulator.velocity_noise:=0.03',
    'simulator.attitude_noise:=0.005', 'simulator.angular_velocity_noise:=0.02',
    'simulator.rotor_drag:=5.0e-4', 'simulator.wind:=[1.0, 0.0, 0.0]',
    'simulator.gust_intensity:=[0.5, 0.5, 0.5]', 'controller.integral_gain:=0.5',
]
SERVOS = [
    f'{part}.{name}' for part in ('simulator', 'detector')
    for name in ('servo_time_constant:=0.03', 'servo_rate:=6.0')
]
SETTINGS = DetectorSettings(motor_time_constant=0.05, delay=0.01)
UP = Waypoint.of(0.0, 0.0, 1.0, 0.0)
UNKNOWN = np.ones(6), np.zeros(6), np.full(6, 9.0), np.zeros(6), 0.01
"""Health, peaks, usual thrusts, what was gathered, step."""
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def flown(case, failures, duration):
    """Hover with failures {time: health}; return flight and detection."""
    detection = case.detection('exact')
    changes = [Change(round(t * 1e9), body=case.body(np.array(h))) for t, h in failures.items()]
    flight = fly(case.controller(), case.allocator('exact'), case.plant(), UP, duration,
                 changes=changes, detection=detection)
    return flight, detection


def without(n, **lost):
    """Return the health of n rotors, of which some have that of rotor_I=HEALTH."""
    health = np.ones(n)
    for rotor, left in lost.items():
        health[int(rotor.removeprefix('rotor_')) - 1] = left
    return health


@pytest.mark.parametrize(('vehicle', 'n', 'rotor', 'delay'), [
    ('hexarotor', 6, 2, 0.08), ('y6', 6, 4, 0.15), ('hexarotor_tilting', 6, 5, 0.08), *length([], [
        ('hexarotor_tilted', 6, 1, 0.08), ('octorotor', 8, 8, 0.08), ('x8', 8, 3, 0.15)]),
])
def test_a_lost_rotor_is_found_and_the_vehicle_flies_on(vehicle, n, rotor, delay):
    case = Case.load(vehicle, [*REALISTIC, *SERVOS])
    flight, detection = flown(case, {2.0: without(n, **{f'rotor_{rotor}': 0.0})}, 5.0)
    assert 2.0 < detection.found[0][0] / 1e9 <= 2.0 + delay
    np.testing.assert_array_equal(
        detection.detector.health, without(n, **{f'rotor_{rotor}': 0.0}))
    assert detection.detector.evidence[rotor - 1] == 'motion'
    assert detection.detector.probabilities[rotor - 1] >= 0.995
    assert np.linalg.norm(flight.position[-100:] - UP.position, axis=1).max() < 1.0
    assert np.flatnonzero(flight.speeds[-1] == 0.0).tolist() == [rotor - 1]


@pytest.mark.parametrize(('vehicle', 'rotor', 'arm'), [('x8', 1, (1, 2)), ('y6', 1, (1, 2))])
def test_an_arm_is_named_until_it_shows_which_rotor_has_failed(vehicle, rotor, arm):
    case = Case.load(vehicle, REALISTIC)
    lost = without(case.vehicle.n, **{f'rotor_{rotor}': 0.0})
    flight, detection = flown(case, {2.0: lost}, 5.0)
    (first, both, acted), (_, one, told) = detection.found
    assert (acted.arms, told.arms) == ((arm,), ())
    assert first < 2.1e9
    np.testing.assert_array_equal(
        both, without(case.vehicle.n, **{f'rotor_{each}': 0.5 for each in arm}))
    np.testing.assert_array_equal(one, lost)
    sound = sum(arm) - rotor
    assert detection.detector.since[sound - 1] is None
    assert detection.detector.probabilities[rotor - 1] >= 0.995
    assert np.linalg.norm(flight.position[-100:] - UP.position, axis=1).max() < 1.0
    # Both engines find the same.
    engines = replayed(case, rows_of(flight)[:300])
    np.testing.assert_array_equal(engines[0].health, lost)


@pytest.mark.parametrize('name', ['x8', 'y6'])
def test_a_clock_that_steps_back_makes_no_named_arm_new(name):
    # Long after its name, what the lost rotor lacks is learnt, and would point to the other one.
    case = Case.load(name, REALISTIC)
    flight, _ = flown(case, {2.0: without(case.vehicle.n, rotor_1=0.0)}, 5.0)
    engines = both_engines(case.vehicle, case.flown.detector)
    for time, *state, speeds in rows_of(flight):
        shifted = time if time < 2_080_000_000 else time - 100_000_000_000
        answers(engines, 'observe', shifted, *state)
        answers(engines, 'command', shifted, speeds)
        assert_equal(engines)
        assert engines[0].failed_arms == (((1, 2),) if time >= 2_060_000_000 else ())


def test_whoever_announces_one_rotor_of_an_arm_tells_which_one_has_failed():
    case = Case.load('x8', REALISTIC)
    flight, _ = flown(case, {2.0: without(8, rotor_1=0.0)}, 2.1)
    engines = replayed(case, rows_of(flight))
    for each in engines:
        assert each.failed_arms == ((1, 2),)
        each.announce(without(8, rotor_1=0.0))
        np.testing.assert_array_equal(each.health, without(8, rotor_1=0.0))
        assert (each.failed_arms, each.since[1]) == ((), None)
    assert_equal(engines)


@pytest.mark.parametrize(('delay', 'milliseconds'), [(0.004, 84), (0.0045, 85), (0.0055, 86)])
def test_half_a_millisecond_of_settling_is_rounded_up(delay, milliseconds):
    settings = replace(SETTINGS, motor_time_constant=0.02, delay=delay)
    assert settling_of(settings) == milliseconds * 1_000_000


def test_both_engines_have_the_same_public_names():
    engines = both_engines(HEXAROTOR, SETTINGS)
    for kernel in engines[1:]:
        assert {each for each in dir(kernel) if each[0] != '_'} == {
            each for each in dir(engines[0]) if each[0] != '_'}
        with pytest.raises(TypeError, match='a KernelDetector cannot be copied'):
            deepcopy(kernel)


def test_both_engines_take_names_and_refuse_the_same():
    still = np.zeros(3)
    state = {'attitude': LEVEL, 'velocity': still, 'angular_velocity': still}
    for each in both_engines(HEXAROTOR, SETTINGS):
        with pytest.raises(ParameterError, match='no rotor of this vehicle tilts'):
            each.announce(without(6, rotor_1=0.5), stuck={2: 0.1})
        np.testing.assert_array_equal(each.health, np.ones(6))
        assert each.observe(0, LEVEL, still, angular_velocity=still) is False
        assert each.observe(time=10_000_000, **state, specific_force=None) is False
        with pytest.raises(ValueError, match='specific force'):
            each.observe(20_000_000, **state, specific_force=np.full(3, np.nan))
        with pytest.raises(TypeError, match=r"missing .*'angular_velocity'"):
            each.observe(0, LEVEL, still)
        with pytest.raises(TypeError, match=r"unexpected .*'force'"):
            each.observe(0, **state, force=still)
        with pytest.raises(TypeError, match="values for argument 'attitude'"):
            each.observe(0, LEVEL, **state)
        with pytest.raises(TypeError, match='observe'):
            each.observe(0, LEVEL, still, still, None, still)


@pytest.mark.parametrize('place', [
    0.05, [0.05], [50.0, 0.0, 0.0], [[0, 0, 0]], [[0, 0], [0], [0]]])
def test_a_place_of_the_accelerometer_that_cannot_be_is_refused(place):
    for given in (0.0, [0.0], 0):
        assert not DetectorSettings(imu_position=given).has_imu
    with pytest.raises(ParameterError, match=r'detector\.imu_position: expected x, y, z up'):
        read(DetectorSettings, {'detector.imu_position': place}, 'detector.')


def test_an_accelerometer_shows_a_loss_and_a_push():
    # Off the centre of mass, at a place that is told.  A wrong one refuses nothing.
    case, place = Case.load('hexarotor', REALISTIC[:-2]), np.array([0.05, -0.02, 0.01])
    settings = replace(case.flown.detector, imu_position=place.tolist())
    found = []
    for lost in (True, False):
        engines, plant = both_engines(case.vehicle, settings), case.plant()
        hover = np.full(6, (case.vehicle.weight / case.vehicle.thrust_coefficient.sum()) ** 0.5)
        before = plant.state
        for i in range(230):
            state, time = plant.measured, i * 10_000_000
            change = (plant.state - before)[[3, 4, 5, 10, 11, 12]] / 0.01 * (i > 0)
            omega, before = plant.state[ANGULAR_VELOCITY], plant.state
            turn = rotation_matrix(plant.state[ATTITUDE])
            force = turn.T @ (change[:3] + np.array([0.0, 0.0, 9.81]))
            force += np.cross(change[3:], place) + np.cross(omega, np.cross(omega, place))
            # A push upwards: it looks like no loss.
            force[2] += 0.0 if lost or i < 200 else 3.0
            motion = velocity_in_body(state), state[ANGULAR_VELOCITY]
            answers(engines, 'observe', time, state[ATTITUDE], *motion, force)
            answers(engines, 'command', time, hover)
            assert_equal(engines)
            if i == 200 and lost:
                plant.body = case.body(without(6, rotor_1=0.0))
            plant.step(hover)
        found.append(engines[0].health.tolist())
        with pytest.raises(ValueError, match=r'specific force .*: expected three numbers'):
            engines[0].observe(10**10, LEVEL, np.zeros(3), np.zeros(3), np.full(3, np.nan))
    assert found == [without(6, rotor_1=0.0).tolist(), [1.0] * 6]


@pytest.mark.parametrize(('vehicle', 'angle', 'left'), [
    ('hexarotor_tilting', 0.6, 0.0), ('hexarotor_tilting', -0.6, 0.0), ('tricopter', -0.3, 1.0),
])
def test_a_servo_that_sticks_is_found(vehicle, angle, left):
    # Its rotor is taken out of use, unless the vehicle would fall without it.
    case = Case.load(vehicle, [*REALISTIC, *SERVOS])
    detection, health = case.detection('exact'), np.ones(case.vehicle.n)
    change = Change(2_000_000_000, body=case.body(health, [2.0, angle]))
    flight = fly(case.controller(), case.allocator('exact'), case.plant(), UP, 3.5,
                 changes=[change], detection=detection)
    detector = detection.detector
    assert detector.since[1] is not None
    assert 2.0 < detector.since[1] / 1e9 < 3.0
    assert detector.since.count(None) == len(health) - 1
    found = float(re.fullmatch('servo sticks at (.*) rad', detector.evidence[1])[1])
    assert found == pytest.approx(angle, abs=0.15)
    assert detector.health.tolist() == [1.0, left, *health[2:]]
    assert detection.found == [] if left else len(detection.found) == 1
    assert np.linalg.norm(flight.position[-50:] - UP.position, axis=1).max() < 1.0


@pytest.mark.parametrize('left', [0.4, 0.5])
def test_a_partial_loss_is_found_and_estimated(left):
    case = Case.load('hexarotor', REALISTIC)
    _, detection = flown(case, {2.0: without(6, rotor_2=left)}, 2.6)
    assert detection.found[0][0] < 2.25e9
    np.testing.assert_allclose(detection.detector.health, without(6, rotor_2=left), atol=0.1)


def test_a_lost_rotor_is_not_taken_for_a_weak_one():
    # The first estimate, 50 ms after the loss, leaves rotor 5 a health of 0.37.
    case = Case.load('hexarotor_ppnnpn', REALISTIC)
    _, detection = flown(case, {4.0: without(6, rotor_5=0.0)}, 4.4)
    np.testing.assert_array_equal(detection.detector.health, without(6, rotor_5=0.0))


@pytest.mark.parametrize(('vehicle', 'other', 'later'), [
    ('octorotor', 4, 0.03), ('octorotor', 6, 0.03), ('octorotor', 4, 0.1), ('octorotor', 4, 0.5),
    ('x8', 4, 0.1), ('x8', 6, 0.1), ('x8', 7, 0.1), ('x8', 4, 0.5)])
def test_a_second_failure_is_found(vehicle, other, later):
    # Also while the first is being identified.
    case, first = Case.load(vehicle, REALISTIC), without(8, rotor_1=0.0)
    last = without(8, **{'rotor_1': 0.0, f'rotor_{other}': 0.0})
    _, detection = flown(case, {2.0: first, 2.0 + later: last}, 3.0 + later)
    arms = detection.detector.failed_arms
    # The second failure may end the motion that would tell which rotor of an arm was the first,
    # whose yaw is then unknown while the second is named.
    assert (vehicle == 'x8' and later < 0.2) or not arms
    for pair in arms:
        assert set(pair) & {1, other}
        last[np.array(pair) - 1] = 0.5
    np.testing.assert_array_equal(detection.detector.health, last)


def test_an_opposite_rotor_that_is_lost_just_after_is_named():
    # It ends the turn, so a disturbance leads its loss, and only long windows show it.
    _, detection = flown(
        Case.load('octorotor', REALISTIC),
        {2.0: without(8, rotor_1=0.0), 2.03: without(8, rotor_1=0.0, rotor_5=0.0)}, 3.0)
    assert np.flatnonzero(detection.detector.health < 0.5).tolist() == [0, 4]


@pytest.mark.parametrize(('vehicle', 'lost'), [('x8', (1, 3)), ('x8', (1, 8)), ('y6', (3, 6))])
def test_two_arms_are_named_at_once(vehicle, lost):
    # Reaction torques of rotors 1 and 3 of x8 cancel: no rotor of the two arms shows.
    case = Case.load(vehicle, REALISTIC)
    n, arms = case.vehicle.n, [(i - 1, i) if i % 2 == 0 else (i, i + 1) for i in lost]
    flight, detection = flown(
        case, {3.0: without(n, **{f'rotor_{rotor}': 0.0 for rotor in lost})}, 6.0)
    assert detection.found[0][0] < 3.15e9
    assert detection.found[0][2].arms == tuple(arms)
    # What is left of both is right whichever has failed.
    health = detection.detector.health
    for (i, j), rotor in zip(arms, lost, strict=True):
        assert health[i - 1] + health[j - 1] == pytest.approx(1.0, abs=0.1)
        assert (i, j) in detection.detector.failed_arms or health[rotor - 1] < 0.1
    assert set(np.flatnonzero(health < 1.0) + 1) <= {rotor for arm in arms for rotor in arm}
    assert np.linalg.norm(flight.position[-100:] - UP.position, axis=1).max() < 2.0
    replayed(case, rows_of(flight)[:400])


@pytest.mark.parametrize(('vehicle', 'later'), [('x8', 0.0), ('x8', 0.03), ('y6', 0.1)])
def test_both_rotors_of_an_arm_are_lost(vehicle, later):
    # Also where one of both is already named.
    case = Case.load(vehicle, REALISTIC)
    last = without(case.vehicle.n, rotor_1=0.0, rotor_2=0.0)
    first = without(case.vehicle.n, rotor_1=0.0)
    _, detection = flown(case, {2.0: first, 2.0 + later: last}, 2.5 + later)
    np.testing.assert_array_equal(detection.detector.health, last)
    assert detection.detector.failed_arms == ()
    assert detection.detector.probabilities[:2].min() >= 0.995


def test_the_health_that_is_announced_counts():
    case = Case.load('octorotor', [*REALISTIC, 'rotors.health:=[0, 1, 1, 1, 1, 1, 1, 1]'])
    _, detection = flown(case, {2.0: without(8, rotor_1=0.0, rotor_4=0.0)}, 2.4)
    np.testing.assert_array_equal(
        detection.detector.health, without(8, rotor_1=0.0, rotor_4=0.0))
    detection.detector.reset()
    np.testing.assert_array_equal(detection.detector.health, without(8, rotor_1=0.0))


@pytest.mark.parametrize(('vehicle', 'lost', 'stuck'), [
    ('octorotor', {'rotor_3': 0.0}, {}), ('x8', {'rotor_1': 0.5}, {}),
    ('hexarotor_tilting', {}, {2: 0.6})])
def test_what_is_announced_in_flight_names_nobody_and_is_given_back(vehicle, lost, stuck):
    case = Case.load(vehicle, [*REALISTIC, *SERVOS])
    detection, n = case.detection('exact'), case.vehicle.n
    reconfigure = partial(case.reconfiguration, 'exact')
    pairs = [x for pair in stuck.items() for x in pair] or None
    changes, seen = [], []
    for time, health, servos in ((2.0, without(n, **lost), pairs), (3.0, np.ones(n), None)):
        said = health, stuck if time < 3.0 else {}
        changes += [
            Change(round(time * 1e9), body=case.body(health, servos)),
            Change(round((time + 0.03) * 1e9), announced=said, reconfigure=reconfigure)]
    announce = detection.announce
    detection.announce = lambda *said: (announce(*said), seen.append(detection.detector.health))
    fly(case.controller(), case.allocator('exact'), case.plant(), UP, 4.0, changes=changes,
        detection=detection)
    assert detection.found == []
    assert set(detection.detector.evidence) == {''}
    np.testing.assert_array_equal(seen, [without(n, **lost), np.ones(n)])


@pytest.mark.parametrize('vehicle', ['hexarotor', 'x8'])
def test_wrong_models_and_gusts_are_no_failures(vehicle):
    case = Case.load(vehicle, [
        *REALISTIC[:-2], 'simulator.gust_intensity:=[2.0, 2.0, 2.0]', 'simulator.ground:=flat',
        'simulator.mass_factor:=1.1', 'simulator.thrust_factor:=0.9',
    ])
    points = [(1.5, 5, -5, 3, 3.0), (3.0, -2, 4, 1, 0.0), (4.5, 0, 0, 2, -2.0), (6.0, 0, 0, -1, 0)]
    detection = case.detection('exact')
    heavy = case.body()
    heavy.vehicle = replace(heavy.vehicle, mass=1.15 * heavy.vehicle.mass)
    changes = [Change(round(t * 1e9), waypoint=Waypoint.of(*where)) for t, *where in points]
    fly(case.controller(), case.allocator('exact'), case.plant(), UP, 9.0,
        changes=[*changes, Change(4_000_000_000, body=heavy)], detection=detection)
    assert detection.found == []


def test_a_vehicle_that_stands_shows_nothing():
    detector = FailureDetector(HEXAROTOR, SETTINGS)
    rng = np.random.default_rng(0)
    for i in range(500):
        noise = rng.standard_normal(6) * np.repeat([0.03, 0.02], 3)
        assert not detector.observe(i * 10_000_000, LEVEL, noise[:3], noise[3:])
        detector.command(i * 10_000_000, np.array([400.0, 40.0, 300.0, 40.0, 300.0, 300.0]))
    assert detector.standing
    assert detector.suspect is None


def test_ground_that_lets_go_is_no_failure():
    # It held the vehicle against a torque, for two seconds.
    case = Case.load('octorotor', [
        *REALISTIC[:8], 'simulator.ground:=flat', 'simulator.initial_position:=[0, 0, 0.3]'])
    plant, detector, y = case.plant(), case.detector(), case.vehicle.arms[:, 1]
    hover = case.vehicle.weight / case.vehicle.thrust_coefficient.sum()
    torque = 0.15 * np.sign(y.round(9))
    for i in range(330):
        thrust = 0.9 if i < 300 else 1.05
        speeds = (hover * (thrust - torque * (i > 80))) ** 0.5
        state, time = plant.measured, i * 10_000_000
        motion = velocity_in_body(state), state[ANGULAR_VELOCITY]
        assert not detector.observe(time, state[ATTITUDE], *motion), i
        detector.command(time, speeds)
        plant.step(speeds)
    assert not detector.standing
    assert abs(plant.state[ANGULAR_VELOCITY]).max() > 0.3


# Measured rotor speeds

def measured(detector, speeds, times=range(49, 52)):
    return [detector.measure(i * 10_000_000, np.array(speeds(i), float)) for i in times]


def commanded(speed=250.0):
    detector = FailureDetector(HEXAROTOR, SETTINGS)
    for i in range(50):
        detector.observe(i * 10_000_000, LEVEL, np.zeros(3), np.zeros(3))
        detector.command(i * 10_000_000, np.full(6, speed))
    return detector


def test_a_rotor_that_does_not_follow_its_command_is_seen_at_once():
    detector = commanded()
    assert measured(detector, lambda i: [250, 0, 250, 250, 250, 250]) == [False, False, True]
    np.testing.assert_array_equal(detector.health, without(6, rotor_2=0.0))
    assert detector.evidence[1] == 'rotor speed'


@pytest.mark.parametrize(('vehicle', 'n'), [('hexarotor', 6), ('x8', 8)])
def test_a_simulated_rotor_stops_and_its_measured_speed_shows_it(vehicle, n):
    case = Case.load(vehicle, [*REALISTIC, 'simulator.lost_rotors:=stop'])
    plant, detector = case.plant(), case.detector()
    hover = np.full(n, (case.vehicle.weight / case.vehicle.thrust_coefficient.sum()) ** 0.5)
    found = []
    for i in range(90):
        if i == 50:
            plant.body = case.body(without(n, rotor_1=0.0))
        state, time = plant.measured, i * 10_000_000
        detector.observe(time, state[ATTITUDE], velocity_in_body(state), state[ANGULAR_VELOCITY])
        detector.command(time, hover)
        if detector.measure(time, plant.speeds):
            found.append(i)
        plant.step(hover)
    assert found == [53]
    # What the motion showed before, and shows later, has this cause, too.
    assert detector.evidence[0] == 'rotor speed'
    np.testing.assert_array_equal(detector.health, without(n, rotor_1=0.0))


def test_motors_that_idle_without_commands_have_not_failed():
    detector = commanded()
    times = range(60, 80)
    assert not any(measured(detector, lambda i: [250, 40, 250, 250, 250, 40], times))


def test_motors_that_get_no_commands_have_not_failed():
    # The flight controller sends some, but all idle.
    detector = commanded()
    assert not any(measured(detector, lambda i: np.full(6, 40.0), range(49, 54)))
    assert measured(detector, lambda i: [40, 250, 250, 40, 250, 250]) == [False, False, True]
    np.testing.assert_array_equal(detector.health, without(6, rotor_1=0.0, rotor_4=0.0))


def test_a_rotor_that_speeds_up_slowly_has_not_failed():
    detector = commanded()
    assert not any(measured(detector, lambda i: np.full(6, 10.0 * i), range(25)))


def test_a_rotor_that_turns_too_slowly_has_lost_thrust():
    detector = commanded()
    measured(detector, lambda i: [250, 250, 250, 250 * 0.7, 250, 250])
    np.testing.assert_allclose(detector.health, without(6, rotor_4=0.49), atol=2e-3)


@pytest.mark.parametrize(('late', 'shift'), [(0, 0), (9, 0), (0, 5), (4, -3), (9, 5)])
def test_what_arrives_late_is_no_failure_and_a_stop_is_one(late, shift):
    # Two rotors change their speeds; commands reach the motors late by some steps of 10 ms, and
    # measurements arrive late, or before their state.
    detector, lag = FailureDetector(HEXAROTOR, SETTINGS), SETTINGS.motor_time_constant
    commands = 300.0 - 200.0 * ((np.arange(400)[:, None] % [60, 40, 400, 400, 400, 400]) < 20)
    speeds, turning = np.zeros(6), []
    for i in range(400):
        turning.append(speeds)
        if i > late:
            speeds = lagged(lag, speeds, commands[i - 1 - late], 0.01)
        if i >= 330:
            speeds = speeds * [1, 1, 1, 0, 1, 1]
    found = []
    for i in range(390):
        detector.observe(i * 10_000_000, LEVEL, np.zeros(3), np.zeros(3))
        detector.command(i * 10_000_000, commands[i])
        if i >= 5 and detector.measure((i - shift) * 10_000_000, turning[i - shift]):
            found.append(i - shift)
    assert found == [333]
    np.testing.assert_array_equal(detector.health, without(6, rotor_4=0.0))


@pytest.mark.parametrize('age', [0.05, 0.1, 0.159, 0.161, 0.5, 10.0])
def test_old_measurements_convict_nobody(age):
    # All rotors change their speeds all the time; the measurements are right, but old.
    each = both_engines(HEXAROTOR, SETTINGS)
    commands = 220.0 + 150.0 * np.sin(np.arange(2000)[:, None] / [7, 9, 11, 13, 17, 23])
    speeds, turning = np.zeros(6), []
    for i in range(2000):
        turning.append(speeds)
        speeds = lagged(SETTINGS.motor_time_constant, speeds, commands[max(i - 1, 0)], 0.01)
    late = round(age / 0.01)
    for i in range(2000):
        for detector in each:
            detector.observe(i * 10_000_000, LEVEL, np.zeros(3), np.zeros(3))
            detector.command(i * 10_000_000, commands[i])
            if i > late:
                time = round((0.01 * i - age) * 1e9)
                assert not detector.measure(time, turning[i - late]), i
    if age < 0.16:
        # They count: a rotor that stopped is found.
        times = [round((20.0 - age) * 1e9) + i for i in range(3)]
        stopped = turning[-1 - late] * [1, 1, 0, 1, 1, 1]
        for detector in each:
            assert [detector.measure(time, stopped) for time in times] == [False, False, True]


# Wrong numbers

REFUSED = np.nan, np.inf, -np.inf, 1.1e100, -1e300
WILD = (0.0, 5e-324, 1e-9, -1.0, 1e3, -1e5, 1e5, 1e9, -1e9, 1.1e9, 1e99, -1e100)
TIMES = (
    0, 1, -1, 10_000_000, -50_000_000, 400_000_000, 1_999_999_999, -2_000_000_000, 10**10, 10**18,
    2**62 - 1, -(2**62), 2**63 - 1, 2**63, 10**30)


def both_engines(vehicle, settings):
    """Return detectors in NumPy and, where it is built, in C."""
    found = [FailureDetector(vehicle, settings)]
    if module := extension('detector'):
        model = packed(found[0], module.FIELDS)
        found.append(KernelDetector(module, model, vehicle, settings))
    return found


def rows_of(flight):
    """Return stamps, and after each attitude, velocity, angular velocity and speeds."""
    parts = flight.attitude, flight.velocity, flight.angular_velocity, flight.speeds
    return [(round(1e9 * t), *row) for t, *row in zip(flight.time, *parts, strict=True)]


def drawn(rng, time, state, speeds, values):
    """Return the name of a method and arguments of which some are drawn from values."""
    name, share = rng.choice(['command', 'measure', 'observe']), rng.choice([0.1, 1.0])
    numbers = np.concatenate(state if name == 'observe' else [speeds])
    hit = rng.random(numbers.shape) < share
    numbers = np.where(hit, rng.choice(values, numbers.shape), numbers)
    parts = np.split(numbers, [4, 7]) if name == 'observe' else [numbers]
    return name, time, *parts


def answers(detectors, name, *arguments):
    """Return the one answer of all detectors, or the text of their one error."""
    found = []
    for detector in detectors:
        try:
            found.append(getattr(detector, name)(*arguments))
        except ValueError as error:
            found.append(str(error))
    assert all(each == found[0] for each in found), (name, arguments, found)
    return found[0]


def assert_equal(detectors):
    first, *others = detectors
    for other in others:
        for name in ('health', 'probabilities'):
            np.testing.assert_allclose(
                getattr(other, name), getattr(first, name), atol=1e-9, err_msg=name)
        for name in ('since', 'order', 'evidence', 'suspect', 'standing', 'testing'):
            assert getattr(other, name) == getattr(first, name), name


def replayed(case, rows):
    """Return both engines after rows of a flight, in each of which they were equal."""
    engines = both_engines(case.vehicle, case.flown.detector)
    for time, *state, speeds in rows:
        answers(engines, 'observe', time, *state)
        answers(engines, 'command', time, speeds)
        assert_equal(engines)
    return engines


@pytest.fixture(scope='module')
def long_flight():
    """Return a case, and a flight in which rotor 2 fails after 12 s."""
    case = Case.load('octorotor', REALISTIC)
    return case, rows_of(flown(case, {12.0: without(8, rotor_2=0.0)}, 12.3)[0])


@pytest.mark.parametrize('seed', length(range(4), range(100)))
@pytest.mark.filterwarnings('error')
def test_after_wrong_numbers_a_loss_is_found(long_flight, seed):
    case, rows = long_flight
    rng, both = np.random.default_rng(seed), both_engines(case.vehicle, case.flown.detector)
    start = int(rng.choice([0, 1_700_000_000_000_000_000]))
    for i, (time, *state, speeds) in enumerate(rows):
        answers(both, 'observe', start + time, *state)
        answers(both, 'command', start + time, speeds)
        if i == 60:
            for detector in both:
                detector.reset()
        for _ in range(rng.integers(1, 6) if i < 60 else 0):
            wrong = start + time + int(rng.choice(np.array(TIMES, object)))
            answers(both, *drawn(rng, wrong, state, speeds, [*REFUSED, *WILD]))
            answers(both, *drawn(rng, wrong, state, speeds, WILD))
            answers(both, *drawn(rng, start + time, state, speeds, WILD[:5]))
        assert_equal(both)
    assert 12.0 < (both[0].since[1] - start) / 1e9 < 12.2


@pytest.mark.parametrize('before', [1.4, 0.6, 0.25])
@pytest.mark.parametrize('start', ['new', 'gap', 'reset'])
def test_a_flight_that_is_met_in_mid_air_is_soon_tested(long_flight, start, before):
    # Rotor 2 fails some time after the start; the motors settle in 0.21 s.
    case, rows = long_flight
    both, begin, tested = both_engines(case.vehicle, case.flown.detector), 12.0 - before, []
    for time, *state, speeds in rows:
        if start == 'new' and time / 1e9 < begin:
            continue
        if start == 'gap' and begin - 0.6 < time / 1e9 < begin:
            continue
        answers(both, 'observe', time, *state)
        answers(both, 'command', time, speeds)
        if start == 'reset' and time == round(begin * 1e9):
            for detector in both:
                detector.reset()
        assert_equal(both)
        if time / 1e9 > begin and both[0].testing:
            tested.append(time / 1e9)
    # After a gap, what was learnt before still holds.
    first = begin + {'new': 0.21 + 0.295, 'gap': 0.21, 'reset': 0.295}[start]
    assert abs(tested[0] - first) < 0.025
    found = both[0].since[1]
    if first < 12.0 or start == 'gap':
        assert 12.0 < found / 1e9 < 12.2
    else:
        assert found is None or found / 1e9 >= tested[0]


@pytest.mark.parametrize('engine', [0, 1], ids=['numpy', 'c'])
def test_a_refused_number_enters_nothing(long_flight, engine):
    case, rows = long_flight
    rng = np.random.default_rng(engine)
    plain, asked = pair = [
        detector for _ in range(2)
        for detector in both_engines(case.vehicle, case.flown.detector)[engine : engine + 1]
    ] or pytest.skip('needs ca_ros.kernel._detector')
    for time, *state, speeds in rows[900:]:
        for detector in pair:
            detector.observe(time, *state)
            detector.command(time, speeds)
            detector.measure(time, np.where(np.arange(8) == 4, 0.0, speeds))
        name = rng.choice(['command', 'measure', 'observe'])
        parts = [part.copy() for part in (state if name == 'observe' else [speeds])]
        part = parts[rng.integers(len(parts))]
        part[rng.integers(len(part))] = rng.choice(REFUSED)
        with pytest.raises(ValueError, match='expected'):
            getattr(asked, name)(time, *parts)
        with pytest.raises(ValueError, match='a number of nanoseconds below'):
            asked.command(int(rng.choice(np.array([2**62, -(2**62), 10**30], object))), speeds)
        with pytest.raises(ValueError, match='a quaternion that is not zero'):
            asked.observe(time, np.zeros(4), *state[1:])
        with pytest.raises(ValueError, match='health'):
            asked.announce(np.full(8, rng.choice(REFUSED)))
        assert_equal(pair)
        np.testing.assert_array_equal(plain.probabilities, asked.probabilities)
    assert plain.since.count(None) < 8


def test_motors_turn_no_faster_than_their_bounds(long_flight):
    # A command beyond the bounds is the bound, to the last bit.
    case, rows = long_flight
    high, low = case.vehicle.speed_max, np.zeros(8)
    for pair in zip(*(both_engines(case.vehicle, case.flown.detector) for _ in range(2)),
                    strict=True):
        for i, (time, *state, speeds) in enumerate(rows[900:]):
            within = np.where(np.arange(8) == i % 8, high if i % 3 else low, speeds)
            beyond = np.where(np.arange(8) == i % 8, 1e5 if i % 3 else -1e99, speeds)
            for detector, command in zip(pair, (within, beyond), strict=True):
                detector.observe(time, *state)
                detector.command(time, command)
            np.testing.assert_array_equal(*(detector.probabilities for detector in pair))
            np.testing.assert_array_equal(*(detector.health for detector in pair))


def test_commands_of_the_future_keep_none_of_the_present_out(long_flight):
    case, rows = long_flight
    plain, flooded = (both_engines(case.vehicle, case.flown.detector) for _ in range(2))
    for i, (time, *state, speeds) in enumerate(rows[900:]):
        answers(plain + flooded, 'observe', time, *state)
        for later in range(1200 if i == 50 else 0):
            answers(flooded, 'command', time + 2_000_000_000 + later * 10_000_000, 0.5 * speeds)
        answers(plain + flooded, 'command', time, speeds)
        assert_equal(plain + flooded)
    assert plain[0].since[1] is not None


# The lag of the motors

CURVES = {
    'square': [],
    'quadratic': ['rotors.thrust_curve.polynomial:=[2.2e-5, 1.4e-3, -0.02]'],
    'table': [
        'rotors.thrust_curve.speeds:=[30, 100, 200, 300, 500]',
        'rotors.thrust_curve.thrusts:=[0.02, 0.27, 1.02, 2.3, 6.2]'],
}


@pytest.fixture(scope='module', params=CURVES)
def with_a_failure(request):
    """Return a case, and a flight in which rotor 2 loses its thrust and rotor 7 a part."""
    case = Case.load('octorotor', [*REALISTIC, *CURVES[request.param]])
    lost = {2.0: without(8, rotor_2=0.0), 2.4: without(8, rotor_2=0.0, rotor_7=0.2)}
    return case, flown(case, lost, 3.0)[0]


@pytest.mark.parametrize('source', ['motion', 'measured speeds'])
@pytest.mark.parametrize(('lag', 'delay', 'sums'), [
    (0.02, 0.01, '20 + 10 ms'), (0.05, 0.01, ''), (0.05, 0.05, '50 + 50 ms'), (0.04, 0.02, ''),
    (0.099, 0.01, '99 + 10 ms'),
])
def test_a_wrong_lag_or_delay_is_warned_of(with_a_failure, source, lag, delay, sums):
    # The motors have a lag of 50 ms and a delay of 10 ms.  Only their sum shows.
    case, flight = with_a_failure
    check = LagCheck(case.vehicle, replace(SETTINGS, motor_time_constant=lag, delay=delay))
    turning = np.zeros(8)
    # The first seconds after the ground do not count.
    hover = np.full((210, 8), flight.speeds[0].mean())
    sent = np.concatenate([hover, flight.speeds[:200]])
    omega = np.concatenate([np.zeros((210, 3)), flight.angular_velocity[:200]])
    for i, speeds in enumerate(sent):
        check.observe(i * 10_000_000, omega[i], np.ones(8))
        if source == 'measured speeds':
            check.measure(turning, np.ones(8))
        check.command(i * 10_000_000, speeds)
        turning = lagged(0.05, turning, sent[i - 1] if i else turning, 0.01)
    fault = 'lag and delay of the motors are about .. ms, but .* are '
    assert re.fullmatch(fault + re.escape(sums) if sums else '', check.fault), check.fault
    assert check.total == pytest.approx(0.06, abs=0.0101)


def test_a_longest_lag_that_is_the_least_wrong_is_no_estimate():
    # The vehicle turns as no command asked for: a launch by hand, a stream that is late.
    check, rng = LagCheck(HEXAROTOR, SETTINGS), np.random.default_rng(1)
    commands = 250.0 + 60.0 * np.cumsum(rng.standard_normal((900, 6)), axis=0) / 8.0
    rotors = CommandedRotors(HEXAROTOR, replace(SETTINGS, motor_time_constant=0.4))
    omega, inertia = np.zeros(3), HEXAROTOR.inertia
    for i, command in enumerate(np.clip(commands, 50.0, 400.0)):
        if i:
            given = rotors.given((i - 1) * 10_000_000, i * 10_000_000)[3:].sum(axis=1)
            omega = 0.98 * omega + 0.01 * np.linalg.solve(inertia, given)
        check.observe(i * 10_000_000, omega, np.ones(6))
        for each in (check, rotors):
            each.command(i * 10_000_000, command)
    assert check.total is None
    assert check.fault == ''


@pytest.mark.parametrize('damping', [0.0, 1.5])
def test_a_vehicle_that_air_damps_shows_its_lag(damping):
    check = LagCheck(HEXAROTOR, SETTINGS)
    rng, rotors = np.random.default_rng(2), CommandedRotors(HEXAROTOR, SETTINGS)
    wrenches, inertia = rotor_wrenches(HEXAROTOR)[3:], HEXAROTOR.inertia
    allocator = Exact(HEXAROTOR)
    omega, wanted = np.zeros(3), np.zeros(3)
    for i in range(1200):
        wanted = rng.normal(size=3) if i % 40 == 0 else wanted
        if i:
            torque = wrenches @ rotors.thrusts((i - 1) * 10_000_000, i * 10_000_000)
            turned = torque - damping * inertia @ omega - np.cross(omega, inertia @ omega)
            omega = omega + 0.01 * np.linalg.solve(inertia, turned)
        check.observe(i * 10_000_000, omega + 0.01 * rng.normal(size=3), np.ones(6))
        command = allocator.allocate([9.81, *6.0 * inertia @ (wanted - omega)]).speeds
        for each in (check, rotors):
            each.command(i * 10_000_000, command)
    assert check.total == pytest.approx(
        SETTINGS.motor_time_constant + SETTINGS.delay, abs=0.0051)
    assert check.fault == ''


def test_a_vehicle_at_rest_shows_no_lag():
    check, rng = LagCheck(HEXAROTOR, SETTINGS), np.random.default_rng(0)
    for i in range(500):
        check.observe(i * 10_000_000, 0.02 * rng.standard_normal(3), np.ones(6))
        check.command(i * 10_000_000, np.full(6, 250.0))
    assert check.total is None
    assert check.fault == ''


# The detector in C

def in_c(case, name='detector'):
    module = extension(name)
    if module is None:
        pytest.skip(f'needs ca_ros.kernel._{name}')
    reference = FailureDetector(case.vehicle, case.flown.detector)
    model = packed(reference, module.FIELDS)
    return reference, KernelDetector(module, model, case.vehicle, case.flown.detector)


def disturbed(flight, rng):
    """Return stamped states and commands of which some are late, repeated, dropped or wrong."""
    rows = [
        (round(1e9 * t), *row) for t, *row in zip(
            flight.time, flight.attitude, flight.velocity, flight.angular_velocity, flight.speeds,
            strict=True)
    ]
    for i in np.flatnonzero(rng.random(len(rows) - 1) < 0.05):
        rows[i], rows[i + 1] = rows[i + 1], rows[i]
    rows = [row for row in rows for _ in range(int(rng.choice([0, 1, 2], p=[0.03, 0.92, 0.05])))]
    rows[60] = (rows[60][0], rows[60][1], 50.0 * rng.standard_normal(3), *rows[60][3:])
    rows[90] = (rows[90][0] + 40_000_000_000, *rows[90][1:])
    # The clock steps, and a flight begins again.
    return [*rows, *((t - 20_000_000_000, *row) for t, *row in rows)]


@pytest.mark.parametrize('seed', length([0], [0, 1]))
def test_the_detector_in_c_is_that_in_numpy(with_a_failure, seed):
    case, flight = with_a_failure
    rng = np.random.default_rng(seed)
    both = in_c(case)
    found = 0
    for time, attitude, velocity, omega, speeds in disturbed(flight, rng):
        for each in both:
            each.command(time - 10_000_000, speeds)
        changed = {each.observe(time, attitude, velocity, omega) for each in both}
        if rng.random() < 0.1:
            # Rotor 5 is slow, and at times all are.
            turning = speeds * np.where(
                np.arange(8) == 4, rng.choice([1.0, 0.2], p=[0.3, 0.7]),
                rng.choice([1.0, 0.2], p=[0.9, 0.1]))
            changed = {*changed, *(each.measure(time, turning) for each in both)}
        reference, kernel = both
        for name in ('health', 'probabilities'):
            np.testing.assert_allclose(
                getattr(kernel, name), getattr(reference, name), atol=1e-9, err_msg=name)
        for name in ('since', 'order', 'evidence', 'suspect', 'standing', 'testing'):
            assert getattr(kernel, name) == getattr(reference, name), name
        found += True in changed
        if found == 2:
            for each in both:
                each.announce(without(8, rotor_1=0.3))
        if found == 4:
            for each in both:
                each.reset()
    assert found > 1


@pytest.mark.parametrize('seed', range(length(3, 30)))
def test_single_precision_finds_the_same(with_a_failure, seed):
    """Stamps are uneven: of even ones some end a window exactly where rounding decides it."""
    case, flight = with_a_failure
    rng = np.random.default_rng(seed)
    both = in_c(case, 'detector_single')[1], in_c(case)[1]
    for time, *state, speeds in disturbed(flight, rng):
        uneven = time + int(rng.integers(-400_000, 400_000))
        for each in both:
            each.command(uneven, speeds)
            each.observe(uneven, *state)
        single, double = both
        assert single.since == double.since
        np.testing.assert_allclose(single.health, double.health, atol=1e-4)
        np.testing.assert_allclose(single.probabilities, double.probabilities, atol=0.01)
    assert single.since[1] is not None


# The parts

def test_rotors_follow_commands_with_delay_and_lag():
    rotors = CommandedRotors(HEXAROTOR, replace(SETTINGS, delay=0.015))
    rotors.command(0, np.full(6, 100.0))
    rotors.command(10_000_000, np.full(6, 200.0))
    rotors.thrusts(0, 30_000_000)
    speeds = np.zeros(6)
    for command, time in ((0.0, 0.015), (100.0, 0.01), (200.0, 0.005)):
        speeds = lagged(0.05, speeds, np.full(6, command), time)
    np.testing.assert_allclose(rotors.speeds, speeds, rtol=1e-12)
    # At rest in the end: the thrust of the command.
    for i in range(3, 60):
        thrusts = rotors.thrusts(i * 10_000_000, (i + 1) * 10_000_000)
    np.testing.assert_allclose(thrusts, 2.5e-5 * 200.0**2, rtol=1e-3)


def test_rotors_that_tilt_are_where_their_servos_are():
    vehicle = Vehicle.load('hexarotor_tilting')
    settings = DetectorSettings(servo_time_constant=0.03, servo_rate=6.0, delay=0.01)
    rotors = CommandedRotors(vehicle, settings)
    rotors.command(0, np.repeat([250.0, 1.0], 6))
    rotors.thrusts(0, 10_000_000)
    np.testing.assert_allclose(rotors.wrenches, rotor_wrenches(vehicle), atol=1e-12)
    # At the greatest rate; in the middle of the step, half of the angle.
    rotors.thrusts(10_000_000, 20_000_000)
    np.testing.assert_allclose(
        rotors.wrenches, rotor_wrenches(vehicle, np.full(6, 0.03)), atol=1e-12)
    # In the end, where the command is.
    rotors.thrusts(20_000_000, 900_000_000)
    rotors.thrusts(900_000_000, 910_000_000)
    np.testing.assert_allclose(
        rotors.wrenches, rotor_wrenches(vehicle, np.full(6, 1.0)), atol=1e-6)


def windows(rng, spread=1.0, lost=0.0):
    """Return age, unexplained impulse, rotors', drag's and variance of one window of 0.16 s.

    Rotor 3 has lost a share of 1.6 N.
    """
    age = np.array([0.16])
    given = 1.6 * age * rotor_wrenches(HEXAROTOR)[None]
    variance = np.array([[0.001, 0.001, 0.001, 1e-6, 1e-6, 1e-6]])
    noise = spread * variance**0.5 * rng.standard_normal((1, 6))
    return age, noise - lost * given[:, :, 2], given, np.zeros((1, 2)), variance


def density(rest, variance):
    """Return the logarithm of a Gaussian density."""
    return norm.logpdf(rest, scale=variance**0.5).sum()


def test_the_evidence_is_a_ratio_of_gaussian_densities():
    find = HypothesisTest(HEXAROTOR, rotor_wrenches(HEXAROTOR))
    age, lacked, given, _, (variance,) = windows(np.random.default_rng(0), lost=0.6)
    lateral = np.array([[0.024, -0.012]])
    found = find(age, lacked, given, lateral, variance[None], *UNKNOWN)
    nothing = density(lacked[0], variance)
    levers = np.array([1.0, 1.0, 1.0, 0.4, 0.4, 0.4])
    wide = variance + (0.16 * HEXAROTOR.weight / 6.0 * levers) ** 2
    np.testing.assert_allclose(
        found.disturbance, density(lacked[0], wide) - nothing, rtol=1e-9)
    # Rotor 3 with half of its share of the drag, a force at its place.
    force = np.append(0.5 * lateral[0] / 6.0, 0.0)
    drag = np.concatenate([force, np.cross(HEXAROTOR.arms[2], force)])
    signature = given[0, :, 2] + drag
    error = (0.16 * 0.16 * np.array([1.0, 1.0, 1.0, 0.4, 0.4, 0.04])) ** 2 + drag**2
    weights = (variance + error) ** -1
    first = -(weights * signature) @ lacked[0] / (weights @ signature**2)
    wide = variance + first**2 * error
    information = (signature / wide) @ signature
    share = -(signature / wide) @ lacked[0] / information
    ratio = density(lacked[0] + share * signature, wide) - nothing
    np.testing.assert_allclose(
        found.evidence[2], ratio - 0.5 * np.log(information / 6.25), rtol=1e-9)
    assert found.named == (2,)
    np.testing.assert_allclose(found.lost, share, rtol=1e-9)
    np.testing.assert_allclose(found.errors[2], (weights @ signature**2) ** -0.5, rtol=1e-6)


def test_what_has_failed_in_named_arms_is_a_ratio_of_gaussian_densities():
    rng, vehicle = np.random.default_rng(2), Vehicle.load('x8')
    wrenches, arms, lost = rotor_wrenches(vehicle), [(0, 1), (4, 5)], np.array([0.5, 0.4])
    find = HypothesisTest(vehicle, wrenches)
    given = 2.0 * 0.16 * wrenches[None] * rng.uniform(0.8, 1.2, 8)
    variance, lateral = rng.uniform(0.5, 2.0, (1, 6)) * 1e-3, np.zeros((1, 2))
    signature, error = (each[0] for each in find.signatures(given, lateral))
    for _ in range(20):
        lacked = 0.05 * rng.standard_normal((1, 6))
        wide = variance[0] + 4.0 * (lost**2 * error[:, [0, 4]]).sum(axis=1)
        each = np.array([[density(
            lacked[0] + sum(sign * share * (signature[:, i] - signature[:, j])
                            for sign, share, (i, j) in zip(signs, lost, arms, strict=True)), wide)
            for signs in ((one, 1.0), (one, -1.0))] for one in (1.0, -1.0)])
        evidence = find.of_arms(lacked, given, lateral, variance, arms, lost)
        np.testing.assert_allclose(
            evidence, [each[0].max() - each[1].max(), each[:, 0].max() - each[:, 1].max()],
            atol=1e-9)


@pytest.mark.parametrize(('usual', 'asked', 'failed', 'named'), [
    (1.0, 0.7, False, False), (1.0, 0.8, False, True), (0.8, 0.7, False, True),
    (2.0, 0.8, False, True), (0.1, 0.3, False, False), (0.1, 0.4, False, True),
    (0.3, 2.0, True, False), (0.4, 0.4, True, True)])
def test_a_rotor_that_is_named_is_asked_for_its_usual_thrust(usual, asked, failed, named):
    # Over that of hover; three quarters of it are enough.  After a failure, others may idle.
    find, hover = HypothesisTest(HEXAROTOR, rotor_wrenches(HEXAROTOR)), HEXAROTOR.weight / 6.0
    age, _, given, lateral, variance = windows(np.random.default_rng(0))
    given[:, :, 2] *= asked * hover / 1.6
    health = np.where(np.arange(6) == 5, 0.0 if failed else 1.0, 1.0)
    found = find(age, -given[:, :, 2], given, lateral, variance, health, UNKNOWN[1],
                 np.full(6, usual * hover), *UNKNOWN[3:])
    assert found.rotor == 2
    assert found.named == ((2,) if named else ())


@pytest.mark.parametrize(('names', 'confirmed'), [
    ([(2,), (2,), (2,)], True), ([(2,), (), (2,), (), (2,)], True), ([(2,), (2,), ()], False),
    ([(2,), (2,), (3,), (2,)], False)])
def test_a_name_is_confirmed_by_three_tests_that_name_nobody_else(names, confirmed):
    suspicion, find = Suspicion(6), HypothesisTest(HEXAROTOR, rotor_wrenches(HEXAROTOR))
    found = find(*windows(np.random.default_rng(0)), *UNKNOWN)
    last = [suspicion.confirms(replace(found, named=each)) for each in names][-1]
    assert last is confirmed


@pytest.mark.parametrize(('peak', 'most'), [(2.4, 0.5), (1.92, 0.2), (1.0, 0.0)])
def test_a_rotor_may_give_at_most_what_it_gave_of_late(peak, most):
    # Rotor 3 is commanded 1.6 N and gives half as much again.
    find, health = HypothesisTest(HEXAROTOR, rotor_wrenches(HEXAROTOR)), np.ones(6)
    age, lacked, given, lateral, (variance,) = windows(
        np.random.default_rng(0), spread=0.0, lost=-0.5)
    push = find(age, lacked, given, lateral, variance[None], *UNKNOWN).disturbance
    found = find(
        age, lacked, given, lateral, variance[None], health, peak * health, *UNKNOWN[2:])
    assert found.named == ()
    own = given[0, :, 2]
    error = (0.16 * 0.16 * np.array([1.0, 1.0, 1.0, 0.4, 0.4, 0.04])) ** 2
    wide = variance + most**2 * error
    ratio = density(lacked[0] - most * own, wide) - density(lacked[0], variance)
    excess = ratio - 0.5 * np.log((own / wide) @ own / 6.25) + 1.0
    expected = max(push, excess) if most else push
    assert most < 0.5 or excess > push
    np.testing.assert_allclose(found.disturbance, expected, rtol=1e-9)


def test_an_error_of_the_lag_is_common_to_all_rotors():
    usual = UsualMotion(HEXAROTOR, DetectorSettings(motor_time_constant=0.05, delay=0.01))
    change = np.zeros((1, 6, 6))
    change[0, 3] = [1.0, 1.0, 1.0, -1.0, -1.0, 2.0]  # roll [N m]
    errors = usual.model_errors(np.array([0.1]), np.zeros((1, 6, 6)), change)
    # 10 ms of each of six rotors, and a quarter of 60 ms of their sum of 3 N m
    np.testing.assert_allclose(errors[0, 3], 0.01**2 * 9.0 + 0.015**2 * 3.0**2)
    assert not errors[0, [0, 1, 2, 4, 5]].any()


@pytest.mark.parametrize('drag_lost', [0.0, 1.0])
def test_a_weak_rotor_may_keep_its_drag_or_lose_it(drag_lost):
    # In wind the drag of rotor 3 gives more yaw than its thrust, and yaw is known best.
    find, rng = HypothesisTest(HEXAROTOR, rotor_wrenches(HEXAROTOR)), np.random.default_rng(0)
    lateral, shares = np.array([[0.0, 0.48]]), []
    for _ in range(50):
        age, lacked, given, _, variance = windows(rng, lost=0.6)
        variance[0, 5] *= 0.01
        force = np.append(lateral[0] / 6.0, 0.0)
        drag = np.concatenate([force, np.cross(HEXAROTOR.arms[2], force)])
        found = find(age, lacked - 0.6 * drag_lost * drag, given, lateral, variance, *UNKNOWN)
        assert found.named == (2,)
        shares.append(found.shares[2])
    assert np.mean(shares) == pytest.approx(0.6, abs=0.05)


@pytest.mark.parametrize('kind', ['push', 'foot', 'loss'])
def test_pushes_and_feet_are_disturbances(kind):
    # A foot at rotor 4 turns the vehicle as the loss of rotor 1 does, and lifts it.
    wrenches = rotor_wrenches(HEXAROTOR)
    find = HypothesisTest(HEXAROTOR, wrenches)
    rng = np.random.default_rng(0)
    for _ in range(100):
        age, lacked, given, lateral, variance = windows(rng)
        force = rng.standard_normal(3)
        force *= 3.0 / np.linalg.norm(force)
        impulse = {
            'push': np.concatenate([force, np.cross([*rng.uniform(-0.4, 0.4, 2), 0.0], force)]),
            'foot': 1.6 * wrenches[:, 3] * [0, 0, 1, 1, 1, 0], 'loss': -1.6 * wrenches[:, 0],
        }[kind]
        found = find(age, lacked + age[0] * impulse, given, lateral, variance, *UNKNOWN)
        assert found.named == ((0,) if kind == 'loss' else ())
        assert kind == 'loss' or found.disturbance > max(20.0, found.evidence.max())


@pytest.mark.parametrize('known', [True, False])
def test_a_rotor_that_would_lack_more_than_it_has_is_named_later(known):
    # A push of 1.75 times its thrust, later one that looks like its loss; or soon after take-off.
    find, rng = HypothesisTest(HEXAROTOR, rotor_wrenches(HEXAROTOR)), np.random.default_rng(0)
    age, lacked, given, lateral, variance = windows(rng, lost=1.75)
    pushed = find(age, lacked, given, lateral, variance, *UNKNOWN, known=known)
    assert pushed.named == ()
    assert pushed.disturbance > pushed.evidence[2] + 3.0 > 23.0
    assert pushed.leads[2] == (-30.0 if known else 0.0)
    age, lacked, given, lateral, variance = windows(rng, lost=1.0)
    leads, names = pushed.leads, []
    for _ in range(200):
        found = find(
            age, lacked, given, lateral, variance, *UNKNOWN[:3], leads, 0.01, known=known)
        leads = found.leads
        names.append(found.named)
    assert names[-1] == (2,)
    assert (names.index((2,)) > 20) == known


def test_soon_after_a_loss_only_its_own_arm_gathers_a_lead():
    # Rotor 1 of x8 has failed, and its partner is rotor 2; what others owe, they pay back.
    before, zero = np.array([1.0, 1.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(8)
    partners = Vehicle.load('x8').partners
    later = [gathered(before, 0.16, rotor * 18.0, zero, 0.0, partners, [0]) for rotor in np.eye(8)]
    np.testing.assert_array_equal(np.diag(later), [19.0, 19.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert later[2][3] == -1.0
    assert gathered(before, 0.16, 18.0 * np.eye(8)[2], zero, 0.0, partners)[2] == 19.0


def test_what_a_rotor_owes_goes_with_the_lead_of_a_disturbance_over_it():
    # The evidence for a disturbance is 50.  Its lead over rotor 1 is too small; rotors 2 and 3
    # owe, and rotor 3 more, which would lack 1.3 of itself; the evidence for rotor 4 is not clear.
    evidence, shares = np.array([45.0, 43.0, 43.0, 19.0]), np.array([1.3, 1.0, 1.3, 1.3])
    for before, after in ((2.0, [2.0, -8.0, -30.0, 2.0]), (-9.0, [-9.0, -9.0, -30.0, -9.0])):
        found = owed(np.full(4, before), shares, np.ones(4), evidence, 50.0)
        np.testing.assert_array_equal(found, after)


def test_no_rotor_owes_anything_once_a_suspicion_lasts_for_longer_than_a_push():
    suspicion = Suspicion(2)
    suspicion.leads = np.array([-8.0, 3.0])
    for waited, after in ((0.0, [-8.0, 3.0]), (0.98, [-8.0, 3.0]), (1.0, [0.0, 3.0])):
        suspicion.waited = waited
        np.testing.assert_array_equal(suspicion.patient_leads, after)


def test_a_rotor_that_a_disturbance_leads_far_is_named_later():
    # A push that looks like its loss, but first turns the vehicle about z, too.
    find, rng = HypothesisTest(HEXAROTOR, rotor_wrenches(HEXAROTOR)), np.random.default_rng(0)
    age, lacked, given, lateral, variance = windows(rng, lost=0.8)
    lacked[0, 5] += 0.04
    for before, least in ((0.0, -8.0), (-8.0, -8.0), (-15.0, -15.0)):
        leads = np.array([0.0, 0.0, before, 0.0, 0.0, 0.0])
        pushed = find(age, lacked, given, lateral, variance, *UNKNOWN[:3], leads, 0.01)
        assert pushed.named == ()
        assert pushed.disturbance - 20.0 > pushed.evidence[2] > 20.0
        assert pushed.leads[2] == least
    age, lacked, given, lateral, variance = windows(rng, lost=0.8)
    leads[2] = -0.5
    assert find(age, lacked, given, lateral, variance, *UNKNOWN[:3], leads, 0.01).named == ()
    assert find(age, lacked, given, lateral, variance, *UNKNOWN).named == (2,)


def test_an_arm_is_named_for_a_weak_rotor_whose_partner_owes_a_lead():
    vehicle = Vehicle.load('x8')
    wrenches = rotor_wrenches(vehicle)
    find, given = HypothesisTest(vehicle, wrenches), 2.0 * 0.16 * wrenches[None]
    variance = np.array([[1e-3, 1e-3, 1e-3, 1e-6, 1e-6, 0.01]])
    found = find(
        np.array([0.16]), -0.33 * given[:, :, 0], given, np.zeros((1, 2)), variance, np.ones(8),
        np.zeros(8), np.full(8, 9.0), np.array([4.0, -8.0, *np.zeros(6)]), 0.01)
    assert found.lasting
    assert (found.named, found.arms) == ((0, 1), ((0, 1),))


def test_the_score_of_a_servo_is_the_reduction_of_chi_square_at_its_angle():
    servos, rng = Vehicle.load('hexarotor_tilting').servos, np.random.default_rng(0)
    lacked, given = rng.standard_normal((2, 6)), rng.standard_normal((2, 6, 18))
    weights, health = rng.uniform(0.5, 2.0, (2, 6)), rng.uniform(0.5, 1.0, 6)
    # In the second window servo 4 sticks at 0.5 rad.
    rotor = given[1, :, [3, 9, 15]]
    lacked[1] = 10.0 * lacked[1] * 1e-3 + health[3] * (
        np.cos(0.5) * rotor[1] + np.sin(0.5) * rotor[2] - rotor[0])
    scores, likeliest = stuck_servos(servos, lacked, weights, given, health)
    assert (likeliest.rotor, likeliest.window) == (3, 1)
    assert likeliest.angle == pytest.approx(0.5, abs=0.05)
    assert scores.argmax() == 3
    moved = np.cos(likeliest.angle) * rotor[1] + np.sin(likeliest.angle) * rotor[2] - rotor[0]
    rest = lacked[1] - health[3] * moved
    np.testing.assert_allclose(
        likeliest.evidence, 0.5 * weights[1] @ (lacked[1] ** 2 - rest**2) - np.log(101),
        rtol=1e-9)
    np.testing.assert_allclose(
        likeliest.share, np.linalg.norm(moved[:3]) / np.linalg.norm((moved + rotor[0])[:3]))


def test_noise_names_nobody():
    find, rng = HypothesisTest(HEXAROTOR, rotor_wrenches(HEXAROTOR)), np.random.default_rng(1)
    found = [find(*windows(rng), *UNKNOWN) for _ in range(2000)]
    assert {each.named for each in found} == {()}
    # By Bayes' rule evidence of x is as rare as exp(-x).
    assert np.mean([each.disturbance > 1.0 for each in found]) < 0.37


def test_two_rotors_are_named_but_opposite_ones_which_may_be_a_load():
    wrenches = rotor_wrenches(HEXAROTOR)
    find = HypothesisTest(HEXAROTOR, wrenches)
    age, _, given, lateral, variance = windows(np.random.default_rng(0))
    # Rotor 2 alone, between 1 and 3, explains the torque of both.
    for second, named in ((1, (0, 1)), (2, (0, 2)), (3, ())):
        lacked = -1.6 * 0.16 * (0.9 * wrenches[:, 0] + 0.9 * wrenches[:, second])
        found = find(age, lacked[None], given, lateral, variance, *UNKNOWN)
        assert found.named == named
        if named:
            # The margin is that of the pair, not that of the likeliest of its rotors.
            assert found.margin > ODDS
            assert found.margin > found.evidence.max() - found.disturbance + ODDS


@pytest.mark.parametrize(('yaw', 'lost', 'named', 'arms'), [
    (1e-3, (0, 3), (0, 3), ()), (0.1, (0, 3), (0, 1, 2, 3), ((0, 1), (2, 3))),
    (1e-3, (0, 2), (0, 1, 2, 3), ((0, 1), (2, 3))), (1e-3, (0, 1), (0, 1), ())])
def test_two_rotors_of_coaxial_pairs_are_named_by_their_arms(yaw, lost, named, arms):
    # Yaw, if it is known well enough, tells rotors 1 and 4 from 2 and 3, but not 1 and 3 from
    # 2 and 4.
    vehicle = Vehicle.load('x8')
    wrenches = rotor_wrenches(vehicle)
    find, given = HypothesisTest(vehicle, wrenches), 2.0 * 0.16 * wrenches[None]
    variance = np.array([[0.001, 0.001, 0.001, 1e-6, 1e-6, yaw**2]])
    found = find(
        np.array([0.16]), -0.9 * given[:, :, lost].sum(axis=2), given, np.zeros((1, 2)),
        variance, np.ones(8), np.zeros(8), np.full(8, 9.0), np.zeros(8), 0.01)
    assert (found.named, found.arms) == (named, arms)
    np.testing.assert_allclose(found.lost, 0.45 if arms else 0.9, atol=0.05)
