"""Integral action: constant errors vanish, and a saturated step does not wind it up."""

from functools import partial
from math import exp

import numpy as np
import pytest

from ca_ros import audit
from ca_ros.__main__ import main
from ca_ros.control.momentum_observer import MomentumObserver
from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.closed_loop import Change, fly
from ca_ros.simulation.rigid_body import velocity_in_body
from ca_ros.studies.cases import Case
from ca_ros.vehicle.files import config_directory
from strategies import HEXAROTOR, length

WAYPOINT = Waypoint.of(1.0, 1.0, 1.0, np.pi / 4)

# Force over m k_p = 1.5 N/m.
ERRORS = {
    'wind of 0.9 N': (['simulator.linear_drag:=0.3', 'simulator.wind:=[3.0, 0.0, 0.0]'], 0.6),
    'k_f 10 % low': (['simulator.thrust_factor:=0.9'], (1.0 / 0.9 - 1.0) * 9.81 / 1.5),
    'mass 10 % high': (['simulator.mass_factor:=1.1'], 0.1 * 9.81 / 1.5),
    'k_f of each rotor': (['simulator.thrust_factor:=[0.95, 1.0, 1.03, 0.97, 1.0, 1.02]'], 0.13),
}


def case(gain, *changes):
    return Case.load('hexarotor', [*changes, f'controller.integral_gain:={gain}'])


def flown(case, waypoint=WAYPOINT, duration=20.0, changes=()):
    return fly(case.controller(), case.allocator('exact'), case.plant(), waypoint, duration,
               changes=changes)


@pytest.mark.slow
@pytest.mark.parametrize('error', length(['wind of 0.9 N', 'k_f of each rotor'], ERRORS))
def test_constant_errors_vanish(error):
    changes, offset = ERRORS[error]
    without = flown(case(0.0, *changes), duration=8.0)
    assert without.position_error(WAYPOINT) == pytest.approx(offset, rel=0.03)
    assert flown(case(1.0, *changes), duration=14.0).position_error(WAYPOINT) < 0.001


@pytest.mark.slow
def test_the_audit_says_how_far_a_side_force_keeps_the_vehicle_from_its_waypoint(tmp_path, capsys):
    # Rotors 1 and 2 lean forward by 12 degrees.
    axes = np.tile([0.0, 0.0, 1.0], (6, 1))
    axes[:2] = np.sin(np.radians(12.0)), 0.0, np.cos(np.radians(12.0))
    tilted = f'rotors.axes:={axes.ravel().tolist()}'
    force = audit(case(0.0, tilted).vehicle).side_force
    assert force[0] > 0.6
    assert force[1] == 0.0
    left = WAYPOINT.position - flown(case(0.0, tilted)).position[-1]
    assert np.hypot(*left[:2]) == pytest.approx(force[0] / 1.5, rel=0.01)
    assert flown(case(1.0, tilted)).position_error(WAYPOINT) < 0.001
    text = (config_directory() / 'hexarotor.yaml').read_text()
    file = tmp_path / 'tilted.yaml'
    for gain, follows in (
        ('', 'without controller.integral_gain the vehicle hovers up to 0.43 m beside'),
        ('\n      integral_gain: 0.5', 'controller.integral_gain 0.5 1/s compensates it'),
    ):
        words = text.replace('      positions:', f'      axes: {axes.ravel().tolist()}\n'
                             '      positions:').replace('controller:', f'controller:{gain}')
        file.write_text(words)
        assert main(['audit', str(file)]) == 0
        line = f'hover leaves a side force of {force[0]:.3g} N (x {force[0]:+.3g}, y +0): '
        assert line + follows in capsys.readouterr().out


@pytest.mark.slow
def test_a_wrong_torque_coefficient_does_not_turn_the_vehicle():
    # One rotor with 80 % of its reaction torque: 0.2 * 0.02 m * m g / 6 over J k = 0.12 N m.
    wrong = 'simulator.torque_factor:=[0.8, 1.0, 1.0, 1.0, 1.0, 1.0]'
    without = flown(case(0.0, wrong), duration=8.0).heading_error(WAYPOINT)
    assert without == pytest.approx(0.2 * 0.02 * 9.81 / 6.0 / 0.12, rel=0.05)
    assert flown(case(1.0, wrong), duration=16.0).heading_error(WAYPOINT) < 1e-5


