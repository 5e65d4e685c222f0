"""Problems without a vehicle: any matrix, bounds of any sign, any names."""

import re

import numpy as np
import pytest

from ca_ros import (
    ALLOCATORS,
    AdmissibleSet,
    AllocationProblem,
    Interval,
    ParameterError,
    Sector,
    Status,
    Vehicle,
    make_allocator,
)
from ca_ros.allocation.rates import WithinRates
from ca_ros.problem.programs import lengths
from strategies import around, by_daqp, by_quadprog, length, seeded

PROBLEMS = length(8, 60, 1000)
"""How many random problems."""

ELEVONS = AllocationProblem(
    [[-2.0, 2.0], [-1.0, -1.0]], -0.5, 0.5,
    axes=['roll rate', 'pitch rate'], effector_names=['left', 'right'])


def random_problem(seed):
    """Return a problem with rows of very different sizes and bounds on any side of zero."""
    rng = seeded(seed)
    m = int(rng.integers(1, 7))
    n = int(rng.integers(m, 17))
    matrix = rng.normal(size=(m, n)) * 10.0 ** rng.uniform(-1.5, 1.5, (m, 1))
    lower = rng.normal(size=n) - rng.choice([0.0, 1.0, 20.0])
    upper = lower + 10.0 ** rng.uniform(-1.0, 1.0, n)
    # Some effectors are locked.
    upper = np.where((rng.random(n) < 0.1) & (np.arange(n) >= m), lower, upper)
    reference = rng.choice([0.0, 1.0]) * (matrix @ rng.uniform(lower, upper))
    return AllocationProblem(matrix, lower, upper, reference=reference), rng


@pytest.mark.parametrize('engine', ['c', 'numpy'])
@pytest.mark.parametrize('seed', range(PROBLEMS))
def test_exact_gives_u_with_the_least_norm(seed, engine, monkeypatch):
    monkeypatch.setenv('CA_ROS_KERNEL', engine)
    problem, rng = random_problem(seed)
    allocator = make_allocator('exact', problem, residual_slack=0.0)
    inside, border, outside = around(problem, rng, 8)
    for u in np.vstack([inside, border]):
        answer = allocator.allocate(u)
        if answer.status is not Status.EXACT:
            # The end of the line is on the boundary only up to rounding.
            assert lengths(answer.residual) <= 1e-9 * max(1.0, lengths(u))
            continue
        assert lengths(answer.residual) <= 1e-12 * max(1.0, lengths(u))
        assert np.all((problem.lower <= answer.thrusts) & (answer.thrusts <= problem.upper))
    for u in inside:
        thrusts = allocator.allocate(u).thrusts
        for solve in (by_quadprog, by_daqp):
            try:
                other = solve(problem.gamma, u, problem.lower, problem.upper)
            except ValueError:
                continue  # The other solver fails near a vertex.
            size = max(1.0, np.abs([problem.lower, problem.upper]).max())
            assert np.linalg.norm(thrusts) <= np.linalg.norm(other) + 1e-9 * size
    for u in outside:
        answer = allocator.allocate(u)
        assert answer.status is Status.PRIORITIZED
        assert np.all((problem.lower <= answer.thrusts) & (answer.thrusts <= problem.upper))


@pytest.mark.parametrize('method', ALLOCATORS)
@pytest.mark.parametrize('name', ['admire', 'omnidirectional_hexarotor'])
def test_every_method_takes_a_shipped_problem(method, name):
    problem = AllocationProblem.load(name)
    if 'thrust' not in problem.axes and method in ('sequential_desaturation', 'betaflight_mixer'):
        with pytest.raises(ValueError, match='needs thrust'):
            make_allocator(method, problem)
        return
    # Of harv some facets are almost parallel, where `exact` would use its slack.
    options = {'residual_slack': 0.0} if method == 'exact' else {}
    allocator = make_allocator(method, problem, **options)
    demands = np.vstack(around(problem, seeded(5), 20))
    answers = allocator.allocate_batch(demands)
    assert np.all((problem.lower <= answers.thrusts) & (answers.thrusts <= problem.upper))
    exact = answers.status == Status.EXACT
    reached = lengths(answers.residual) <= problem.tolerance(demands)
    np.testing.assert_array_equal(exact & ~reached, False)
    np.testing.assert_allclose(
        answers.thrusts, [allocator.allocate(u).thrusts for u in demands], rtol=0.0, atol=1e-12)


