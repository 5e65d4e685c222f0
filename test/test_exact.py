"""The exact allocator: Gamma f = u to rounding, bounds to the last bit, least norm."""

from itertools import combinations

import numpy as np
import pytest

from ca_ros import AdmissibleSet, Exact, Status, Vehicle, control_allocation_matrix
from strategies import (
    FLEET,
    HEXAROTOR,
    SOME,
    build,
    by_daqp,
    by_quadprog,
    length,
    middle,
    random_vehicle,
    ring,
    seeded,
)
from strategies import unaudited as make_allocator

PLUS = Vehicle(
    mass=0.8, positions=[(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)],
    spins=['cw', 'ccw', 'cw', 'ccw'], thrust_coefficient=1.0, torque_coefficient=0.5,
    speed_min=0.0, speed_max=2.0)
"""Arms of 1 m forward, left, back and right; thrusts of 0 to 4 N, 0.5 N m of drag for each N."""


@pytest.mark.parametrize(('wrench', 'thrusts', 'served'), [
    # Sums of opposite rotors: half of the thrust and the yaw torque, 4 + 1 and 4 - 1 N.  Their
    # differences: f_2 - f_4 is the roll torque, 1 N m, and f_3 - f_1 the pitch torque, -2 N m.
    ([8.0, 1.0, -2.0, 1.0], [3.5, 2.0, 1.5, 1.0], [8.0, 1.0, -2.0, 1.0]),
    # The yaw torque needs 4 + 10 N of two rotors, which give 8: it is last in the order.
    ([8.0, 0.0, 0.0, 10.0], [4.0, 0.0, 4.0, 0.0], [8.0, 0.0, 0.0, 4.0]),
    # Beyond the greatest thrust no torque is left.
    ([20.0, 0.0, 0.0, 0.0], [4.0, 4.0, 4.0, 4.0], [16.0, 0.0, 0.0, 0.0]),
])
def test_wrenches_worked_out_by_hand(wrench, thrusts, served):
    answer = Exact(PLUS).allocate(wrench)
    np.testing.assert_allclose(answer.thrusts, thrusts, atol=1e-12)
    np.testing.assert_allclose(answer.wrench, served, atol=1e-12)
    np.testing.assert_allclose(answer.speeds, np.sqrt(thrusts), atol=1e-7)
    assert answer.status is (Status.EXACT if wrench == served else Status.PRIORITIZED)


def test_six_rotors_share_as_the_least_norm_does():
    # Of six equal rotors on a circle the least thrusts for a roll torque are in the ratio of y.
    answer = Exact(HEXAROTOR).allocate([9.6, 0.6, 0.0, 0.0])
    s = np.sqrt(3.0) / 2.0  # arms of 0.4 m; 0.6 = sum of 0.4 y d y, with 4 rotors at y = +-s
    share = 0.6 / (4.0 * 0.4 * s**2) * np.array([0.0, s, s, 0.0, -s, -s])
    np.testing.assert_allclose(answer.thrusts, 1.6 + share, atol=1e-12)


VEHICLES = length(5, 150, 1000)
HARD = (238, 247, 420, 833, 874, 919, 929, 944, 983)
"""Vehicles whose edges or near-singular active sets have defeated a solver."""

INWARD = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
OUTWARD = (1e-15, 1e-14, 1e-13, 3e-13)


def boundary_thrusts(vehicle, rng, size):
    """Draw thrusts whose wrenches lie on facets, edges and vertices of the admissible set.

    On a facet with normal v each rotor is at the bound where v Gamma_i f_i is greatest, except
    for those whose column is orthogonal to v: they may be anywhere, or at their bounds too.
    """
    gamma = control_allocation_matrix(vehicle)
    low, high = vehicle.thrust_min, vehicle.thrust_max
    columns = (gamma * (high - low)).T
    choices = list(combinations(range(vehicle.n), len(gamma) - 1))
    drawn = []
    while len(drawn) < size:
        spanned = columns[list(choices[rng.integers(len(choices))])]
        singular, right = np.linalg.svd(spanned)[1:]
        if singular[-1] < 1e-6 * singular[0]:
            continue
        along = columns @ right[-1] * rng.choice([-1.0, 1.0])
        free = np.abs(along) < 1e-12 * np.linalg.norm(columns, axis=1)
        inside = free & (rng.random(vehicle.n) < rng.choice([0.0, 0.3, 1.0]))
        ends = np.where(free, rng.choice([-1.0, 1.0], vehicle.n), np.sign(along))
        drawn.append(np.where(inside, rng.uniform(low, high), np.where(ends > 0.0, high, low)))
    return np.array(drawn)


