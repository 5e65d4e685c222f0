"""The kernel in C against the NumPy implementation, and against hostile input."""

import copy
import dataclasses
import pickle
import sys
import warnings

import numpy as np
import pytest

from ca_ros import AdmissibleSet, Status, make_allocator
from ca_ros.allocation.box_backend import kernel_for
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.result import Allocation
from ca_ros.kernel import INVALID, load, warn_if_missing
from ca_ros.problem.audit import audit
from ca_ros.problem.vehicle_problem import VehicleProblem
from strategies import FLEET, HEXAROTOR, SOME, around, length, need_kernel, random_vehicle, seeded

VEHICLES = length(6, 30, 1000)
"""How many random vehicles."""

POLICIES = {'prioritize': {}, 'allow': {'axis_reversal': 'allow'},
            'scale': {'policy': 'scale'}, 'reject': {'policy': 'reject'},
            'yaw first': {'order': ['yaw', 'roll pitch', 'thrust']}}

need_kernel()


@pytest.fixture
def pair(monkeypatch):
    """Return a function that makes the same allocator with the kernel and with NumPy."""
    def make(problem, **options):
        engines = []
        for engine in ('c', 'numpy'):
            monkeypatch.setenv('CA_ROS_KERNEL', engine)
            engines.append(make_allocator('exact', problem, **options))
        assert [a.engine for a in engines] == ['C', 'NumPy']
        return engines
    return make


def compare(kernel, reference, demands, slack=1e-12):
    """Hold the answers of two engines against each other, and both against the problem."""
    problem = kernel.problem
    answers = kernel.allocate_batch(demands), reference.allocate_batch(demands)
    sizes = np.maximum(1.0, np.linalg.norm(demands, axis=1))
    for a in answers:
        assert np.all((problem.lower <= a.thrusts) & (a.thrusts <= problem.upper))
        exact = a.status == Status.EXACT
        assert np.all(np.linalg.norm(a.residual, axis=1)[exact] <= slack * sizes[exact])
    ours, theirs = answers
    np.testing.assert_array_equal(ours.status, theirs.status)
    # Where one of them makes use of the slack, the wrenches differ, and with them the thrusts.
    apart = np.linalg.norm(ours.wrench - theirs.wrench, axis=1) / sizes
    assert np.all(apart <= max(slack, 1e-11))
    norms = [np.linalg.norm(a.thrusts, axis=1)[apart <= 1e-11] for a in answers]
    np.testing.assert_allclose(*norms, rtol=0.0, atol=1e-9 * max(1.0, problem.upper.max()))
    np.testing.assert_allclose(ours.level, theirs.level, rtol=0.0, atol=1e-8)
    return ours


@pytest.mark.parametrize('policy', POLICIES)
@pytest.mark.parametrize('name', SOME)
def test_it_answers_as_numpy_does(name, policy, pair):
    options = dict(POLICIES[policy])
    if 'order' in options and name == 'tilted_hexarotor':
        options['order'] = [*options['order'], 'force_x force_y']
    engines = pair(VehicleProblem(FLEET[name]), **options)
    for demands in around(engines[0].problem, seeded(7), 20):
        compare(*engines, demands)


@pytest.mark.parametrize('seed', range(VEHICLES))
def test_it_answers_as_numpy_does_for_random_vehicles(seed, pair):
    rng = seeded(seed)
    problem = VehicleProblem(random_vehicle(rng, 4 + seed % 13))
    drawn = around(problem, rng, 29)
    # With the default slack some wrenches near facets that are almost parallel are missed by it.
    for slack in (0.0, 1e-9):
        engines = pair(problem, residual_slack=slack)
        for demands in drawn:
            compare(*engines, demands, max(slack, 1e-12))


@pytest.mark.parametrize('name', SOME)
def test_an_answer_depends_on_the_wrench_alone(name):
    allocator = make_allocator('exact', VehicleProblem(FLEET[name]))
    demands = np.vstack(around(allocator.problem, seeded(8), 50))
    batch = allocator.allocate_batch(demands)
    backwards = allocator.allocate_batch(demands[::-1])
    singles = np.array([allocator.allocate(u).thrusts for u in demands])
    np.testing.assert_array_equal(batch.thrusts, backwards.thrusts[::-1])
    np.testing.assert_array_equal(batch.thrusts, singles)


