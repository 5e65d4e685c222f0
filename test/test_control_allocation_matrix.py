"""The control allocation matrix against numbers worked out by hand, Eqs. (5)-(9)."""

import numpy as np
import pytest
from hypothesis import given

from ca_ros import control_allocation_matrix
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.settings import AXES
from strategies import FLEET, HEXAROTOR, build, ring, vehicles

THRUST, ROLL, PITCH, YAW = range(4)


def test_quadrotor():
    # r x e_3 = (y, -x, 0), and k = k_tau / k_f = 5e-7 / 2.5e-5 = 0.02 m.
    quadrotor = build(
        [[0.2, 0.3, 0.0], [-0.2, 0.3, 0.0], [-0.2, -0.3, 0.0], [0.2, -0.3, 0.0]], 'PNPN')
    np.testing.assert_allclose(control_allocation_matrix(quadrotor), [
        [1.0, 1.0, 1.0, 1.0],
        [0.3, 0.3, -0.3, -0.3],
        [-0.2, 0.2, 0.2, -0.2],
        [0.02, -0.02, 0.02, -0.02]], rtol=1e-14)


def test_hexarotor_of_the_paper():
    # Rotors each 60 degrees from the front: y = 0.4 sin 60 = 0.3464, x = 0.4 cos 60 = 0.2.
    s = 0.2 * np.sqrt(3.0)
    np.testing.assert_allclose(control_allocation_matrix(HEXAROTOR), [
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
        [0.0, s, s, 0.0, -s, -s],
        [-0.4, -0.2, 0.2, 0.4, 0.2, -0.2],
        [0.02, -0.02, 0.02, -0.02, 0.02, -0.02]], rtol=1e-14)


def test_signs():
    gamma = control_allocation_matrix(HEXAROTOR)
    front, front_left, back, back_right = 0, 1, 3, 4
    # Forward-left-up: a positive pitch puts the nose down, a positive roll the right side.
    assert gamma[PITCH, front] < 0.0 < gamma[PITCH, back]
    assert gamma[ROLL, front_left] > 0.0 > gamma[ROLL, back_right]
    # Eq. (2): the body turns against its rotors, to the left if they turn clockwise.
    assert HEXAROTOR.spins[front] > 0.0
    assert gamma[YAW, front] > 0.0


def test_tilted_axis():
    # Rotor 1 at (1, 0, 0) along a = (0, 0.6, 0.8), k = 0.1:
    # r x a = (0, -0.8, 0.6), and k a = (0, 0.06, 0.08) more if it turns clockwise.
    positions = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    axes = [0.0, 0.6, 0.8] + [0.0, 0.0, 1.0] * 3
    wrenches = {spin: rotor_wrenches(build(
        positions, spin + 'NPN', axes=axes, torque_coefficient=2.5e-6)) for spin in 'PN'}
    np.testing.assert_allclose(
        wrenches['P'][:, 0], [0.0, 0.6, 0.8, 0.0, -0.74, 0.68], atol=1e-15)
    np.testing.assert_allclose(
        wrenches['N'][:, 0], [0.0, 0.6, 0.8, 0.0, -0.86, 0.52], atol=1e-15)
    # Rotor 2 at (0, 1, 0), upright, counter-clockwise.
    np.testing.assert_allclose(
        wrenches['P'][:, 1], [0.0, 0.0, 1.0, 1.0, 0.0, -0.1], atol=1e-15)


def test_centre_of_mass_off_centre():
    # 0.1 m ahead and 0.05 m to the right of the middle: arms (0.3, 0.05), (-0.1, 0.45) ...
    vehicle = build(ring(4), 'PNPN', {'vehicle.center_of_mass': [0.1, -0.05, 0.7]})
    gamma = control_allocation_matrix(vehicle)
    np.testing.assert_allclose(gamma[ROLL], [0.05, 0.45, 0.05, -0.35], atol=1e-15)
    np.testing.assert_allclose(gamma[PITCH], [-0.3, 0.1, 0.5, 0.1], atol=1e-15)


def test_coefficients_of_each_rotor():
    vehicle = build(ring(4), 'PNPN', thrust_coefficient=[1e-5, 2e-5, 4e-5, 5e-5],
                    torque_coefficient=[2e-7, 2e-7, 2e-7, 1e-6])
    np.testing.assert_allclose(
        control_allocation_matrix(vehicle)[YAW], [0.02, -0.01, 0.005, -0.02])


def test_health_weakens_bounds_but_not_the_effect_of_a_newton():
    weak = HEXAROTOR.with_health([0.5, 1.0, 0.0, 1.0, 1.0, 1.0])
    np.testing.assert_array_equal(
        control_allocation_matrix(weak), control_allocation_matrix(HEXAROTOR))


@pytest.mark.parametrize('axes', [['yaw', 'thrust', 'force_x', 'roll', 'pitch'], list(AXES)])
def test_rows_are_the_commanded_axes_in_their_standing_order(axes):
    six = FLEET['tilted_hexarotor']
    vehicle = build(six.arms, 'PNPNPN', {'allocation.axes': axes},
                    axes=six.rotor_axes.ravel().tolist())
    rows = [i for i, axis in enumerate(AXES) if axis in axes]
    np.testing.assert_array_equal(control_allocation_matrix(vehicle), rotor_wrenches(six)[rows])


@given(vehicles(rank=False))
def test_forces_and_torques_of_eqs_3_and_4(vehicle):
    # Newton's sum over the rotors, one by one.
    thrusts = np.linspace(1.0, 2.0, vehicle.n)
    force, torque = np.zeros(3), np.zeros(3)
    for i, thrust in enumerate(thrusts):
        x, y, z = vehicle.arms[i]
        skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        k = vehicle.torque_coefficient[i] / vehicle.thrust_coefficient[i]
        force += thrust * vehicle.rotor_axes[i]
        torque += thrust * (skew + vehicle.spins[i] * k * np.eye(3)) @ vehicle.rotor_axes[i]
    np.testing.assert_allclose(
        rotor_wrenches(vehicle) @ thrusts, np.concatenate([force, torque]), atol=1e-12)
