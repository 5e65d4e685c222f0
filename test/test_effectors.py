"""Effectors of a problem without a vehicle: another matrix, failures, lost axes."""

import pickle

import numpy as np
import pytest

from ca_ros import (
    ALLOCATORS,
    AllocationProblem,
    Exact,
    ParameterError,
    SlewLimited,
    Status,
    Vehicle,
    audit,
    make_allocator,
)
from ca_ros.allocation.exact_settings import POLICIES
from ca_ros.solver.convex_sets import Interval, Sector
from strategies import length

PLANE = AllocationProblem(
    [[0.0, -4.2, 4.2, 0.0], [1.6, -1.2, -1.2, 0.0], [0.0, 0.0, 0.0, -0.9]], -0.5, 0.5,
    axes=['roll', 'pitch', 'yaw'],
    effector_names=['canards', 'right elevon', 'left elevon', 'rudder'])
"""The rudder alone yaws."""


def problems(count, seed=3):
    """Yield random problems whose reference is inside, a generator of numbers, and demands."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        m = int(rng.integers(2, 5))
        n = m + int(rng.integers(1, 6))
        lower = rng.uniform(-3.0, -0.5, n)
        problem = AllocationProblem(rng.normal(size=(m, n)), lower, rng.uniform(0.5, 3.0, n))
        yield problem, rng, problem.center + rng.normal(size=(6, m)) * problem.extent


@pytest.mark.parametrize('method', ALLOCATORS)
def test_another_matrix_gives_the_bits_of_a_new_problem(method):
    for problem, rng, demands in problems(length(6, 40)):
        names = ['thrust', 'roll', 'pitch', 'yaw'][:len(problem.axes)]
        problem = AllocationProblem(problem.gamma, problem.lower, problem.upper, axes=names)
        other = problem.gamma + 0.2 * rng.normal(size=problem.gamma.shape)
        found = ALLOCATORS[method](problem).with_matrix(other)
        new = ALLOCATORS[method](
            AllocationProblem(other, problem.lower, problem.upper, axes=names))
        np.testing.assert_array_equal(
            found.allocate_batch(demands).thrusts, new.allocate_batch(demands).thrusts)
        # The one that is asked stays as it is, and its matrix gives its bits again.
        again = found.with_matrix(problem.gamma)
        np.testing.assert_array_equal(
            again.allocate_batch(demands).thrusts,
            ALLOCATORS[method](problem).allocate_batch(demands).thrusts)


@pytest.mark.parametrize('policy', POLICIES)
def test_failures_by_the_laws_of_a_problem_of_what_is_left(policy):
    for problem, rng, demands in problems(length(15, 100)):
        health = rng.choice([0.0, 0.5, 1.0], problem.n, p=[0.2, 0.2, 0.6])
        one = int(rng.integers(problem.n))
        stuck = {one + 1: float(rng.uniform(problem.lower[one], problem.upper[one]))}
        sound = Exact(problem, policy=policy)
        failed = sound.with_health(health, stuck=stuck)
        rest = np.where(health > 0.0, 1.0, 0.0)
        assert failed.problem.axes == problem.axes
        kept = [axis for axis in problem.axes if axis not in failed.lost_axes]
        rows = [problem.axes.index(axis) for axis in kept]
        lower, upper = problem.lower * rest, problem.upper * rest
        lower[one] = upper[one] = stuck[one + 1]
        left = AllocationProblem(problem.gamma[rows] * health, lower, upper, axes=kept)
        sure = failed.audit.keeps_hovering
        for u in demands:
            answer = failed.allocate(u)
            wrench = problem.gamma @ (health * answer.thrusts)
            np.testing.assert_allclose(answer.residual, u - wrench, atol=1e-12)
            exact = problem.is_exact(u, health * answer.thrusts)
            assert (answer.status is Status.EXACT) == exact
            assert answer.thrusts[one] == stuck[one + 1]
            assert not np.delete(answer.thrusts * (health == 0.0), one).any()
            if sure and policy != 'prioritize':
                # Lost axes leave the demand before these policies act.
                other = Exact(left, policy=policy).allocate(u[rows])
                np.testing.assert_allclose(answer.thrusts, other.thrusts, atol=1e-9)
        # Health is absolute.
        np.testing.assert_array_equal(
            failed.with_health(np.ones_like(health), stuck={}).allocate_batch(demands).thrusts,
            sound.allocate_batch(demands).thrusts)
        np.testing.assert_array_equal(
            failed.with_matrix(problem.gamma).allocate_batch(demands).thrusts,
            failed.allocate_batch(demands).thrusts)


@pytest.mark.parametrize('policy', POLICIES)
def test_a_jammed_rudder_by_hand(policy):
    sound = Exact(PLANE, policy=policy)
    jammed = sound.with_health(np.ones(4), stuck={4: 0.1})
    answer = jammed.allocate([0.5, 0.5, 0.2])
    # The rudder yaws by -0.09, and the elevons have no yaw.
    np.testing.assert_allclose(answer.wrench, [0.5, 0.5, -0.09], atol=1e-12)
    assert answer.thrusts[3] == 0.1
    assert jammed.lost_axes == ('yaw',)
    assert str(answer.explanation) == 'all other axes are served; margin 1.3; yaw is lost'
    assert 'yaw lost (the allocation matrix has rank 2 for 3 axes)' in str(jammed.audit)
    assert 'rotor' not in f'{jammed!r} {jammed.audit} {answer!r} {answer.explanation}'
    assert repr(jammed).startswith('Exact: 4 effectors, axes roll, pitch, yaw')
    # A lost one rests, and its yaw is zero.
    assert sound.with_health([1, 1, 1, 0]).allocate([0.5, 0.5, 0.2]).wrench[2] == 0.0
    # A weak one has half of its effect.
    weak = sound.with_health([1, 1, 1, 0.5]).allocate([0.0, 0.0, 0.2])
    assert weak.thrusts[3] == pytest.approx(-0.2 / 0.45)
    copied = pickle.loads(pickle.dumps(jammed))
    np.testing.assert_array_equal(copied.allocate([0.5, 0.5, 0.2]).thrusts, answer.thrusts)
    assert answer.certificate.kkt_residual < 1e-12


def test_the_audit_of_a_problem():
    report = audit(PLANE)
    assert (report.lost, report.rank, report.sound) == ((), 3, True)
    assert report.independence['yaw'] == pytest.approx(1.0)
    assert report.authority['yaw'] == pytest.approx((-0.45, 0.45))
    report = audit(PLANE.with_health(np.ones(4), stuck={4: 0.1}))
    assert (report.lost, report.sound) == (('yaw',), False)
    # Axes with names of their own are given up from the last one on.
    flat = AllocationProblem([[1.0, 1.0], [0.5, 0.5], [1.0, -1.0]], -1.0, 1.0)
    assert audit(flat).lost == ('axis_2',)
    parts = AllocationProblem(flat.gamma[:2], -1.0, 1.0)
    assert audit(parts).lost == ('axis_2',)
    with pytest.raises(ParameterError, match='this problem is refused: axis_2 lost'):
        make_allocator('exact', flat, lost_axes='refuse')
    assert make_allocator('exact', flat, lost_axes='drop').problem.axes == ('axis_1', 'axis_3')
    with pytest.raises(TypeError, match='has no vehicle'):
        _ = report.vehicle


ROWS = AllocationProblem(
    [[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]], -0.5, 0.5,
    axes=['roll', 'pitch', 'yaw'])


@pytest.mark.parametrize('method', ['exact', 'pseudo_inverse', 'weighted_least_squares'])
@pytest.mark.parametrize('failure', [
    {'health': [0, 0, 0, 1]}, {'health': np.ones(4), 'stuck': {1: 0.0, 2: 0.0, 3: 0.0}}])
@pytest.mark.parametrize('problem', [ROWS, PLANE])
def test_an_axis_with_a_sound_effector_of_its_own_stays(problem, failure, method):
    """Two lost axes come before yaw in the order, and yaw has an effector."""
    left = make_allocator(method, problem).with_health(**failure)
    assert left.lost_axes == ('roll', 'pitch')
    np.testing.assert_allclose(left.allocate([0.0, 0.0, 0.2]).wrench, [0.0, 0.0, 0.2], atol=1e-5)


def test_what_is_left_of_six_axes_has_the_rank_of_the_matrix():
    problem = AllocationProblem.load('omnidirectional_hexarotor')
    # Rotors 5 and 6 have no part in thrust and yaw.
    left = Exact(problem).with_health([0, 0, 0, 0, 1, 1])
    assert left.lost_axes == ('force_x', 'force_y', 'thrust', 'yaw')
    answer = left.allocate([0.0, 0.0, 1.0, 0.3, 0.2, 0.0])
    np.testing.assert_allclose(answer.wrench[3:5], [0.3, 0.2], atol=1e-12)


def test_all_effectors_stuck():
    stuck = Exact(PLANE).with_health(np.ones(4), stuck=dict.fromkeys((1, 2, 3, 4), 0.1))
    answer = stuck.allocate([0.1, 0.0, 0.0])
    assert (answer.status, answer.thrusts.tolist()) == (Status.INEXACT, [0.1] * 4)
    assert stuck.with_health(np.ones(4), stuck={}).allocate([0.1, 0.0, 0.0]).is_exact


def test_all_effectors_lost():
    answer = Exact(PLANE).with_health(np.zeros(4)).allocate([0.1, 0.0, 0.0])
    assert (answer.status, np.abs(answer.thrusts).max()) == (Status.INEXACT, 0.0)


def test_vectors_in_sets_are_lost_and_weak():
    boat = AllocationProblem(
        [[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]], axes=['surge', 'sway'],
        sets=[Sector(np.pi, 2.0), Interval(0.2, 1.0)])
    sound = Exact(boat)
    weak = sound.with_health([0.5, 1.0])
    u = [0.8, 0.3]
    np.testing.assert_allclose(weak.allocate(u).residual, 0.0, atol=1e-12)
    # The second thruster alone pushes along (1, 1).
    lost = sound.with_health([0.0, 1.0])
    assert lost.lost_axes == ('sway',)
    np.testing.assert_allclose(lost.allocate([0.4, 0.3]).thrusts, [0.0, 0.0, 0.8], atol=1e-12)
    with pytest.raises(ParameterError, match='vectors in sets cannot stick'):
        sound.with_health([1, 1], stuck={1: 0.3})


def test_rates_keep_another_matrix_and_failures():
    slow = SlewLimited(Exact(PLANE), rates=1.0)
    for changed in (slow.with_matrix(2.0 * PLANE.gamma), slow.with_health([1, 0, 1, 1])):
        answer = changed.allocate([1.0, 0.5, 0.1], np.zeros(4), 0.1)
        assert np.abs(answer.thrusts).max() <= 0.1


@pytest.mark.parametrize(('change', 'words'), [
    (lambda a: a.with_matrix(np.ones((2, 4))), r'expected shape \(3, 4\), .* got \(2, 4\)'),
    (lambda a: a.with_matrix(np.full((3, 4), np.nan)), 'matrix: expected finite numbers'),
    (lambda a: a.with_matrix(np.ones((3, 4))), 'has no volume: the effectors cannot control'),
    (lambda a: a.with_matrix(1e-9 * np.ones((3, 4))), 'choose units'),
    (lambda a: a.with_health([1.0, 1.0]), 'health: expected 4 numbers .* one for each effector'),
    (lambda a: a.with_health(1), r'health: expected 4 numbers in \[0, 1\], .* got 1'),
    (lambda a: a.with_health([1, 1, 1.5, 1]), r'health: expected 4 numbers in \[0, 1\]'),
    (lambda a: a.with_health(np.ones(4), stuck={5: 0.0}), 'no effector 5; there are 4'),
    (lambda a: a.with_health(np.ones(4), stuck={4: 0.7}), 'rudder at 0.7: .* bounds, -0.5 to 0.5'),
])
def test_misuse_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        change(Exact(PLANE))


def test_the_matrix_of_a_vehicle_is_that_of_its_rotors():
    with pytest.raises(TypeError, match='follows from its rotors'):
        Exact(Vehicle.load('x8')).with_matrix(np.ones((4, 8)))
