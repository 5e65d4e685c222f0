"""Where rounding decides: cancelling thrusts, far preferences, idle rotors, the boundary."""

import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from ca_ros import AdmissibleSet, AllocationProblem, Status, kernel, make_allocator
from ca_ros.control import momentum_observer
from ca_ros.detection import (
    belief_changes,
    disturbances,
    hypothesis_test,
    leads,
    losses,
    motion_test,
    motor_model,
    naming,
    noise_estimator,
    pairs,
    rotor_beliefs,
    suspicion,
    windows,
)
from ca_ros.kernel import AXES_MAX, ROTORS_MAX, load
from ca_ros.problem import prioritization, sets_prioritization
from ca_ros.problem.problem import EXACT_TOLERANCE
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.solver import faces
from ca_ros.solver import least_norm_over_sets as sets_qp
from ca_ros.solver import least_norm_qp as qp
from ca_ros.solver import lexicographic_lp as lp
from ca_ros.solver.zonotope import SPANNING_MIN
from ca_ros.vehicle.validation import ABSURD
from strategies import build, length, ring, seeded

pytestmark = pytest.mark.skipif(load() is None, reason='the extension module is not built')

ENGINES = ('c', 'numpy')


@pytest.fixture(params=ENGINES)
def engine(request, monkeypatch):
    """Choose an engine of the method exact."""
    monkeypatch.setenv('CA_ROS_KERNEL', request.param)


def missed(problem, u, thrusts):
    """Return |u - Gamma f|, its sums without rounding."""
    squares = 0
    for row, goal in zip(problem.gamma, u, strict=True):
        products = (Fraction(a) * Fraction(f) for a, f in zip(row, thrusts, strict=True))
        squares += (Fraction(goal) - sum(products)) ** 2
    return float(squares) ** 0.5


def test_rotors_without_effect_get_the_least_thrust(engine):
    gamma = [[0.0, 0.0, -0.005012295950912398, 0.006478999265241094],
             [0.0, 0.0, -0.6839115398651534, 0.8843767308962244]]
    problem = AllocationProblem(
        gamma, -0.24180758566403437, 38.288412340030014, axes=['force_x', 'roll'])
    u = (-0.21020106353402634, -26.400165292298453)
    for preferred, idle in ((0.0, 0.0), ([3.0, 3.0, 0.0, 0.0], 3.0)):
        allocator = make_allocator('exact', problem, order=[['roll', 'force_x']],
                                   preferred=preferred)
        answer = allocator.allocate(u)
        assert answer.status == Status.PRIORITIZED
        # By rational arithmetic.
        np.testing.assert_allclose(
            answer.thrusts, [idle, idle, 38.288412340030014, 29.4789255], atol=1e-7, rtol=0.0)


@pytest.mark.parametrize('size', [1.0, 1e3, 1e6])
def test_a_preference_far_away_takes_no_digits_from_the_wrench(engine, size):
    rng = seeded(0)
    for _ in range(5):
        gamma = rng.normal(size=(3, 6))
        problem = AllocationProblem(gamma, -size, size)
        preferred = rng.uniform(-100.0, 100.0, 6) * size
        allocator = make_allocator('exact', problem, preferred=preferred)
        for _ in range(5):
            u = gamma @ rng.uniform(-1.0, 1.0, 6)
            answer = allocator.allocate(u)
            bound = max(1e-12 * max(1.0, np.linalg.norm(u)),
                        4 * 2.3e-16 * np.linalg.norm(np.abs(gamma) @ np.abs(answer.thrusts)))
            assert answer.status == Status.EXACT
            assert missed(problem, u, answer.thrusts) <= 1.5 * bound
            # A wrench whose size is that of the bounds, too.
            assert allocator.allocate(0.5 * size * u).certificate.kkt_residual <= 1e-7 * size


@pytest.mark.parametrize('policy', ['reject', 'prioritize', 'scale'])
@pytest.mark.parametrize('low', [1e4, 1e6])
def test_small_wrenches_of_great_thrusts_that_cancel_are_exact(engine, low, policy):
    problem = AllocationProblem(
        [[1, -1, 0, 0], [0, 0, 1, -1], [0.5, 0.5, -0.5, -0.5]], low, 2.0 * low)
    demands = seeded(1).normal(size=(50, 3))
    batch = make_allocator('exact', problem, policy=policy).allocate_batch(demands)
    assert np.all(batch.status == Status.EXACT)
    rounding = 2.3e-16 * np.linalg.norm(np.abs(problem.gamma) @ batch.thrusts.T, axis=0)
    for u, thrusts, bound in zip(demands, batch.thrusts, rounding, strict=True):
        assert missed(problem, u, thrusts) <= 5.0 * bound


