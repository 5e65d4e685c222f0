"""The control allocation matrix against numbers worked out by hand, Eqs. (5)-(9)."""

import numpy as np
import pytest
from hypothesis import given

from ca_ros import control_allocation_matrix
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.settings import AXES
from strategies import FLEET, HEXAROTOR, build, vehicles


def test_hexarotor_of_the_paper():
    # Rotors each 60 degrees from the front: y = 0.4 sin 60 = 0.3464, x = 0.4 cos 60 = 0.2.
    s = 0.2 * np.sqrt(3.0)
    np.testing.assert_allclose(control_allocation_matrix(HEXAROTOR), [
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
        [0.0, s, s, 0.0, -s, -s],
        [-0.4, -0.2, 0.2, 0.4, 0.2, -0.2],
        [0.02, -0.02, 0.02, -0.02, 0.02, -0.02]], rtol=1e-14)


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
