"""The conventional allocator against other solvers and the conditions of an optimum, (18)-(19)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros import AdmissibleSet, control_allocation_matrix
from strategies import (
    HEXAROTOR,
    demands,
    generators,
    vehicles,
)
from strategies import unaudited as make_allocator


def check_optimum(vehicle, weight, reference, u, thrusts):
    """Check that no rotor can lower the cost within its bounds."""
    gamma = control_allocation_matrix(vehicle)
    slope = weight @ (thrusts - reference) + gamma.T @ (gamma @ thrusts - u)
    terms = np.abs(weight) @ (vehicle.thrust_max + np.abs(reference)) + np.abs(gamma.T) @ (
        np.abs(gamma) @ vehicle.thrust_max + np.abs(u))
    rounding, atom = 1e-8 * (1.0 + terms), 1e-12 * (1.0 + vehicle.thrust_max)
    assert np.all((slope >= -rounding) | (thrusts >= vehicle.thrust_max - atom))
    assert np.all((slope <= rounding) | (thrusts <= vehicle.thrust_min + atom))


@given(st.data())
def test_the_conditions_of_an_optimum_hold(data):
    vehicle = data.draw(vehicles(rank=False))
    u = data.draw(demands(vehicle))
    q = data.draw(st.sampled_from([1e-6, 1e-4, 1e-2, 1.0]))
    reference = data.draw(st.sampled_from(['hover', 'zero']))
    a = make_allocator('conventional', vehicle, weight=q, reference=reference).allocate(u)
    level = vehicle.mass * vehicle.gravity / vehicle.n if reference == 'hover' else 0.0
    check_optimum(vehicle, q * np.eye(vehicle.n), np.full(vehicle.n, level), u, a.thrusts)


@given(st.data())
def test_the_conditions_of_an_optimum_hold_for_a_matrix_singular_or_not(data):
    vehicle, rng = data.draw(vehicles()), data.draw(generators)
    u, n = data.draw(demands(vehicle)), vehicle.n
    root = 0.1 * rng.normal(size=(n, n))
    weight = data.draw(st.sampled_from([np.zeros((n, n)), np.full((n, n), 1e-3), root.T @ root]))
    reference = rng.uniform(vehicle.thrust_min, vehicle.thrust_max)
    a = make_allocator('conventional', vehicle, weight=weight, reference=reference).allocate(u)
    check_optimum(vehicle, weight, reference, u, a.thrusts)


def test_a_single_axis_worked_out_by_hand():
    # For a pure thrust T all six thrusts are alike, S / 6 each, and the cost with Q = q 1 1^T is
    # q S^2 + (S - T)^2: S = T / (1 + q).
    q, thrust = 9.1e-4, 12.0
    allocator = make_allocator(
        'conventional', HEXAROTOR, weight=np.full((6, 6), q), reference='zero')
    a = allocator.allocate([thrust, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(a.thrusts, thrust / (1.0 + q) / 6.0, rtol=1e-6)
    assert a.residual[0] == pytest.approx(q / (1.0 + q) * thrust, rel=1e-6)
    # With f_ref at hover, T = 9.81 N costs nothing.
    a = make_allocator('conventional', HEXAROTOR).allocate([9.81, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(a.thrusts, 1.635, rtol=1e-9)


def test_where_the_cost_leaves_the_thrusts_open_the_least_norm_decides():
    # 1^T f is a row of Gamma: with Q = q 1 1^T every f with the same wrench costs the same.
    allocator = make_allocator(
        'conventional', HEXAROTOR, weight=np.full((6, 6), 1e-3), reference='zero')
    exact = make_allocator('exact', HEXAROTOR)
    for u in AdmissibleSet(HEXAROTOR).sample(np.random.default_rng(0), 50):
        a = allocator.allocate(u)
        least = exact.allocate(a.wrench).thrusts
        np.testing.assert_allclose(a.thrusts, least, rtol=0.0, atol=1e-4)


@pytest.mark.parametrize(('weight', 'matrix'), [
    (2e-3, 2e-3 * np.eye(6)),
    ([1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3], np.diag([1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3])),
    ([9e-4] * 36, np.full((6, 6), 9e-4)),
])
def test_a_weight_may_be_a_number_a_diagonal_or_a_matrix(weight, matrix):
    u = [14.0, 0.5, -0.4, 0.02]
    short, long = (make_allocator('conventional', HEXAROTOR, weight=w).allocate(u)
                   for w in (weight, matrix))
    np.testing.assert_array_equal(short.thrusts, long.thrusts)


@pytest.mark.parametrize('weight', [
    [1.0, 2.0], -1.0, [[1.0, 2.0], [0.0, 1.0]], np.nan, np.triu(np.ones((6, 6))),
    -np.ones((6, 6)), [1.0] * 5 + [-1.0], 'heavy', 1.7e308, np.inf])
def test_a_wrong_weight_is_refused(weight):
    with pytest.raises(ValueError, match='weight'):
        make_allocator('conventional', HEXAROTOR, weight=weight)


@pytest.mark.parametrize('reference', ['lift', [1.0] * 5, [np.nan] * 6])
def test_a_wrong_reference_is_refused(reference):
    with pytest.raises(ValueError, match='reference'):
        make_allocator('conventional', HEXAROTOR, reference=reference)