@pytest.mark.slow
def test_a_sound_model_flies_as_without_integral_action():
    # Euler's steps are those that the observer expects, so it sees no disturbance.
    far = Waypoint.of(8.0, -6.0, 4.0, np.radians(170.0))
    with_it, without = (flown(case(gain), far, 8.0) for gain in (1.0, 0.0))
    np.testing.assert_allclose(with_it.position, without.position, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize('mass', length([1.0], [0.9, 1.0, 1.1]))
def test_a_step_that_saturates_does_not_wind_up(mass):
    # A climb of 20 m with a load that leaves little thrust: 24 N of 19.6 N, for two seconds and
    # more at full speed.  Without integral action and mismatch nothing is overshot.
    loop = case(
        1.0, 'vehicle.mass:=2.0', 'controller.speed_max:=20', f'simulator.mass_factor:={mass}')
    there = Waypoint.of(0.0, 0.0, 20.0, 0.0)

    flight = flown(loop, there, 16.0)
    assert np.sum(np.all(flight.speeds > 399.9, axis=1)) > 180
    assert flight.position_error(there) < 0.005
    assert flight.position[:, 2].max() < 20.02


@pytest.mark.slow
def test_the_controller_continues_after_an_announcement():
    # A tenth of the thrust of a rotor is lost and announced: the estimate of the wind stays.
    windy = case(1.0, *ERRORS['wind of 0.9 N'][0])
    health = [0.9, 1.0, 1.0, 1.0, 1.0, 1.0]
    told = Change(12_000_000_000, windy.body(health), announced=(health, {}),
                  reconfigure=partial(windy.reconfiguration, 'exact'))
    flight = flown(windy, duration=14.0, changes=[told])
    assert np.abs(flight.position[1200:] - WAYPOINT.position).max() < 0.02


# The observer alone

VELOCITY, OMEGA = np.array([0.3, 0.2, -0.1]), np.array([0.1, -0.2, 0.3])
HOVER = np.array([0.0, 0.0, 9.81, 0.0, 0.0, 0.0])


def moving(velocity, omega=(0.0, 0.0, 0.0)):
    """Return a motion (6,)."""
    return np.concatenate([velocity, omega])


def observed(gain, steps, step_ns, disturbance=(0.5, 0.0, 0.0), observer=None, start=0):
    """Observe a vehicle at hover whose velocity a disturbance [N] changes."""
    observer = observer or MomentumObserver(HEXAROTOR, gain)
    velocity = VELOCITY.copy()
    # It stands until it has moved for a while.
    observer.observe(start - 400_000_000, moving(velocity))
    for i in range(steps + 1):
        observer.observe(start + i * step_ns, moving(velocity))
        observer.expect(HOVER, np.zeros(3))
        velocity = velocity + step_ns / 1e9 * np.array(disturbance)
    return observer


def test_the_estimate_approaches_the_disturbance_exponentially():
    # With small steps: 1 - exp(-L t) at L = 2 1/s, t = 0.5 s.
    found = observed(2.0, 5000, 100_000).estimate
    np.testing.assert_allclose(found, [0.5 * (1.0 - exp(-1.0)), 0, 0, 0, 0, 0], atol=1e-4)


def test_a_torque_is_estimated_in_the_body_frame():
    # J domega/dt = d - omega x J omega, from the rates of a rigid body that spins.
    observer, omega = MomentumObserver(HEXAROTOR, 1.0), OMEGA.copy()
    observer.observe(-400_000_000, moving(np.ones(3), omega))
    torque, inertia = np.array([0.01, -0.02, 0.005]), HEXAROTOR.inertia
    for i in range(1000):
        observer.observe(i * 10_000_000, moving(np.zeros(3), omega))
        observer.expect(HOVER, omega)
        omega = omega + 0.01 * np.linalg.solve(
            inertia, torque - np.cross(omega, inertia @ omega) - 1e-3 * observer.estimate[3:])
    np.testing.assert_allclose(observer.estimate[3:] * 1.001, torque, rtol=1e-3)


def test_a_vehicle_that_has_not_started_has_no_estimate():
    # Noise of 0.02 m/s and rad/s, a waypoint, and motors that do not run yet.
    loop = case(1.0)
    controller, rng = loop.controller(), np.random.default_rng(0)
    level = np.array([0.0, 0.0, 0.0, 1.0])
    for i in range(2000):
        noise = 0.02 * rng.standard_normal(6)
        controller.wrench(np.zeros(3), level, noise[:3], noise[3:], WAYPOINT, i * 10_000_000)
    np.testing.assert_array_equal(controller.disturbances.estimate, 0.0)


def test_a_repeated_or_late_state_changes_nothing():
    observer = observed(1.0, 100, 10_000_000)
    before = observer.estimate.copy()
    assert before[0] > 0.3
    for late in (0, 10_000_000, 1_000_000_000):
        observer.observe(1_000_000_000 - late, moving(5.0 * VELOCITY, OMEGA))
        np.testing.assert_array_equal(observer.estimate, before)
    assert observer.time == 1_000_000_000


@pytest.mark.parametrize('step', [-10_000_000_000, 10_000_000_000])
def test_a_step_of_seconds_counts_once_the_next_state_confirms_it(step):
    observer = observed(1.0, 100, 10_000_000)
    before, last = observer.estimate.copy(), 1_000_000_000
    velocity = VELOCITY + np.array([0.5, 0.0, 0.0])
    for time in (last + step, last + 10_000_000, last + 20_000_000 + step):
        observer.observe(time, moving(velocity))
        assert np.abs(observer.estimate - before).max() < 0.02
    assert observer.time == last + 10_000_000
    observer.observe(last + 30_000_000 + step, moving(velocity))
    assert observer.time == last + 30_000_000 + step
    # Backwards another flight begins, forwards the same one continues.
    assert observer.standing == (step < 0)
    np.testing.assert_allclose(observer.estimate, 0.0 if step < 0 else before, atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize('height', length([-0.5], [-0.5, 1.0]))
def test_a_vehicle_that_has_landed_keeps_the_estimate_of_its_flight(height):
    # In the air with k_f 10 % low, landing on z = 0, then motors off for 8 s while the waypoint
    # stays below or above the ground.
    loop = case(1.0, 'simulator.thrust_factor:=0.9', 'simulator.ground:=flat')
    plant, controller, allocator = loop.plant(), loop.controller(), loop.allocator('exact')

    def fly_on(seconds, goal, start, running=1.0):
        for i in range(int(seconds * 100)):
            state = plant.measured
            plant.step(running * allocator.allocate(controller.wrench(
                state[:3], state[6:10], velocity_in_body(state), state[10:],
                Waypoint.of(0.0, 0.0, goal, 0.0), round(start * 1e9) + i * plant.time_step_ns,
            )).speeds)

    fly_on(10.0, 1.0, 0.0)
    flown = controller.disturbances.estimate.copy()
    assert flown[2] == pytest.approx(-0.1 * 9.81, rel=0.15)
    fly_on(3.0, -1.0, 10.0)
    assert plant.state[2] == 0.0
    fly_on(8.0, height, 13.0, running=0.0)
    assert abs(controller.disturbances.estimate[2] - flown[2]) < 0.1 * 9.81
    assert controller.disturbances.standing
    fly_on(8.0, 1.0, 21.0)
    assert abs(plant.state[2] - 1.0) < 0.005


@pytest.mark.parametrize('velocity', [1e12, -50.0, np.inf])
def test_a_corrupted_state_leaves_the_estimate(velocity):
    observer = observed(1.0, 1000, 10_000_000)
    before = observer.estimate.copy()
    with np.errstate(invalid='ignore'):
        observer.observe(10_010_000_000, moving([0.0, velocity, 0.0]))
    observer.expect(HOVER, np.zeros(3))
    np.testing.assert_array_equal(observer.estimate, before)
    observed(1.0, 100, 10_000_000, observer=observer, start=10_020_000_000)
    np.testing.assert_allclose(observer.estimate, [0.5, 0, 0, 0, 0, 0], atol=1e-3)


def test_the_integral_action_needs_the_time():
    controller = case(1.0).controller()
    state = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), np.zeros(3)
    with pytest.raises(ValueError, match='time: missing'):
        controller.wrench(*state, WAYPOINT)