@pytest.mark.parametrize('name', SOME)
def test_the_margin_is_the_distance_to_the_facets(name):
    problem = VehicleProblem(FLEET[name])
    kernel = kernel_of(problem)
    for demands in around(problem, seeded(10), 10):
        margins = AdmissibleSet(problem).margin(demands)
        np.testing.assert_allclose(
            [kernel.margin(u) for u in demands], margins, rtol=0.0, atol=1e-9)


def kernel_of(problem, precision='double', dtype=np.float64):
    settings = ExactSettings(order=[[axis] for axis in problem.axes])
    return kernel_for(load(precision), problem, settings, dtype)


@pytest.mark.parametrize('name', SOME)
def test_in_single_precision_wrenches_are_given_to_1e_5(name):
    problem = VehicleProblem(FLEET[name])
    kernel = kernel_of(problem, 'single', np.float32)
    for kind, demands in enumerate(around(problem, seeded(11), 100)):
        for u in demands.astype(np.float32):
            thrusts = np.empty(problem.n, np.float32)
            answer = kernel.allocate(u, np.empty_like(u), thrusts)
            assert np.all(problem.lower.astype(np.float32) <= thrusts)
            assert np.all(thrusts <= problem.upper.astype(np.float32))
            missed = np.linalg.norm(u - problem.gamma @ thrusts)
            if kind == 0:
                assert answer is None
            if answer is None:
                assert missed <= 1e-5 * max(1.0, np.linalg.norm(u))
            else:
                assert answer[0] == Status.PRIORITIZED


HOSTILE = [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e100, 1e-300, 5e-324, -0.0, 0.0]


@pytest.mark.parametrize(('precision', 'dtype'), [('double', np.float64), ('single', np.float32)])
def test_hostile_wrenches_get_a_status_and_thrusts_within_their_bounds(precision, dtype):
    rng = seeded(12)
    for name in ('hexarotor', 'asymmetric', 'tilted_hexarotor'):
        problem = VehicleProblem(FLEET[name])
        kernel, m = kernel_of(problem, precision, dtype), len(problem.axes)
        demands = rng.choice(HOSTILE, (2000, m)) * rng.choice([1.0, 1e-3], (2000, m))
        demands[::2, rng.integers(m)] = rng.normal(size=1000)
        with np.errstate(over='ignore'):
            demands = demands.astype(dtype)
        thrusts, levels = np.empty((2000, problem.n), dtype), np.empty(2000, dtype)
        status = np.empty(2000, np.int8)
        kernel.allocate_batch(demands, thrusts, status, levels, None)
        assert np.all((problem.lower.astype(dtype) <= thrusts)
                      & (thrusts <= problem.upper.astype(dtype)))
        bad = ~np.isfinite(demands).all(axis=1)
        assert np.all(status[bad] == INVALID)
        assert np.all((levels >= 0.0) & (levels <= 1.0))


@pytest.mark.parametrize(('changes', 'message'), [
    ({'gamma': np.full((4, 6), np.nan)}, 'not finite'),
    ({'upper': np.full(6, np.inf)}, 'not finite'),
    ({'lower': np.full(6, 9.0)}, 'above its upper'),
    ({'gamma': np.ones((4, 6))}, 'independently'),
    ({'order': [0, 1, 2, 2]}, 'order'),
    ({'group': [0, 2, 2, 3]}, 'order'),
    ({'order': list(range(7)), 'group': [0] * 7, 'keep_sense': [0] * 7}, 'too many')])
def test_a_problem_that_is_none_is_refused(changes, message):
    problem = VehicleProblem(HEXAROTOR)
    data = {'gamma': problem.gamma, 'lower': problem.lower, 'upper': problem.upper,
            'reference': problem.hover, 'order': [1, 2, 0, 3], 'group': [0, 0, 1, 2],
            'keep_sense': [0, 0, 0, 1], 'policy': 1, 'on_reference': False, 'slack': 1e-9}
    with pytest.raises(ValueError, match=message):
        load()(**data | changes)