def commands(vehicle, rng, size):
    """Yield commands in and around the boundary of the admissible set, by name."""
    gamma, center = control_allocation_matrix(vehicle), middle(vehicle)
    thrusts = rng.uniform(vehicle.thrust_min, vehicle.thrust_max, (size, vehicle.n))
    yield 'interior', thrusts @ gamma.T
    edge = boundary_thrusts(vehicle, rng, size) @ gamma.T
    yield 'boundary', edge
    lengths = np.linalg.norm(edge - center, axis=1, keepdims=True)
    for depth in INWARD:
        yield f'{depth} inside', edge + np.minimum(depth / lengths, 1.0) * (center - edge)
    for height in OUTWARD:
        rounding = height * np.maximum(1.0, np.linalg.norm(edge, axis=1, keepdims=True))
        yield f'{height} outside', edge + rounding / lengths * (edge - center)


def oracle_norms(vehicle, u):
    """Return the norms of those answers of the other solvers that solve the problem at all."""
    gamma, norms = control_allocation_matrix(vehicle), []
    for solve, options in ((by_quadprog, {}), (by_daqp, {'primal_tol': 1e-12})):
        try:
            thrusts = solve(gamma, u, vehicle.thrust_min, vehicle.thrust_max, **options)
        except ValueError:
            continue
        thrusts = np.clip(thrusts, vehicle.thrust_min, vehicle.thrust_max)
        if np.linalg.norm(gamma @ thrusts - u) <= 1e-12 * max(1.0, np.linalg.norm(u)):
            norms.append(float(np.linalg.norm(thrusts)))
    return norms


def excess(vehicle, u, thrusts):
    """Return the figures of the promise, by name: all of them should be at most one."""
    residual = np.linalg.norm(control_allocation_matrix(vehicle) @ thrusts - u)
    norms = oracle_norms(vehicle, u)
    return {
        'residual': residual / (1e-12 * max(1.0, np.linalg.norm(u))),
        'norm': max([(np.linalg.norm(thrusts) - norm) / max(1.0, norm) for norm in norms],
                    default=0.0) / 1e-9,
        'oracles': len(norms),
    }


def check(vehicle, allocator, kind, u):
    a = allocator.allocate(u)
    assert a.status is Status.EXACT, kind
    assert np.all(a.thrusts >= vehicle.thrust_min), kind
    assert np.all(a.thrusts <= vehicle.thrust_max), kind
    figures = excess(vehicle, u, a.thrusts)
    assert figures['residual'] <= 1.0, (kind, figures)
    assert figures['norm'] <= 1.0, (kind, figures)
    if kind == 'interior':
        assert figures['oracles'] > 0, 'no other solver has an answer to compare with'


@pytest.mark.parametrize('name', SOME)
def test_exact_in_and_around_the_boundary_of_any_named_vehicle(name):
    vehicle, rng = FLEET[name], seeded(0)
    allocator = make_allocator('exact', vehicle)
    for kind, wrenches in commands(vehicle, rng, 15):
        for u in wrenches:
            check(vehicle, allocator, kind, u)


@pytest.mark.parametrize('seed', sorted({*range(VEHICLES), *HARD}))
def test_exact_in_and_around_the_boundary_of_any_random_vehicle(seed):
    rng = seeded(seed)
    vehicle = random_vehicle(rng, 4 + seed % 13)
    allocator = make_allocator('exact', vehicle)
    for kind, wrenches in commands(vehicle, rng, 4):
        for u in wrenches:
            check(vehicle, allocator, kind, u)


