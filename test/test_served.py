"""What is served of unattainable wrenches: least norm, and single against double precision.

Vehicles, orders and wrenches are drawn anew for each seed.
"""

import numpy as np
import pytest

from ca_ros import Status, Vehicle, make_allocator
from ca_ros.allocation.box_backend import has_nearly_level_edges, kernel_for
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.kernel import load
from ca_ros.problem.audit import audit
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.settings import AXES
from strategies import build, length, need_kernel, random_vehicle, ring, seeded, tilted_axes

need_kernel()

ORDERS = [['roll pitch', 'thrust', 'yaw'], ['thrust', 'roll pitch', 'yaw'],
          ['roll', 'pitch', 'thrust', 'yaw'], ['thrust', 'roll pitch yaw'],
          ['roll pitch', 'thrust yaw'], ['yaw', 'roll pitch', 'thrust']]
LATERAL = ['force_x force_y']


def drawn_problem(rng):
    """Draw the problem of a vehicle, mostly a symmetric one, with up to two rotors lost."""
    n, kind = int(rng.choice([4, 6, 6, 8, 10])), rng.choice(['ring', 'coaxial', 'tilted', 'any'])
    radius, spins = rng.uniform(0.1, 0.8), 'PN' * (n // 2)
    rotors = {'speed_min': rng.choice([0.0, 40.0, 150.0]), 'speed_max': rng.uniform(300.0, 900.0),
              'torque_coefficient': rng.uniform(2e-7, 2e-6)}
    if kind == 'any':
        vehicle = random_vehicle(rng, n)
    elif kind == 'coaxial' and n > 4:
        half = ring(n // 2, radius)
        vehicle = build(np.vstack([half, half]), spins[: n // 2] + spins[1 : n // 2 + 1], **rotors)
    elif kind == 'tilted' and n > 4:
        axes = np.ravel(tilted_axes(n, np.radians(rng.uniform(5.0, 40.0)))).tolist()
        vehicle = build(ring(n, radius), spins, {'allocation.axes': list(AXES)}, axes=axes,
                        **rotors)
    else:
        turned = rng.choice([0.0, np.pi / n])
        vehicle = build(ring(n, radius, turned), rng.permutation(list(spins)), **rotors)
    health = np.ones(n)
    health[rng.choice(n, rng.integers(0, 3 if n > 4 else 1), replace=False)] = 0.0
    return audit(vehicle.with_health(health)).independent


def drawn_options(rng, problem):
    """Draw an order and whether thrust may deviate."""
    order = [*ORDERS[rng.integers(len(ORDERS))], *LATERAL]
    groups = [' '.join(axis for axis in group.split() if axis in problem.axes) for group in order]
    return {'order': [group for group in groups if group],
            'axis_reversal': rng.choice(['prevent', 'allow', 'allow'])}


def drawn_wrenches(rng, problem, size):
    """Draw wrenches around the set, half of them on a grid, where answers are degenerate."""
    ways = rng.uniform(-1.6, 1.6, (size, len(problem.axes)))
    ways[::2] = np.round(4.0 * ways[::2]) / 4.0 * rng.choice([0.0, 1.0], ways[::2].shape)
    return problem.reference + problem.extent * ways


@pytest.mark.parametrize('seed', range(length(24, 200, 2000)))
def test_the_thrusts_for_what_is_served_have_the_least_norm(seed):
    rng = seeded(seed)
    problem = drawn_problem(rng)
    exact = make_allocator('exact', problem, residual_slack=0.0, **drawn_options(rng, problem))
    assert exact.engine == 'C'
    answers = exact.allocate_batch(drawn_wrenches(rng, problem, length(2000, 5000)))
    served = answers.status == Status.PRIORITIZED
    wrenches, thrusts = answers.wrench[served], answers.thrusts[served]
    greatest = max(1.0, problem.upper.max())
    # The least norm is a continuous function of the wrench, and a little nearer to the middle of
    # the set another method finds it.
    near = exact.allocate_batch(wrenches + 1e-9 * (problem.center - wrenches))
    assert np.all(near.status == Status.EXACT)
    longer = np.linalg.norm(thrusts, axis=1) - np.linalg.norm(near.thrusts, axis=1)
    assert np.all(longer <= 1e-4 * greatest)
    for wrench, given in zip(wrenches[:40], thrusts[:40], strict=True):
        found = problem.box.least_norm.solve(wrench, float(problem.tolerance(wrench)))
        if found.attained:
            assert np.linalg.norm(given) <= np.linalg.norm(found.thrusts) + 1e-9 * greatest


def test_mirrored_wrenches_get_mirrored_thrusts():
    exact = make_allocator('exact', Vehicle.load('hexarotor'), axis_reversal='allow',
                           order=['thrust', 'roll pitch yaw'])
    for pitch in -6.729947059841593 - np.linspace(0.0, 1e-3, 11):
        thrusts = exact.allocate([9.81, 0.0, pitch, 0.0]).thrusts
        np.testing.assert_allclose(thrusts, thrusts[[0, 5, 4, 3, 2, 1]], atol=1e-12)
        np.testing.assert_allclose(thrusts[[1, 2]], [2.434, 0.451], atol=1e-3)


def served_by(problem, settings, wrenches, precision):
    """Return the wrenches that a kernel serves."""
    dtype = np.float32 if precision == 'single' else np.float64
    kernel = kernel_for(load(precision), problem, settings, dtype)
    thrusts, levels = np.empty((len(wrenches), problem.n), dtype), np.empty(len(wrenches), dtype)
    status = np.empty(len(wrenches), np.int8)
    kernel.allocate_batch(wrenches.astype(dtype), thrusts, status, levels, None)
    assert not np.any(status == Status.INEXACT)
    return thrusts @ problem.gamma.T


@pytest.mark.parametrize('seed', range(length(24, 200, 2000)))
def test_single_precision_serves_what_double_precision_does(seed):
    rng = seeded(seed)
    problem = drawn_problem(rng)
    settings = ExactSettings(**drawn_options(rng, problem))
    wrenches = drawn_wrenches(rng, problem, length(2000, 5000)).astype(np.float32).astype(float)
    served = served_by(problem, settings, wrenches, 'double')

    def apart(found, of=slice(None)):
        return (np.abs(found - served[of]) / problem.extent).max(axis=1)

    off = np.flatnonzero(apart(served_by(problem, settings, wrenches, 'single')) > 1e-3)
    # Where double precision itself moves, be it for changes of 1e-6, single precision may, too.
    for _ in range(20 if len(off) else 0):
        change = rng.choice([-1.0, 1.0], (len(off), len(problem.axes))) * problem.extent
        near = wrenches[off] + 1e-6 * rng.uniform(0.1, 1.0, (len(off), 1)) * change
        off = off[apart(served_by(problem, settings, near, 'double'), off) <= 1e-3]
    assert not len(off), wrenches[off]


@pytest.mark.parametrize('seed', [1157, 1788, 2336, 2860, 3096, 3341, 3834])
def test_wrenches_almost_at_an_edge_are_served_as_those_around_them(seed):
    """In single precision these lie 1e-8 beside an edge, where pivots are as small.

    In 2336 and 3096 those around them lie 1e-6 beside a plane of symmetry, and the line to them
    begins where a thrust is at its bound; in 1157, where several would be if one rotor
    alone made up for another one that is lost.
    """
    rng = seeded(seed)
    problem = drawn_problem(rng)
    settings = ExactSettings(**drawn_options(rng, problem))
    wrenches = drawn_wrenches(rng, problem, 2000).astype(np.float32).astype(float)
    double, single = (
        served_by(problem, settings, wrenches, name) for name in ('double', 'single'))
    near = wrenches + 1e-6 * rng.uniform(-1.0, 1.0, (4, *wrenches.shape)) * problem.extent
    around = [served_by(problem, settings, each, 'double') for each in near]
    beside = [served_by(problem, settings, each, 'single') for each in near]
    alike = (np.ptp(around, axis=0) <= 1e-4 * problem.extent).all(axis=1)
    assert alike.mean() > 0.5
    for found in (double, single, *beside):
        apart = np.abs(found - around[0]) / problem.extent
        assert not np.flatnonzero(alike & (apart.max(axis=1) > 1e-3)).size


def test_single_precision_does_not_chatter_with_a_rotor_lost():
    vehicle = Vehicle.load('hexarotor').with_health([1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    problem = audit(vehicle).independent
    u = np.array([-9.635369300842285, 0.00590366218239069, -4.715278625488281, 0.1343390941619873])
    wrenches = u + 1e-5 * np.arange(-20, 21)[:, None] * [0.0, 0.0, 1.0, 0.0]
    thrust = served_by(problem, ExactSettings(), wrenches, 'single')[:, 0]
    np.testing.assert_allclose(thrust, 4.21, atol=0.01)


def test_single_precision_tells_an_edge_that_is_nearly_level_from_one_that_is():
    """Along an edge yaw changes by 1.5e-6 of what pitch does: yaw is least at one of its ends."""
    rng = np.random.default_rng(61155256)
    vehicle, health = random_vehicle(rng, int(rng.integers(4, 11))), np.ones(8)
    lost = rng.integers(0, 3)
    health[rng.permutation(8)[:lost]] = 0.0
    problem = VehicleProblem(vehicle.with_health(health))
    assert has_nearly_level_edges(problem.gamma, problem.half_range)
    settings = ExactSettings(order=['thrust roll force_y force_x', 'yaw', 'pitch'])
    u = np.array([[2.0838046073913574, -1.78043794631958, 9.368326187133789, -2.1568667888641357,
                   -1.0374703407287598, 0.5395542979240417]])
    double, single = (served_by(problem, settings, u, name)[0] for name in ('double', 'single'))
    np.testing.assert_allclose(double[4], -0.4834989, atol=1e-6)  # that of HiGHS
    np.testing.assert_allclose(single, double, atol=1e-4)


@pytest.mark.parametrize(('slope', 'nearly'), [(0.0, False), (1e-6, True), (1e-2, False)])
def test_nearly_level_edges_are_found_among_all(slope, nearly):
    gamma = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, slope]])
    assert has_nearly_level_edges(gamma, np.ones(3)) == nearly