@pytest.mark.parametrize('array', [np.zeros(3), np.zeros((2, 2)), np.zeros(4, np.float16),
                                   np.zeros(4, '>f8'), np.zeros(4, int), np.empty(4, 'V0')])
def test_arrays_of_another_kind_are_refused(array):
    kernel = kernel_of(VehicleProblem(HEXAROTOR))
    with pytest.raises((TypeError, ValueError, BufferError)):
        kernel.allocate(array, np.empty(4), np.empty(6))


def test_a_kernel_without_a_problem_says_so():
    kernel = load().__new__(load())
    for use in (lambda: kernel.allocate(np.empty(4), np.empty(4), np.empty(6)),
                lambda: kernel.allocate_batch(*[np.empty(0)] * 4, None),
                lambda: kernel.margin(np.empty(4))):
        with pytest.raises(ValueError, match='no problem'):
            use()


def test_a_kernel_keeps_its_problem():
    kernel = kernel_of(VehicleProblem(HEXAROTOR))
    with pytest.raises(ValueError, match='another Kernel'):
        kernel.__init__(np.ones((1, 1)), np.zeros(1), np.ones(1), np.zeros(1), [0], [0], [0], 1,
                        False, 0.0)


@pytest.mark.parametrize(
    'twin', [copy.copy, copy.deepcopy, lambda a: pickle.loads(pickle.dumps(a))])
def test_copies_give_the_same_answers(twin):
    allocator = make_allocator(
        'exact', HEXAROTOR, policy='scale', scale_reference=[12.0, 0.1, 0.0, 0.0])
    for u in ([9.81, 0.1, 0.0, 0.0], [9.81, 3.0, 1.0, 0.2]):
        one, other = allocator.allocate(u), twin(allocator).allocate(u)
        np.testing.assert_array_equal(one.thrusts, other.thrusts)
        assert (one.status, one.level) == (other.status, other.level)


FIELDS = [field.name for field in dataclasses.fields(Allocation)]


def test_both_engines_make_equal_answers(pair):
    upper = 0.8 * HEXAROTOR.thrust_max
    seen = set()
    for options in ({}, {'policy': 'reject'}, {'preferred': 1.0}):
        for u in ([9.81, 0.1, 0.0, 0.0], [9.81, 3.0, 1.0, 0.2]):
            for bounds in ((), (HEXAROTOR.thrust_min, upper)):
                answers = [
                    each.allocate_within(u, *bounds) if bounds else each.allocate(u)
                    for each in pair(HEXAROTOR, **options)
                ]
                seen.add(answers[0].status)
                for answer in answers:
                    copied = pickle.loads(pickle.dumps(answer))
                    given = {name: getattr(answer, name) for name in FIELDS}
                    plain, replaced = Allocation(**given), dataclasses.replace(answer)
                    assert repr(plain) == repr(replaced) == repr(answer)
                    assert repr(dataclasses.replace(copied, **given)) == repr(answer)
                    assert str(copied) == str(answer)
                    for each in (plain, replaced, copied):
                        assert vars(each).keys() == vars(answer).keys()
                    assert dataclasses.replace(answer, level=0.25).level == 0.25
                    with pytest.raises(dataclasses.FrozenInstanceError):
                        answer.level = 0.0
                one, other = answers
                assert vars(one).keys() == vars(other).keys()
                assert (one.status, one.violation) == (other.status, other.violation)
                assert one.level == pytest.approx(other.level)
                np.testing.assert_array_equal(one.demand, other.demand)
                np.testing.assert_allclose(one.thrusts, other.thrusts, atol=1e-9)
    assert seen == {
        Status.EXACT, Status.PRIORITIZED, Status.REJECTED, Status.RATE_LIMITED}