def almost(positions, error):
    """Return a vehicle of rotors that turn in turn, their places off by about an error [m]."""
    errors = error * seeded(1).normal(size=positions.shape)
    return build(positions + errors, 'PN' * (len(positions) // 2))


# As built, and as written down with a few digits: planes of columns fall apart into many that are
# almost parallel.
ALMOST_SYMMETRIC = {
    **{f'{n} rotors, {error:g} m': almost(ring(n), error)
       for n in (4, 6, 8) for error in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)},
    **{f'{digits} digits': almost(np.round(ring(8, first=np.radians(10.0)), digits), 0.0)
       for digits in (2, 3, 4, 5, 6)},
}


@pytest.mark.parametrize(
    'name', length(['6 rotors, 0.001 m', '8 rotors, 1e-05 m', '4 digits'], ALMOST_SYMMETRIC))
def test_without_slack_almost_symmetric_vehicles_are_exact_on_all_of_their_facets(name):
    vehicle, rng = ALMOST_SYMMETRIC[name], seeded(6)
    allocators = [make_allocator('exact', vehicle, policy=policy, residual_slack=0.0)
                  for policy in ('prioritize', 'scale')]
    gamma, center = control_allocation_matrix(vehicle), middle(vehicle)
    edge = boundary_thrusts(vehicle, rng, 30) @ gamma.T
    admissible = AdmissibleSet(vehicle)
    anywhere = allocators[0].problem.hover + rng.normal(size=(30, 4)) * [8.0, 4.0, 4.0, 0.3]
    for u in rng.uniform(vehicle.thrust_min, vehicle.thrust_max, (30, vehicle.n)) @ gamma.T:
        check(vehicle, allocators[0], 'interior', u)
    for u in edge:
        check(vehicle, allocators[0], 'boundary', u)
    for allocator, policy in zip(
            allocators, (admissible.prioritize, admissible.scale),
            strict=True):
        for u in np.vstack([center + 1.5 * (edge - center), anywhere]):
            a, served = allocator.allocate(u), policy(u)
            assert a.status in (Status.EXACT, Status.PRIORITIZED, Status.SCALED)
            # Small pivots magnify the rounding errors in which two implementations differ.
            limit = 1e-7 if allocator.engine == 'C' else 1e-12
            assert np.linalg.norm(a.wrench - served) <= limit * max(1.0, np.linalg.norm(served))


# The certificate

@pytest.mark.parametrize('name', SOME)
def test_the_certificate_proves_the_answer(name):
    vehicle, rng = FLEET[name], seeded(4)
    gamma, admissible = control_allocation_matrix(vehicle), AdmissibleSet(vehicle)
    low, high = vehicle.thrust_min, vehicle.thrust_max
    allocator = make_allocator('exact', vehicle)
    for _, wrenches in commands(vehicle, rng, 5):
        for u in wrenches:
            a = allocator.allocate(u)
            proof = a.certificate
            assert proof.primal_residual == pytest.approx(
                np.linalg.norm(u - gamma @ a.thrusts), abs=1e-14 * (1.0 + np.linalg.norm(u)))
            assert proof.bound_violation == 0.0
            # By the multipliers alone: the rotors are where these prices of the wrench send them.
            sent = np.clip(proof.multipliers @ gamma, low, high)
            assert proof.kkt_residual == pytest.approx(
                np.abs(a.thrusts - sent).max(), abs=1e-12 * high.max())
            assert proof.kkt_residual < 1e-6 * high.max()
            assert proof.margin == pytest.approx(admissible.margin(u), abs=1e-12)


@pytest.mark.parametrize('name', SOME)
def test_the_certificate_names_the_nearest_facet_by_its_rotors(name):
    # With the named rotors at their bounds, the others span a plane at the distance of the margin.
    vehicle, rng = FLEET[name], seeded(5)
    gamma = control_allocation_matrix(vehicle)
    low, high = vehicle.thrust_min, vehicle.thrust_max
    samples = rng.uniform(low, high, (20, vehicle.n)) @ gamma.T
    for u in np.vstack([samples, 3.0 * samples]):
        proof = make_allocator('exact', vehicle).allocate(u).certificate
        on_facet = gamma @ np.where(proof.limit > 0, high, low)
        normal = np.linalg.svd(gamma[:, proof.limit == 0])[0][:, -1]
        assert abs(normal @ (u - on_facet)) == pytest.approx(abs(proof.margin), abs=1e-10)
        assert f'margin {proof.margin:.3g} ' in str(proof)


def test_the_certificate_of_thrusts_that_are_not_the_least():
    # Hover by direct allocation: a rotor at 4 N where 9.81 / 6 = 1.635 N would do.
    direct = make_allocator('direct', FLEET['hexarotor'])
    proof = direct.allocate([9.81, 0.0, 0.0, 0.0]).certificate
    assert proof.kkt_residual == pytest.approx(4.0 - 1.635)
    assert proof.primal_residual < 1e-12


# Slack, for vehicles that are symmetric but for the digits of their file

def written(name, digits):
    """Return a vehicle whose positions are written with so many digits."""
    turn = np.radians(10.0)
    square = [ring(4, first=turn, height=height) for height in (0.05, -0.05)]
    positions, spins = {
        'octorotor': (ring(8, first=turn), 'PN' * 4),
        'octorotor at 13 degrees': (ring(8, first=np.radians(13.0)), 'PN' * 4),
        'x8': (np.vstack(square), 'PNPNNPNP'),
        'y6': (np.vstack([ring(3, first=turn)] * 2), 'PPPNNN'),
        'lifter': (ring(16, radius=0.8, first=np.radians(11.25)), 'PN' * 8),
    }[name]
    return build(np.round(positions, digits), spins)


def jumps(vehicle, size, **options):
    """Return how thrusts and residuals behave on the boundary and 1e-9 inside: (size,) each."""
    allocator = make_allocator('exact', vehicle, **options)
    center = middle(vehicle)
    edge = boundary_thrusts(vehicle, seeded(7), size) @ allocator.problem.gamma.T
    way = center - edge
    beside = edge + 1e-9 * way / np.linalg.norm(way, axis=1, keepdims=True)
    on, inside = ([allocator.allocate(u) for u in wrenches] for wrenches in (edge, beside))
    for a in on + inside:
        assert a.status is Status.EXACT
        assert np.all(a.thrusts == allocator.problem.clip(a.thrusts))
    return (
        np.array([np.abs(a.thrusts - b.thrusts).max() for a, b in zip(on, inside, strict=True)]),
        np.array([np.linalg.norm(a.residual) / max(1.0, np.linalg.norm(a.demand))
                  for a in on + inside]))


NAMES = length(
    ['y6', 'lifter'], ['octorotor', 'octorotor at 13 degrees', 'x8', 'y6', 'lifter'])
JUMPS = length(20, 60)


@pytest.mark.parametrize('digits', length([3, 9, 12], range(3, 16)))
@pytest.mark.parametrize('name', NAMES)
def test_thrusts_do_not_jump_where_facets_are_parallel_but_for_the_digits_of_a_file(name, digits):
    changes, residuals = jumps(written(name, digits), JUMPS)
    assert residuals.max() <= 1e-9
    # With fewer digits facets are further apart than 1e-9 in the wrench; see the next test.
    if digits >= 9:
        assert changes.max() < 1e-6


@pytest.mark.parametrize('digits', length([6], range(5, 9)))
@pytest.mark.parametrize('name', NAMES)
def test_with_a_slack_of_as_many_digits_thrusts_of_shorter_files_do_not_jump_either(name, digits):
    slack = 10.0 ** (1 - digits)
    changes, residuals = jumps(written(name, digits), JUMPS, residual_slack=slack)
    assert residuals.max() <= slack
    assert np.mean(changes < 1e-6) >= 0.9
    assert changes.max() < 0.02


def test_without_slack_the_thrusts_of_such_a_vehicle_jump():
    changes, residuals = jumps(written('lifter', 9), JUMPS, residual_slack=0.0)
    assert changes.max() > 1.0
    assert residuals.max() <= 1e-12


def test_a_boundary_wrench_at_which_newton_stalls_is_exact_within_the_slack():
    # The linear program attains it to rounding; the dual Newton method leaves 1.2e-10.
    lifter = build(np.round(ring(16, radius=0.8, first=np.radians(7.0)), 7), 'PN' * 8)
    u = [8.87162944291865, 3.725357522805047, 5.113500541449658, -0.00574258776241115]
    for policy in ('prioritize', 'scale', 'reject'):
        a = make_allocator('exact', lifter, policy=policy).allocate(u)
        assert a.status is Status.EXACT
        assert np.linalg.norm(a.residual) <= 1e-9 * np.linalg.norm(u)
