"""Laws: what is remembered changes no answer, and what is proven is true."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros import AdmissibleSet, Status
from ca_ros.allocation import allocator as allocator_module
from ca_ros.allocation.exact import LAW_SHARE
from ca_ros.problem.problem import EXACT_TOLERANCE
from ca_ros.solver import region_memory as laws_module
from strategies import FLEET, HEXAROTOR, build, demands, ring, vehicles
from strategies import unaudited as make_allocator

LEARNERS = ('exact', 'conventional', 'direct')


def samples(vehicle, size, seed=0):
    """Draw wrenches (size, m) in the admissible set, and some half as far out again."""
    inside = AdmissibleSet(vehicle).sample(np.random.default_rng(seed), size)
    centre = AdmissibleSet(vehicle).center
    return np.vstack([inside, centre + 1.5 * (inside - centre)])


def thrusts(allocator, wrenches):
    """Allocate one after the other."""
    return np.array([allocator.allocate(u).thrusts for u in wrenches])


def test_the_hexarotor_has_37_laws_and_all_are_proven():
    allocator = make_allocator('exact', HEXAROTOR)
    allocator.allocate_batch(AdmissibleSet(HEXAROTOR).sample(np.random.default_rng(0), 20_000))
    assert len(allocator._laws) == 37
    assert all(law.proven for law in allocator._laws._laws)


@pytest.mark.parametrize('name', FLEET)
def test_a_proven_law_is_exact_wherever_it_is_used(name):
    vehicle = FLEET[name]
    allocator = make_allocator('exact', vehicle)
    gamma, proven = allocator.problem.gamma, 0
    for u in samples(vehicle, 500):
        allocator.allocate(u)
        found = allocator._laws.find(u)
        if found is not None and allocator._laws.proven:
            proven += 1
            # The sums of this line round too, hence not LAW_SHARE.
            assert np.linalg.norm(u - gamma @ found) <= EXACT_TOLERANCE * max(
                1.0, np.linalg.norm(u))
            assert np.all((vehicle.thrust_min <= found) & (found <= vehicle.thrust_max))
    assert proven > 400
    assert LAW_SHARE <= 0.5


@pytest.mark.parametrize('method', LEARNERS)
@given(data=st.data())
def test_warm_and_cold_give_the_same_thrusts(method, data):
    vehicle = data.draw(vehicles())
    wrenches = np.array(data.draw(st.lists(demands(vehicle), min_size=2, max_size=5)))
    warm, size = make_allocator(method, vehicle), 1.0 + vehicle.thrust_max.max()
    first = thrusts(warm, wrenches)
    cold = np.array([make_allocator(method, vehicle).allocate(u).thrusts for u in wrenches[::-1]])
    for other in (thrusts(warm, wrenches[::-1])[::-1], cold[::-1]):
        residuals = (first - other) @ warm.problem.gamma.T
        np.testing.assert_allclose(residuals, 0.0, atol=1e-8 * size)
        np.testing.assert_allclose(first, other, rtol=0.0, atol=1e-7 * size)


@pytest.mark.parametrize('method', LEARNERS)
@pytest.mark.parametrize('most', [1, 3])
def test_laws_that_are_forgotten_change_no_answer(method, most, monkeypatch):
    wrenches = samples(HEXAROTOR, 100)
    expected = thrusts(make_allocator(method, HEXAROTOR), wrenches)
    monkeypatch.setattr(laws_module, 'LAWS_MAX', most)
    monkeypatch.setattr(laws_module, 'GROWTH', 1)
    forgetful = make_allocator(method, HEXAROTOR)
    np.testing.assert_allclose(thrusts(forgetful, wrenches), expected, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(
        forgetful.allocate_batch(wrenches).thrusts, expected, rtol=0.0, atol=1e-8)
    assert len(forgetful._laws) == most


@pytest.mark.parametrize('name', FLEET)
def test_what_has_been_served_once_is_looked_up_from_then_on(name, monkeypatch):
    # Also on the boundary of the set, where a vehicle that saturates spends its time.
    vehicle = FLEET[name]
    allocator = make_allocator('exact', vehicle)
    wrenches = samples(vehicle, 100)
    for u in wrenches:
        first = allocator.allocate(u)
        monkeypatch.setattr(allocator._least_norm, 'solve', None)
        again = allocator.allocate(u)
        monkeypatch.undo()
        np.testing.assert_allclose(again.thrusts, first.thrusts, rtol=0.0, atol=1e-9)
        assert again.status is first.status


@pytest.mark.slow
def test_memory_is_bounded_where_there_are_more_regions_than_laws():
    vehicle = build(ring(12), 'PN' * 6)
    allocator = make_allocator('exact', vehicle)
    statuses = {allocator.allocate(u).status for u in samples(vehicle, 2000)}
    assert statuses == {Status.EXACT, Status.PRIORITIZED}
    assert len(allocator._laws) == laws_module.LAWS_MAX
    assert len(allocator._laws._rows) == laws_module.LAWS_MAX * (2 * 12 + 1)


def test_borders_of_regions_are_served_from_either_side():
    # On a border one rotor has just come to its bound: where the pseudo-inverse does, for one.
    inverse = np.linalg.pinv(make_allocator('exact', HEXAROTOR).problem.gamma)
    rng, allocator = np.random.default_rng(1), make_allocator('exact', HEXAROTOR)
    hover = allocator.problem.hover
    for way in rng.normal(size=(200, 4)) * [3.0, 1.0, 1.0, 0.05]:
        start, rate = inverse @ hover, inverse @ way
        bounds = np.where(rate > 0.0, HEXAROTOR.thrust_max, HEXAROTOR.thrust_min)
        border = hover + ((bounds - start) / rate).min() * way
        answers = [allocator.allocate(border + step * way) for step in (-1e-13, 0.0, 1e-13)]
        assert {a.status for a in answers} == {Status.EXACT}
        np.testing.assert_allclose(
            [a.thrusts for a in answers], [inverse @ border] * 3, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize('policy', ['prioritize', 'scale', 'reject'])
def test_a_batch_of_several_chunks_is_its_wrenches_one_by_one(policy, monkeypatch):
    monkeypatch.setattr(allocator_module, 'CHUNK', 7)
    wrenches = samples(HEXAROTOR, 30)
    single = make_allocator('exact', HEXAROTOR, policy=policy)
    batch = make_allocator('exact', HEXAROTOR, policy=policy).allocate_batch(wrenches)
    answers = [single.allocate(u) for u in wrenches]
    np.testing.assert_array_equal(batch.status, [a.status for a in answers])
    np.testing.assert_allclose(batch.thrusts, [a.thrusts for a in answers], atol=1e-9)
    np.testing.assert_allclose(batch.level, [a.level for a in answers], atol=1e-9)
    assert len(set(batch.status.tolist())) == 2


@pytest.mark.parametrize('method', ['exact', 'pseudo_inverse', 'direct', 'conventional'])
def test_an_answer_stays_when_the_caller_uses_its_array_again(method):
    allocator = make_allocator(method, HEXAROTOR)
    u = np.array([9.81, 0.2, 0.0, 0.01])
    one, batch = allocator.allocate(u), allocator.allocate_batch(u[None])
    u[:] = 0.0
    for answer in (one, batch):
        np.testing.assert_array_equal(np.ravel(answer.demand), [9.81, 0.2, 0.0, 0.01])
    with pytest.raises(AttributeError):
        one.thrusts = u