@pytest.mark.parametrize('convert', [
    list, tuple, lambda u: np.array(u, np.float32), lambda u: np.array([u, u]).T[:, 0],
    lambda u: np.array(u, '>f8'), lambda u: np.array(u).view(Subclass),
    lambda u: [int(each) for each in u], lambda u: np.array(u, np.int16),
])
def test_other_kinds_of_numbers_are_converted_and_copied(pair, convert):
    given = [10.0, 0.0, -1.0, 0.0]
    for allocator in pair(HEXAROTOR):
        u = convert(given)
        for answer in (allocator.allocate(u), allocator.allocate_within(
                u, HEXAROTOR.thrust_min, HEXAROTOR.thrust_max)):
            expected = allocator.allocate(np.array(given))
            np.testing.assert_array_equal(answer.thrusts, expected.thrusts)
            assert type(answer.demand) is np.ndarray
            assert answer.demand.tolist() == given
            assert not np.shares_memory(answer.demand, np.asarray(u))


class Subclass(np.ndarray):
    """An array of another class."""


@pytest.mark.parametrize('u', [
    ['1', '2', '3', '4'], [True] * 4, np.ma.array(np.ones(4), mask=[1, 0, 0, 0]), None,
    [1.0j] * 4, np.ones((1, 4)), np.ones(3), [[1.0]] * 4, np.array([None] * 4), [np.nan] * 4,
    np.ones(4, bool), np.array([1e200, 0, 0, 0]), np.ones(4, 'm8[s]'),
])
def test_what_is_no_wrench_is_refused(pair, u):
    for allocator in pair(HEXAROTOR):
        for use in (allocator.allocate, lambda u, own=allocator: own.allocate_within(
                u, HEXAROTOR.thrust_min, HEXAROTOR.thrust_max)):
            with pytest.raises(ValueError, match=r'^wrench: '):
                use(u)


def test_a_wrong_choice_of_the_engine_is_named(monkeypatch):
    monkeypatch.setenv('CA_ROS_KERNEL', 'fortran')
    with pytest.raises(ValueError, match=r'CA_ROS_KERNEL.*fortran'):
        make_allocator('exact', HEXAROTOR)


def test_a_thrust_that_would_move_an_axis_at_its_goal_is_no_choice():
    # The second axis reaches its goal without a pivot and stays basic. With two rotors that move
    # and two axes there is one solution, here the thrusts themselves.
    gamma = np.array([[2.2, -0.3, -0.9], [0.1, -0.6, 0.9]])
    lower, upper = np.array([0.0, 0.0, 0.5]), np.array([1.0, 1.0, 0.5])
    expected = np.array([0.06, 0.53, 0.5])
    for order in ([0, 1], [1, 0]):
        kernel = load()(gamma, lower, upper, gamma @ (lower + upper) / 2, order, [0, 1], [0, 1], 1,
                        False, 1e-9)
        thrusts = np.empty(3)
        assert kernel.allocate(gamma @ expected, np.empty(2), thrusts) is None
        np.testing.assert_allclose(thrusts, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('name', SOME)
def test_it_answers_as_numpy_does_with_rotors_lost(name, pair):
    rng = seeded(13)
    for lost in range(min(FLEET[name].n, 3)):
        health = np.ones(FLEET[name].n)
        health[lost] = 0.0
        problem = audit(FLEET[name].with_health(health)).independent
        engines = pair(problem, residual_slack=0.0)
        for demands in around(problem, rng, 40):
            compare(*engines, demands)


def test_the_first_use_without_the_extensions_warns_once(monkeypatch):
    for name in ('double', 'double_4'):
        monkeypatch.setitem(sys.modules, f'ca_ros.kernel._{name}', None)
    monkeypatch.delenv('CA_ROS_KERNEL', raising=False)
    warn_if_missing.cache_clear()
    with pytest.warns(RuntimeWarning, match='NumPy, .* install gcc and the headers') as found:
        engines = [make_allocator('exact', HEXAROTOR).engine for _ in range(2)]
    assert (engines, len(found)) == (['NumPy'] * 2, 1)
    # Who asks for NumPy gets no warning.
    monkeypatch.setenv('CA_ROS_KERNEL', 'numpy')
    warn_if_missing.cache_clear()
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        make_allocator('exact', HEXAROTOR)