def test_a_problem_by_hand():
    # Roll takes (-1/4, 1/4) and pitch (-1/2, -1/2) per unit; the sum leaves its bounds at +-0.5.
    allocator = make_allocator('exact', ELEVONS)
    np.testing.assert_allclose(allocator.allocate([1.0, 0.5]).thrusts, [-0.5, 0.0], atol=1e-15)
    unattainable = allocator.allocate([2.0, 1.0])
    assert unattainable.status is Status.PRIORITIZED
    # One group of axes: the demand is scaled about zero, to half of it.
    np.testing.assert_allclose(unattainable.wrench, [1.0, 0.5], atol=1e-12)
    assert unattainable.level == pytest.approx(0.5)


def test_the_order_of_own_axes():
    allocator = make_allocator('exact', ELEVONS, order=[['pitch rate'], ['roll rate']])
    np.testing.assert_allclose(allocator.allocate([2.0, 1.0]).wrench, [0.0, 1.0], atol=1e-12)
    with pytest.raises(ValueError, match='order: expected groups that name each of roll rate'):
        make_allocator('exact', ELEVONS, order=[['pitch rate']])


def test_axes_that_vehicles_have_come_first_in_the_default_order():
    problem = AllocationProblem(
        [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]], -1.0, 1.0, axes=['drag', 'yaw'])
    answer = make_allocator('exact', problem).allocate([5.0, 2.0])
    np.testing.assert_allclose(answer.wrench, [2.0, 2.0], atol=1e-12)


@pytest.mark.parametrize(('method', 'options', 'upper'), [
    ('exact', {'policy': 'reject'}, [1.0, 2.0, -1.0]), ('direct', {}, [-0.5, 0.7, -1.0])])
def test_rejected_effectors_are_nearest_to_zero(method, options, upper):
    problem = AllocationProblem(np.ones((1, 3)), [-2.0, 0.5, -2.0], upper)
    # The sum of the direct allocator's effectors is always negative.
    answer = make_allocator(method, problem, **options).allocate([1e3])
    assert answer.status is Status.REJECTED
    np.testing.assert_array_equal(answer.thrusts, [min(upper[0], 0.0), 0.5, -1.0])


def test_saturation_at_negative_bounds():
    problem = AllocationProblem(np.eye(2), [-1e3, 1.0], [-1.0, 1e3])
    answer = make_allocator('exact', problem).allocate([-1.0, 1.0])
    np.testing.assert_array_equal(answer.saturation, [1, -1])


def test_a_certificate_names_the_effectors():
    text = str(make_allocator('exact', ELEVONS).allocate([0.9, 0.5]).certificate)
    assert 'to the facet with effector left at minimum' in text


def test_a_problem_has_no_rotor_speeds():
    with pytest.raises(TypeError, match='no vehicle'):
        _ = make_allocator('exact', ELEVONS).allocate([0.1, 0.1]).speeds


@pytest.mark.parametrize(('arguments', 'fault'), [
    (([1.0, 2.0], 0.0, 1.0), 'matrix: expected m rows'),
    ((np.ones((0, 3)), 0.0, 1.0), 'matrix: expected m rows'),
    (([['a']], 0.0, 1.0), 'matrix: expected numbers'),
    (([['1']], 0.0, 1.0), 'matrix: expected numbers'),
    (([[True]], 0.0, 1.0), 'matrix: expected numbers'),
    (([[1.0j]], 0.0, 1.0), 'matrix: expected numbers'),
    (([[1.0, 1.0]], 0.0, 1.0, {'a'}), 'axes: expected 1 different names'),
    ((np.full((6, 40), np.nan), 0.0, 1.0), 'matrix: expected finite numbers'),
    (([[1.0, 1.0]], [0.0, 0.0, 0.0], 1.0), 'lower: expected 1 or 2 numbers'),
    (([[1.0, 1.0]], 0.0, np.inf), 'upper: expected finite numbers'),
    (([[1.0, 1.0]], [0.0, 2.0], 1.0), "lower: 2 of '2' is above its upper bound, 1"),
    (([[1.0, 1.0]], 0.0, 1.0, ['a', 'b']), 'axes: expected 1 different names'),
    (([[1.0, 1.0]], 0.0, 1.0, 5), 'axes: expected 1 different names'),
    (([[1.0, 1.0]], 0.0, 1.0, [['a']]), 'axes: expected 1 different names'),
    (([[1.0, 1.0]], 0.0, 1.0, ['two\nlines']), 'axes: expected names of printable characters'),
    ((np.ones((1, 10**5)), 0.0, 1.0), 'matrix: expected up to 1000 effectors, got 100000'),
    (([[1.0, 1.0]], 0.0, 1.0, None, ['a', 'a']), 'names: expected 2 different names'),
    (([[1.0, 1.0]], 0.0, 1.0, None, None, [0.0, 0.0]), 'reference: expected 1 numbers'),
    (([[1.0, 1.0]], 0.0, 1.0, None, None, 0.0), 'reference: expected 1 numbers'),
    (([[1.0, 1.0], [1e-7, 0.0]], 0.0, 1.0), 'half of the range of axis_2 is 5e-08, too small'),
    (([[1e9, 1e9], [1.0, 0.0]], 0.0, 1.0), 'choose units in which it is at least 1e+03'),
])
def test_wrong_data_are_named(arguments, fault):
    with pytest.raises(ValueError, match=re.escape(fault)) as caught:
        AllocationProblem(*arguments)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('engine', ['c', 'numpy'])
