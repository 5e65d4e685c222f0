"""Weights and preferred thrusts, and the kernel for four axes, against independent solvers."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ca_ros import AllocationProblem, Status, Vehicle, make_allocator
from ca_ros.allocation.box_backend import BoxNumpy, kernel_for
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.kernel import load
from strategies import around, by_daqp, by_quadprog, length, need_kernel, seeded

PROBLEMS = length(15, 60, 1000)
"""How many random problems."""

need_kernel()


def random_problem(rng):
    """Return a problem with bounds of any sign, and settings with weights and preferences."""
    m = int(rng.integers(2, 7))
    n = m + int(rng.integers(1, 7))
    lower = rng.uniform(-3.0, 1.0, n)
    problem = AllocationProblem(
        rng.normal(size=(m, n)), lower, lower + rng.uniform(0.5, 4.0, n),
        reference=rng.normal(size=m))
    axes = list(problem.axes)
    split = int(rng.integers(1, m + 1))
    groups = [axes[:split], *([axis] for axis in axes[split:])]
    return problem, ExactSettings(
        order=groups, residual_slack=0.0,
        weights=10.0 ** rng.uniform(-1.0, 1.0, n), preferred=rng.uniform(-2.0, 3.0, n))


def allocate(engine, problem, u):
    thrusts = np.empty(problem.n)
    return engine.allocate(u, np.empty(len(u)), thrusts), thrusts


@pytest.mark.parametrize('seed', range(PROBLEMS))
def test_the_weighted_distance_is_the_least_that_other_solvers_find(seed):
    rng = seeded(seed)
    problem, settings = random_problem(rng)
    kernel = kernel_for(load(), problem, settings)
    squares = np.diag(np.square(settings.weights))
    for u in around(problem, rng, 5)[0]:
        answer, thrusts = allocate(kernel, problem, u)
        assert answer is None
        assert np.all((problem.lower <= thrusts) & (thrusts <= problem.upper))
        residual = np.linalg.norm(u - problem.gamma @ thrusts)
        assert residual <= 1e-11 * max(1.0, np.linalg.norm(u))
        asked = (problem.gamma, u, problem.lower, problem.upper, squares,
                 squares @ settings.preferred)
        np.testing.assert_allclose(thrusts, by_quadprog(*asked), rtol=0.0, atol=1e-7)
        np.testing.assert_allclose(thrusts, by_daqp(*asked), rtol=0.0, atol=1e-5)


@pytest.mark.parametrize('seed', range(length(8, 30)))
@pytest.mark.parametrize('policy', ['prioritize', 'scale', 'reject'])
def test_numpy_gives_the_same(seed, policy):
    rng = seeded(seed)
    problem, settings = random_problem(rng)
    settings = replace(settings, policy=policy, scale_reference=problem.center)
    engines = kernel_for(load(), problem, settings), BoxNumpy(problem, settings)
    for demands in around(problem, rng, 4)[::2]:
        for u in demands:
            (ours, f), (theirs, g) = (allocate(engine, problem, u) for engine in engines)
            assert (ours is None) == (theirs is None)
            if ours is not None:
                assert ours[0] == theirs[0]
                assert ours[1] == pytest.approx(theirs[1], abs=1e-8)
            np.testing.assert_allclose(f, g, rtol=0.0, atol=1e-7)


def test_by_hand():
    # Two rotors share 3 N: 3 - f_1 - f_2 = 0, weights 1 and 2, preferred 1 and 0.
    # Stationary: f_1 - 1 = 4 f_2, so f_2 = 0.4; with f_1 <= 2 the bound counts, and f_2 = 1.
    gamma = np.ones((1, 2))
    for upper, expected in ((9.0, [2.6, 0.4]), (2.0, [2.0, 1.0])):
        problem = AllocationProblem(gamma, -1.0, upper)
        settings = ExactSettings(
            order=[problem.axes], weights=[1.0, 2.0], preferred=[1.0, 0.0], residual_slack=0.0)
        for engine in (kernel_for(load(), problem, settings), BoxNumpy(problem, settings)):
            answer, thrusts = allocate(engine, problem, np.array([3.0]))
            assert answer is None
            np.testing.assert_allclose(thrusts, expected, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize('seed', range(length(4, 10)))
def test_ones_and_zeros_and_four_axes_change_no_bit(seed):
    rng = seeded(seed)
    n = 4 + seed
    problem = AllocationProblem(rng.normal(size=(4, n)), rng.uniform(-2.0, 0.0, n), 3.0)
    each = list(range(4))
    options = (problem.gamma, problem.lower, problem.upper, problem.reference, each, each,
               [0, 1, 1, 1], int(Status.PRIORITIZED), False, 1e-9)
    plain = {'weight': np.ones(n), 'preferred': np.zeros(n)}
    demands = np.vstack(around(problem, rng, 50)[::2])
    expected = [allocate(load()(*options), problem, u) for u in demands]
    assert {answer is None for answer, _ in expected} == {True, False}
    for name, preference in (('double', plain), ('double_4', {}), ('double_4', plain)):
        kernel = load(name)(*options, **preference)
        for u, (answer, thrusts) in zip(demands, expected, strict=True):
            other, f = allocate(kernel, problem, u)
            assert other == answer
            np.testing.assert_array_equal(f, thrusts)


def test_the_kernel_for_four_axes_refuses_others():
    problem = AllocationProblem(np.eye(3, 4), 0.0, 1.0)
    with pytest.raises(ValueError, match='rotors or axes'):
        kernel_for(load('double_4'), problem, ExactSettings(order=[problem.axes]))


@pytest.mark.parametrize(('changes', 'message'), [
    ({'weights': np.ones(4)}, 'weights: expected 1 or 5'),
    ({'preferred': np.zeros(4)}, 'preferred: expected 1 or 5'),
    ({'preferred': 101.0}, 'preferred: expected thrusts up to 100')])
def test_a_wrong_preference_is_named(changes, message):
    problem = AllocationProblem(np.eye(2, 5) + 1.0, 0.0, 1.0)
    with pytest.raises(ValueError, match=message):
        kernel_for(load(), problem, ExactSettings(**changes))


def test_a_weight_and_a_preference_belong_together():
    with pytest.raises(ValueError, match='or neither'):
        load()(np.ones((1, 2)), np.zeros(2), np.ones(2), np.zeros(1), [0], [0], [0], 1, False, 0.0,
               weight=np.ones(2))


# The options of exact

def test_the_certificate_proves_the_least_weighted_distance():
    rng = seeded(4)
    octorotor = Vehicle.load('octorotor')
    weights, preferred = rng.uniform(0.5, 4.0, 8), rng.uniform(0.0, 4.0, 8)
    allocator = make_allocator('exact', octorotor, weights=weights, preferred=preferred)
    demands = np.vstack(around(allocator.problem, rng, 20)[::2])
    answers = allocator.allocate_batch(demands)
    proof = answers.certificate
    assert np.abs(proof.kkt_residual).max() <= 1e-9
    # The proof fails for the thrusts of least norm.
    plain = make_allocator('exact', octorotor).allocate_batch(demands)
    plain.__dict__['preference'] = answers.preference
    assert plain.certificate.kkt_residual[:20].min() > 1e-3
    single = allocator.allocate(demands[0])
    np.testing.assert_array_equal(single.thrusts, answers.thrusts[0])
    assert single.certificate.kkt_residual <= 1e-9
    again = pickle.loads(pickle.dumps(allocator))
    np.testing.assert_array_equal(again.allocate(demands[0]).thrusts, single.thrusts)


def test_without_preference_nothing_changes():
    hexarotor = Vehicle.load('hexarotor')
    u = [9.81, 0.5, -0.4, 0.05]
    plain = make_allocator('exact', hexarotor).allocate(u)
    given = make_allocator('exact', hexarotor, weights=np.ones(6), preferred=[0.0] * 6).allocate(u)
    np.testing.assert_array_equal(plain.thrusts, given.thrusts)
    assert given.preference is None


@pytest.mark.parametrize(('options', 'fault'), [
    ({'weights': 0.0}, 'weights'), ({'weights': [1.0, 2.0]}, 'weights.*6'),
    ({'weights': [1e5, 1.0, 1.0, 1.0, 1.0, 1.0]}, 'weights: 100000 is more than 10000 times 1'),
    ({'preferred': 500.0}, 'preferred: expected thrusts up to 400'),
    ({'preferred': np.nan}, 'preferred'), ({'preferred': 'hover'}, 'preferred')])
def test_a_wrong_option_is_named(options, fault):
    with pytest.raises(ValueError, match=fault):
        make_allocator('exact', Vehicle.load('hexarotor'), **options)