def near_the_boundary(problem, size):
    """Draw wrenches within 1e-14 to 1e-8 of the boundary, on both sides of random facets."""
    rng, zonotope = seeded(5), AdmissibleSet(problem).zonotope
    chosen, side = rng.integers(len(zonotope.normals), size=size), rng.choice([-1.0, 1.0], size)
    ends = np.sign(zonotope.sides[chosen]) * side[:, None]
    ends[ends == 0.0] = rng.uniform(-1.0, 1.0, (ends == 0.0).sum())
    on = problem.center + ends @ zonotope.generators.T
    steps = rng.choice([-1.0, 1.0], size) * 10.0 ** rng.uniform(-14.0, -8.0, size)
    return on + steps[:, None] * zonotope.normals[chosen]


@pytest.mark.parametrize(('n', 'first', 'digits'), [(8, 0.0, 9), (8, 13.0, 6), (6, 0.0, 16)])
def test_policies_agree_on_what_is_attainable(n, first, digits, monkeypatch):
    positions = np.round(ring(n, first=np.radians(first)), digits)
    problem = VehicleProblem(build(positions, 'PN' * (n // 2)))
    demands = near_the_boundary(problem, length(120, 400))
    options = [{'policy': 'reject'}, {'policy': 'scale'}, {}, {'axis_reversal': 'allow'},
               {'order': ['yaw', 'roll pitch', 'thrust']}]
    margins = problem.attainable_set.margin(demands)
    for engine, some in zip(ENGINES, (demands, demands[:30]), strict=True):
        monkeypatch.setenv('CA_ROS_KERNEL', engine)
        batches = [make_allocator('exact', problem, **option).allocate_batch(some)
                   for option in options]
        exact = [batch.status == Status.EXACT for batch in batches]
        for other in exact[1:]:
            np.testing.assert_array_equal(exact[0], other)
        assert exact[0][margins[: len(some)] >= 0.0].all()
        far = margins[: len(some)] < -2e-12 * np.maximum(1.0, np.linalg.norm(some, axis=1))
        assert far.any()
        assert not exact[0][far].any()


SHARED = {
    'least_norm.c': {
        'STEPS': qp.STEPS, 'SINGULAR_MIN': qp.SINGULAR_MIN, 'STEEP': qp.STEEP,
        'FULL_SLACK': qp.FULL_SLACK, 'SAME': qp.SAME, 'STILL': qp.STILL,
        'IMAGE_ROUNDING': qp.IMAGE_ROUNDING, 'CHANGED': qp.CHANGED,
        'EXACT_SUM': qp.EXACT_SUM, 'SUM': qp.SUM, 'AIM': qp.AIM},
    'priorities.c': {
        'ZERO': lp.ZERO, 'SLACK': lp.SLACK, 'RATE_MIN': lp.RATE_MIN, 'MAGNIFIED': lp.MAGNIFIED,
        'PIVOTS_PER_VARIABLE': lp.PIVOTS_PER_VARIABLE, 'AT_BOUND': lp.AT_BOUND,
        'NEAR': lp.NEAR, 'SPREAD': lp.SPREAD, 'INSIDE': prioritization.INSIDE,
        'REST': prioritization.REST, 'ERROR_FACTOR': prioritization.ERROR_FACTOR},
    'priorities.h': {
        'CA_LAG': prioritization.LAG, 'CA_LAG_RATIO': prioritization.LAG_RATIO},
    'vectored_newton.c': {name: getattr(sets_qp, name) for name in (
        'STEPS', 'TRIALS', 'ROUNDING', 'FLAT', 'DAMPING', 'PULLS', 'HALVINGS', 'GROWTH',
        'PULL_MAX', 'FAR', 'GAP')},
    'vectored_priorities.c': {
        'LEVEL': faces.LEVEL, 'DEPENDENT': faces.DEPENDENT, 'STILL': sets_prioritization.STILL,
        'PRIORITY_TOLERANCE': sets_prioritization.PRIORITY_TOLERANCE,
        'MOVED': sets_prioritization.MOVED},
    'detector.c': {
        **{name: getattr(hypothesis_test, name) for name in (
            'THRUST_ERROR', 'DRAG_LOST', 'TELLING')},
        **{name: getattr(naming, name) for name in (
            'CLEAR_LOSS', 'WEAK_LOSS', 'ASKED', 'ODDS', 'MARGIN', 'SEEN', 'PAIR_ODDS')},
        **{name: getattr(leads, name) for name in (
            'LASTING', 'GATHERED', 'EXCESS', 'DOUBT', 'DEBT', 'SMALL_DEBT')},
        **{name: getattr(pairs, name) for name in ('LEAST_LOSS', 'MOST_LOSS', 'ALIKE', 'PAIRED')},
        'CONTACT': disturbances.CONTACT, 'LIMIT': losses.LIMIT, 'PRIOR': losses.PRIOR,
        'GIVING': losses.GIVING, 'NEAR': losses.NEAR,
        **{name: getattr(motion_test, name) for name in ('RECENT', 'KEPT')},
        **{name: getattr(suspicion, name) for name in ('CONFIRMATIONS', 'SUSPICION', 'PATIENCE')},
        'TOTAL': belief_changes.TOTAL,
        **{name: getattr(motor_model, name) for name in ('SETTLING', 'HELD')},
        **{name: getattr(rotor_beliefs, name) for name in (
            'REFINED', 'USELESS', 'IN_A_ROW', 'CERTAIN', 'TOLD')},
        **{name: getattr(noise_estimator, name) for name in (
            'FLOOR', 'OUTLIER', 'TIME_ERROR', 'COMMON_ERROR', 'LEARNT', 'TRIM')},
        'LEARNING': noise_estimator.LEARNING[0], 'LONG_LEARNING': noise_estimator.LEARNING[1],
        **{name: getattr(momentum_observer, name) for name in (
            'MOTION', 'AVERAGING', 'REST', 'KEEP')},
        'BLOCK': windows.BLOCK, 'HALF': windows.HALF},
    'detector.h': {'CA_BLOCKS': windows.LENGTH, 'CA_WINDOWS': len(windows.WINDOWS),
                   'CA_UNTESTED': noise_estimator.UNTESTED},
    'exact.c': {'SPANNING_MIN': SPANNING_MIN},
    'numbers.h': {'CA_EXACT_TOLERANCE': EXACT_TOLERANCE, 'CA_ABSURD': ABSURD},
    'configuration.h': {'CA_N': ROTORS_MAX, 'CA_M': AXES_MAX}}
"""The constants that both engines have, by the file of the kernel."""


@pytest.mark.parametrize('file', SHARED)
def test_the_engines_have_the_same_constants(file):
    text = (Path(kernel.__file__).parent / file).read_text()
    number = (r'(?:(?:REAL\()?(?:CA_)?CHOOSE\(([^,]+),|'
              r'(?:(?:CA_)?REAL\(|\(\(ca_real\))([\d.e-]+)\)|([\d.e-]+)(?= |$))')
    found = {name: np.prod([float(factor) for factor in ''.join(values).split('*')])
             for name, *values in re.findall(rf'#define (\w+) {number}', text, re.MULTILINE)}
    assert {name: found[name] for name in SHARED[file]} == SHARED[file]


def test_no_rounding_of_even_stamps_decides_where_a_window_ends():
    # 7e-6: of the sums of 80 steps and 34 blocks, in single precision.
    for rate in (12.5, 31.25, 62.5, *range(20, 1001), 1250, 1500, 1600, 2000, 2500, 4000, 8000):
        step = round(1e9 / rate) / 1e9
        steps = np.ceil(windows.BLOCK / step)
        ends = [steps * step / windows.BLOCK, max(steps - 1.0, 1.0) * step / windows.BLOCK]
        middles = (np.arange(1, windows.LENGTH) + windows.HALF) * steps * step
        ratios = np.append(ends, middles[:, None] / windows.WINDOWS)
        assert abs(ratios - 1.0).min() > 2e-5, rate