@pytest.mark.parametrize(('matrix', 'upper'), [
    (np.ones((2, 3)), 1.0), ([[1.0, 1.0], [0.0, 0.0]], 1.0), (np.eye(2), 0.0),
    (np.ones((3, 2)), 1.0)])
@pytest.mark.filterwarnings('error')
def test_dependent_axes_are_named(matrix, upper, engine, monkeypatch):
    monkeypatch.setenv('CA_ROS_KERNEL', engine)
    problem = AllocationProblem(matrix, 0.0, upper)
    with pytest.raises(ValueError, match='the effectors cannot control axis_1, axis_2'):
        make_allocator('exact', problem)
    # The methods that approximate need no volume.
    for method in ('pseudo_inverse', 'conventional'):
        answer = make_allocator(method, problem).allocate(np.ones(len(problem.axes)))
        assert np.all((problem.lower <= answer.thrusts) & (answer.thrusts <= problem.upper))


def test_the_certificate_of_a_batch_is_a_summary():
    answers = make_allocator('exact', ELEVONS).allocate_batch([[0.1, 0.1], [9.0, 0.0]])
    text = str(answers.certificate)
    assert text.startswith('2 allocations: residual up to 7.0e+00')


def test_neither_vehicle_nor_problem():
    with pytest.raises(TypeError, match='expected a Vehicle or an AllocationProblem'):
        AdmissibleSet(np.eye(3))


@pytest.mark.parametrize(('text', 'fault'), [
    ('problem: {lower: 0, upper: 1}', 'problem.matrix: missing'),
    ('problem: {matrix: [[1]], lower: 0, upper: 1, bounds: 2}', 'problem.bounds: no such entry'),
    ('problem: {matrix: [[1, 2], [3]], lower: 0, upper: 1}', 'problem.matrix: expected numbers'),
    ('problem: 3', 'problem: expected matrix'),
    ('{problem: {matrix: [[1]], lower: 0, upper: 1}, rotors: 3}', 'rotors: expected only'),
    ('{problem: {matrix: [[1]], lower: 0, upper: 1}, allocation: [1]}', 'allocation: expected'),
    ('{problem: {matrix: [[1]], lower: 0, upper: 1, effector_names: 3}}', 'problem.effector_n'),
    ('{problem: {matrix: [[1]], lower: 0, upper: 1, effector_kind: 3}}', 'problem.effector_k'),
    ('{problem: {matrix: [[1]], lower: 0, upper: 1, axis_units: [N, m]}}', 'axis_units: exp'),
    ('/**: {ros__parameters: {}}', "no entry 'problem'"),
    ('{', 'not readable YAML'),
])
def test_wrong_files_are_named(tmp_path, text, fault):
    path = tmp_path / 'own.yaml'
    path.write_text(text)
    with pytest.raises(ParameterError, match=re.escape(fault)) as caught:
        AllocationProblem.load(path)
    assert str(path) in str(caught.value)
    assert '\n' not in str(caught.value)


