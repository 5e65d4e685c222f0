"""Rigid-body dynamics against laws, closed forms and an independent integrator."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ca_ros.simulation.drag import Drag
from ca_ros.simulation.rigid_body import RigidBody, velocity_in_body
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.state import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    NULL_STATE,
    POSITION,
    VELOCITY,
    euler_angles,
    rotation_matrix,
)
from strategies import FLEET, HEXAROTOR, build, ring, tilted_axes

LOPSIDED = build(
    ring(6), 'PNPNPN',
    {'vehicle.mass': 1.7, 'vehicle.center_of_mass': [0.03, -0.02, 0.01], 'vehicle.inertia': [
        0.020, 0.002, -0.001, 0.002, 0.030, 0.003, -0.001, 0.003, 0.040]},
    axes=np.ravel(tilted_axes(6, 0.2)).tolist())
SPEEDS = np.array([330.0, 300.0, 310.0, 345.0, 320.0, 290.0])
STATE = np.concatenate([
    [1.0, -2.0, 3.0], [0.5, 1.0, -0.5],
    Rotation.from_euler('XYZ', [0.3, -0.4, 1.0]).as_quat(), [0.4, -0.3, 0.8]])

triples = st.tuples(*[st.floats(-10.0, 10.0)] * 3).map(np.array)


def at(angular_velocity):
    state = NULL_STATE.copy()
    state[ANGULAR_VELOCITY] = angular_velocity
    return state


def flown(body, state, speeds, duration, steps):
    for _ in range(steps):
        state = body.step(state, speeds, duration / steps)
    return state


def reference(vehicle, state, speeds, duration):
    """Integrate Newton's and Euler's equations with the attitude as a rotation matrix."""
    force, torque = np.split(rotor_wrenches(vehicle) @ (vehicle.thrust_coefficient * speeds**2), 2)

    def rates(_, y):
        velocity, rotation, omega = y[3:6], y[6:15].reshape(3, 3), y[15:]
        p, q, r = omega
        skew = np.array([[0.0, -r, q], [r, 0.0, -p], [-q, p, 0.0]])
        acceleration = rotation @ force / vehicle.mass - [0.0, 0.0, vehicle.gravity]
        spin = np.linalg.solve(vehicle.inertia, torque - skew @ vehicle.inertia @ omega)
        return np.concatenate([velocity, acceleration, (rotation @ skew).ravel(), spin])

    rotation = Rotation.from_quat(state[ATTITUDE]).as_matrix()
    start = np.concatenate([state[:6], rotation.ravel(), state[ANGULAR_VELOCITY]])
    y = solve_ivp(rates, (0.0, duration), start, method='DOP853', rtol=1e-12, atol=1e-12).y[:, -1]
    quaternion = Rotation.from_matrix(y[6:15].reshape(3, 3)).as_quat()
    return np.concatenate([y[:6], quaternion * np.sign(quaternion[3]), y[15:]])


def test_euler_angles_are_those_of_scipy():
    turns = Rotation.random(1000, rng=0)
    np.testing.assert_allclose(
        euler_angles(turns.as_quat()), turns.as_euler('XYZ'), rtol=0.0, atol=1e-13)
    upright = Rotation.from_euler('XYZ', [0.4, np.pi / 2, 0.2])
    found = Rotation.from_euler('XYZ', euler_angles(upright.as_quat()))
    np.testing.assert_allclose(found.as_matrix(), upright.as_matrix(), rtol=0.0, atol=1e-8)


def test_hover_is_an_equilibrium():
    # n k_f omega^2 = m g.
    hover = np.full(6, np.sqrt(9.81 / (6 * 2.5e-5)))
    np.testing.assert_allclose(RigidBody(HEXAROTOR).derivative(NULL_STATE, hover), 0.0, atol=1e-13)
    state = flown(RigidBody(HEXAROTOR), NULL_STATE, hover, 10.0, 1000)
    np.testing.assert_allclose(state, NULL_STATE, atol=1e-11)


def test_signs():
    # One rotor alone at 200 rad/s gives 1 N: in front it puts the nose up (about -y), with
    # 0.4 N m / 0.015 kg m^2, and turns the body against itself, with 0.02 N m / 0.03 kg m^2.
    rate = RigidBody(HEXAROTOR).derivative(NULL_STATE, np.array([200.0, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(rate[VELOCITY], [0.0, 0.0, 1.0 - 9.81])
    np.testing.assert_allclose(rate[ANGULAR_VELOCITY], [0.0, -0.4 / 0.015, 0.02 / 0.03])
    # With the nose down by 90 degrees the thrust points ahead.
    state = NULL_STATE.copy()
    state[ATTITUDE] = [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]
    rate = RigidBody(HEXAROTOR).derivative(state, np.full(6, 200.0))
    np.testing.assert_allclose(rate[VELOCITY], [6.0, 0.0, -9.81], atol=1e-14)


def test_a_lost_rotor_gives_nothing():
    weak = HEXAROTOR.with_health([0.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    stopped = np.array([0.0, 200.0, 200.0, 200.0, 200.0, 200.0])
    turning = np.full(6, 200.0)
    np.testing.assert_array_equal(
        RigidBody(weak).derivative(NULL_STATE, turning),
        RigidBody(HEXAROTOR).derivative(NULL_STATE, stopped))


@given(triples)
def test_the_gyroscopic_torque_does_no_work_and_keeps_the_angular_momentum(omega):
    body, inertia = RigidBody(LOPSIDED), LOPSIDED.inertia
    spin = body.derivative(at(omega), np.zeros(6))[ANGULAR_VELOCITY]
    momentum = inertia @ omega
    scale = 1.0 + np.linalg.norm(momentum) * np.linalg.norm(omega) ** 2
    assert omega @ inertia @ spin == pytest.approx(0.0, abs=1e-13 * scale)
    assert momentum @ inertia @ spin == pytest.approx(0.0, abs=1e-13 * scale)
    # In the world frame the momentum does not change at all.
    np.testing.assert_allclose(inertia @ spin + np.cross(omega, momentum), 0.0, atol=1e-13 * scale)


@given(triples)
def test_the_attitude_turns_with_the_angular_velocity(omega):
    # A small turn about the body's axes: R(t + h) = R(t) exp(h omega) to second order.
    h = 1e-6
    after = RigidBody(LOPSIDED).step(np.concatenate([STATE[:10], omega]), SPEEDS, h)
    turn = Rotation.from_quat(STATE[ATTITUDE]) * Rotation.from_rotvec(h * omega)
    np.testing.assert_allclose(rotation_matrix(after[ATTITUDE]), turn.as_matrix(), atol=1e-9)


@pytest.mark.parametrize('vehicle', [HEXAROTOR, LOPSIDED, FLEET['tilted_hexarotor']],
                         ids=['hexarotor', 'lopsided', 'tilted'])
def test_the_error_halves_with_the_step_and_vanishes(vehicle):
    body, duration = RigidBody(vehicle), 0.5
    exact = reference(vehicle, STATE, SPEEDS, duration)
    flights = {steps: flown(body, STATE, SPEEDS, duration, steps) for steps in (200, 400, 800)}
    errors = {steps: state - exact for steps, state in flights.items()}
    for part in (POSITION, VELOCITY, ATTITUDE, ANGULAR_VELOCITY):
        sizes = [np.linalg.norm(error[part]) for error in errors.values()]
        assert 1e-6 < sizes[-1] < 0.5
        for coarse, fine in pairwise(sizes):
            assert 1.8 < coarse / fine < 2.2
    # What is left after the first order is taken out is of the second.
    second = [np.linalg.norm(2.0 * errors[2 * steps] - errors[steps]) for steps in (200, 400)]
    assert second[0] < 0.1 * np.linalg.norm(errors[400])
    assert 3.3 < second[0] / second[1] < 4.7


def test_the_quaternion_stays_a_unit():
    state = np.concatenate([STATE[:10], [2.0, -3.0, 4.0]])
    for _ in range(1000):
        state = RigidBody(LOPSIDED).step(state, np.zeros(6), 0.01)
        assert np.linalg.norm(state[ATTITUDE]) == pytest.approx(1.0, abs=4e-16)


def test_velocity_in_the_body_frame():
    # Heading left, a flight to the north is straight ahead.
    state = NULL_STATE.copy()
    state[ATTITUDE] = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
    state[VELOCITY] = [0.0, 2.0, 1.0]
    np.testing.assert_allclose(velocity_in_body(state), [2.0, 0.0, 1.0], atol=1e-15)


def test_steps_that_diverge_are_an_error_and_not_a_state():
    body, state = RigidBody(HEXAROTOR), np.array(NULL_STATE)
    state[ANGULAR_VELOCITY] = [20.0, -30.0, 40.0]
    with pytest.raises(FloatingPointError, match='diverge'):
        flown(body, state, np.zeros(6), 10.0, 1000)
    state[ANGULAR_VELOCITY] = 0.0
    state[VELOCITY] = 1e8
    body.step(state, np.zeros(6), 0.01)
    with pytest.raises(FloatingPointError, match='diverge'):
        body.step(state, np.zeros(6), 10.0)


def test_rotational_drag_grows_with_the_square_of_the_angular_velocity():
    # c |omega| omega = 0.001 * 13 * (3, -4, 12) N m, over J.
    state = NULL_STATE.copy()
    state[ANGULAR_VELOCITY] = [3.0, -4.0, 12.0]
    rates = [
        RigidBody(HEXAROTOR, drag).derivative(state, np.full(6, 200.0))
        for drag in (None, Drag(rotational=1e-3))]
    expected = np.zeros(13)
    expected[ANGULAR_VELOCITY] = -1e-3 * 13.0 * np.array([3.0, -4.0, 12.0]) / [0.015, 0.015, 0.03]
    np.testing.assert_allclose(rates[1] - rates[0], expected, atol=1e-12)