def test_effectors_have_names_and_a_kind(tmp_path):
    path = tmp_path / 'own.yaml'
    path.write_text(
        'problem: {matrix: [[1, 1]], lower: 0, upper: 1, effector_names: [a, b], effector_kind: '
        'fins}')
    problem = AllocationProblem.load(path)
    assert problem.effector_names == ('a', 'b')
    answer = make_allocator('exact', problem).allocate([1.2])
    assert str(answer.certificate).endswith('to the facet with fins a, b at maximum')
    # In the middle no facet is the nearest.
    assert str(make_allocator('exact', problem).allocate([1.0]).certificate).endswith('margin 1')
    np.testing.assert_array_equal(answer.effectors, answer.thrusts)


def test_a_vehicle_is_not_read_from_the_file_of_a_problem():
    with pytest.raises(ParameterError, match=r'admire\.yaml: a problem without a vehicle'):
        Vehicle.load('admire')


# Sets, servos and state

@pytest.mark.parametrize('given', [
    {}, {'lower': 0.0}, {'upper': 1.0}, {'lower': 0.0, 'upper': 1.0, 'sets': [Interval(0, 1)]},
    {'lower': 0.0, 'sets': [Interval(0.0, 1.0)]},
], ids=str)
def test_a_problem_has_bounds_or_sets(given):
    with pytest.raises(TypeError, match='expected lower and upper, or sets'):
        AllocationProblem([[1.0]], **given)


def test_components_of_sets_are_as_many_as_columns():
    with pytest.raises(ValueError, match='sets: expected 3 components, got 2'):
        AllocationProblem(np.eye(3), sets=[Sector(0.5, 1.0)])


def test_the_angles_of_a_vehicle_without_servos_are_empty():
    allocator = make_allocator('exact', Vehicle.load('hexarotor'))
    answer = allocator.allocate([9.81, 0.1, 0.0, 0.0])
    assert answer.angles.shape == (0,)
    np.testing.assert_array_equal(answer.command, answer.speeds)
    batch = allocator.allocate_batch(np.tile([9.81, 0.0, 0.0, 0.0], (3, 1)))
    assert batch.angles.shape == (3, 0)


def test_the_angles_of_a_batch_are_those_of_its_answers():
    allocator = make_allocator('exact', Vehicle.load('tricopter'))
    hover = allocator.problem.reference
    batch = allocator.allocate_batch([hover, 1.1 * hover])
    alone = [allocator.allocate(u).angles for u in (hover, 1.1 * hover)]
    np.testing.assert_array_equal(batch.angles, alone)


@pytest.mark.parametrize('name', ['hexarotor_realistic', 'hexarotor_tilting'])
def test_answers_within_rates_leave_allocator_and_problem_as_they_are(name):
    vehicle = Vehicle.load(name)
    allocator = make_allocator('exact', vehicle)
    allocator.allocate(allocator.problem.reference).command  # noqa: B018 (what is cached)
    before = [{**vars(each)} for each in (allocator, allocator.problem)]
    rates, last = WithinRates(allocator), vehicle.idle_command
    first = rates.allocate(allocator.problem.reference, last, 10_000_000, 0)
    for size in (0.2, 3.0):
        rates.allocate(size * allocator.problem.reference, first.command, 30_000_000, 10_000_000)
    again = rates.allocate(allocator.problem.reference, last, 10_000_000, 0)
    assert again.command.tobytes() == first.command.tobytes()
    assert [{**vars(each)} for each in (allocator, allocator.problem)] == before


def test_osqp_is_judged_by_its_residual_and_depends_on_the_wrench_alone():
    pytest.importorskip('osqp')
    osqp = make_allocator('osqp', Vehicle.load('hexarotor'))
    rng, problem = seeded(1), osqp.problem
    wrenches = AdmissibleSet(problem).sample(rng, 20)
    answers = [osqp.allocate(u) for u in wrenches]
    for u, answer in zip(wrenches, answers, strict=True):
        exact = problem.is_exact(u, answer.thrusts)
        assert answer.status is (Status.EXACT if exact else Status.INEXACT)
        np.testing.assert_array_equal(osqp.allocate(u).thrusts, answer.thrusts)
    # A thrust of ten times the weight is not attainable.
    answer = osqp.allocate(10.0 * problem.reference)
    assert answer.status is Status.REJECTED
    np.testing.assert_array_equal(answer.thrusts, problem.resting_thrusts)
