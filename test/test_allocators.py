"""Laws that hold for every method, vehicle and demand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros import ALLOCATORS, AdmissibleSet, Status, control_allocation_matrix
from strategies import FLEET, HEXAROTOR, demands, vehicles
from strategies import unaudited as make_allocator

FIELDS = ('thrusts', 'speeds', 'wrench', 'residual', 'saturation', 'status', 'level', 'violation')

every_method = pytest.mark.parametrize('method', ALLOCATORS)


def check_laws(vehicle, u, a):
    gamma = control_allocation_matrix(vehicle)
    low, high = vehicle.thrust_min, vehicle.thrust_max
    for name in FIELDS:
        assert np.all(np.isfinite(getattr(a, name))), name
    # Bounds, to the last bit.
    assert np.all((low <= a.thrusts) & (a.thrusts <= high))
    lost = vehicle.health == 0.0
    assert np.all(a.thrusts[lost] == 0.0)
    assert np.all(a.speeds[lost] == 0.0)
    assert np.all((vehicle.speed_min <= a.speeds) & (a.speeds <= vehicle.speed_max) | lost)
    # What is reported is what the thrusts, and the speeds, give.
    wrench = sum(f * column for f, column in zip(a.thrusts, gamma.T, strict=True))
    rounding = 1e-14 * (np.abs(gamma) @ high + np.abs(u))
    assert np.all(np.abs(a.wrench - wrench) <= rounding)
    assert np.all(np.abs(a.residual - (u - wrench)) <= rounding)
    np.testing.assert_allclose(vehicle.thrusts(a.speeds), a.thrusts, rtol=1e-14)
    assert a.saturation.dtype == np.int8
    near = 1e-12 * np.maximum(1.0, high)
    np.testing.assert_array_equal(a.saturation == -1, a.thrusts <= low + near)
    np.testing.assert_array_equal(
        a.saturation == 1, (a.thrusts >= high - near) & (a.thrusts > low + near))
    # The status tells the truth.
    exact = np.linalg.norm(a.residual) <= 1e-12 * max(1.0, np.linalg.norm(u))
    assert (a.status is Status.EXACT) == exact
    assert 0.0 <= a.level <= 1.0
    assert a.violation >= 0.0


@every_method
@given(data=st.data())
def test_bounds_and_report(method, data):
    vehicle = data.draw(vehicles())
    u = data.draw(demands(vehicle))
    check_laws(vehicle, u, make_allocator(method, vehicle).allocate(u))


@pytest.mark.parametrize('policy', ['prioritize', 'scale', 'reject'])
@given(data=st.data())
def test_bounds_and_report_of_each_policy(policy, data):
    vehicle = data.draw(vehicles())
    u = data.draw(demands(vehicle))
    a = make_allocator('exact', vehicle, policy=policy).allocate(u)
    check_laws(vehicle, u, a)
    assert a.status in (Status.EXACT, Status[{
        'prioritize': 'PRIORITIZED', 'scale': 'SCALED', 'reject': 'REJECTED'}[policy]])
    admissible = AdmissibleSet(vehicle)
    if a.status is not Status.EXACT:
        assert not admissible.contains(u)
    if policy == 'scale':
        np.testing.assert_allclose(a.wrench, admissible.scale(u), atol=1e-11)
    if policy == 'prioritize':
        np.testing.assert_allclose(a.wrench, admissible.prioritize(u), atol=1e-11)
    if a.status is Status.REJECTED:
        np.testing.assert_array_equal(a.saturation, -1)


@pytest.mark.parametrize('method', ['pseudo_inverse', 'conventional'])
@given(data=st.data())
def test_bounds_and_report_where_rotors_do_not_command_all_axes(method, data):
    vehicle = data.draw(vehicles(rank=False))
    u = data.draw(demands(vehicle))
    check_laws(vehicle, u, make_allocator(method, vehicle).allocate(u))


ABSURD = np.array([
    [0.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [1e9, 3.0, 2.0, 1.0], [0.0, -1e12, 1e12, 5.0],
    [1e-320, 0.0, -1e-320, 0.0], [9.81, 1e-300, 0.0, 0.0], [1e30, -1e30, 0.0, 1e30],
    [1e99, -1e99, 0.0, 1e99]])


@every_method
@pytest.mark.parametrize('health', [[1.0] * 6, [0.0] + [1.0] * 5])
def test_bounds_and_report_for_absurd_demands(method, health):
    vehicle = HEXAROTOR.with_health(health)
    allocator = make_allocator(method, vehicle)
    for u in ABSURD:
        before = u.copy()
        check_laws(vehicle, u, allocator.allocate(u))
        np.testing.assert_array_equal(u, before)


NO_WRENCH = [
    ([9.81, -1e160, 0.0, 0.0], 'roll is -1e'), ([9.81, -1e308, 0.0, 0.0], 'roll is -1e'),
    ([9.81, 0.0, np.nan, 0.0], 'pitch is nan'), ([np.inf, 0.0, 0.0, 0.0], 'thrust is inf'),
    ([9.81, 0.0, 0.0], r'shape \(4,\).*\(3,\)'),
    ([[9.81, 0.0, 0.0, 0.0]], r'shape \(4,\).*\(1, 4\)'), (9.81, r'shape \(4,\)'), ([], r'\(0,\)'),
    ('hover', 'hover'), *((u, 'wrench: expected 4 numbers') for u in (
        None, '9.81', ['9', '0', '0', '0'], [True, False, False, False], [9.81, [0.0], 0.0, 0.0],
        [9.81 + 0.0j, 0.0, 0.0, 0.0], np.full(4, '2026-01-01', 'datetime64[D]'),
        np.array([9.81, 0.0, 0.0, 0.0], object),
        np.ma.array([9.81, 0.0, 0.0, 0.0], mask=[0, 1, 0, 0]), [None] * 4))]
NO_BATCH = [
    ([9.81, 0.0, 0.0, 0.0], r'\(4,\)'), (np.zeros((2, 3)), r'\(2, 3\)'),
    (np.zeros((2, 2, 4)), r'\(2, 2, 4\)'), ([['9', '0', '0', '0']], 'expected 4 numbers'),
    ([[9.81, 0.0, 0.0, 0.0], [9.81, 0.0, 0.0, np.nan]], 'yaw is nan')]


@every_method
def test_what_is_no_wrench_or_no_batch_is_refused_by_name_in_one_line(method):
    allocator = make_allocator(method, HEXAROTOR)
    for allocate, wrong in ((allocator.allocate, NO_WRENCH), (allocator.allocate_batch, NO_BATCH)):
        for u, words in wrong:
            with pytest.raises(ValueError, match=words) as caught:
                allocate(u)
            assert '\n' not in str(caught.value)


def assert_same(name, one, other, scale):
    """Compare a field of two answers up to rounding, which may put a rotor on its bound."""
    if name == 'status':
        np.testing.assert_array_equal(one, other)
    elif name not in ('saturation', 'speeds'):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * scale, err_msg=name)


@every_method
@given(data=st.data())
def test_a_batch_is_its_wrenches_one_by_one(method, data):
    vehicle = data.draw(vehicles())
    wrenches = np.array(data.draw(st.lists(demands(vehicle), min_size=1, max_size=4)))
    allocator = make_allocator(method, vehicle)
    batch = allocator.allocate_batch(wrenches)
    singles = [allocator.allocate(u) for u in wrenches]
    rounding = 1e-12 * (1.0 + np.abs(wrenches).max())
    for name in FIELDS:
        together, apart = getattr(batch, name), np.array([getattr(a, name) for a in singles])
        assert np.shape(together) == apart.shape, name
        # The root of a thrust of nearly zero is all rounding; both follow from the thrusts.
        if name not in ('saturation', 'speeds'):
            np.testing.assert_allclose(together, apart, rtol=1e-9, atol=rounding, err_msg=name)


def test_a_batch_counts_and_gives_its_answers():
    batch = make_allocator('exact', HEXAROTOR).allocate_batch([[12.0, 0, 0, 0], [12.0, 9, 0, 0]])
    assert str(batch) == '2 answers: 1 EXACT, 1 PRIORITIZED'
    assert [f'{answer.status}' for answer in batch] == ['EXACT', 'PRIORITIZED']
    np.testing.assert_array_equal(batch[1].thrusts, batch.thrusts[1])


@every_method
def test_an_empty_batch_has_empty_fields(method):
    batch = make_allocator(method, HEXAROTOR).allocate_batch(np.empty((0, 4)))
    assert batch.thrusts.shape == batch.speeds.shape == batch.saturation.shape == (0, 6)
    assert batch.wrench.shape == batch.residual.shape == (0, 4)
    assert batch.certificate.multipliers.shape == (0, 4)
    assert batch.status.shape == (0,)


@every_method
@given(data=st.data())
def test_the_answer_does_not_depend_on_the_calls_before(method, data):
    vehicle = data.draw(vehicles())
    u, *others = data.draw(st.lists(demands(vehicle), min_size=2, max_size=4))
    first = make_allocator(method, vehicle).allocate(u)
    allocator = make_allocator(method, vehicle)
    for other in others:
        allocator.allocate(other)
    with pytest.raises(ValueError, match='wrench'):
        allocator.allocate(np.full(len(u), np.nan))
    again = allocator.allocate(u)
    for name in FIELDS:
        assert_same(name, getattr(first, name), getattr(again, name), 1.0 + np.abs(u).max())


def test_an_unknown_method_is_refused_with_the_names_of_all():
    with pytest.raises(ValueError, match='exact, pseudo_inverse, conventional, direct'):
        make_allocator('exactly', HEXAROTOR)


@every_method
def test_an_unknown_option_is_refused(method):
    with pytest.raises(TypeError, match='has no setting colour'):
        make_allocator(method, HEXAROTOR, colour='red')


@pytest.mark.parametrize('method', ['direct', 'exact'])
def test_rotors_that_do_not_command_all_axes_are_refused_at_once(method):
    with pytest.raises(ValueError, match='thrust, roll, pitch, yaw'):
        make_allocator(method, FLEET['quadrotor'].with_health([0.0, 1.0, 1.0, 1.0]))


# The pseudo-inverse

@given(st.data())
def test_the_pseudo_inverse_is_exact_where_it_keeps_the_bounds(data):
    vehicle = data.draw(vehicles())
    u = data.draw(demands(vehicle))
    # Lost rotors are left out: they get nothing, and the others give their share.
    gamma = control_allocation_matrix(vehicle) * (vehicle.thrust_max > 0.0)
    wanted = np.linalg.lstsq(gamma, u)[0]
    a = make_allocator('pseudo_inverse', vehicle).allocate(u)
    outside = np.maximum(vehicle.thrust_min - wanted, wanted - vehicle.thrust_max).max()
    rounding = 1e-9 * (1.0 + np.abs(wanted).max())
    assert a.violation == pytest.approx(max(outside, 0.0), abs=rounding)
    saturated = np.minimum(np.maximum(wanted, vehicle.thrust_min), vehicle.thrust_max)
    np.testing.assert_allclose(a.thrusts, saturated, rtol=0.0, atol=rounding)
    if outside < 0.0:
        assert a.status is Status.EXACT


def test_the_pseudo_inverse_worked_out_by_hand():
    # The rows of the hexarotor's Gamma are orthogonal, of squared lengths 6, 0.48, 0.48, 0.0024:
    # 12 N and 0.06 N m of yaw are 12 / 6 +- 0.06 * 0.02 / 0.0024 = 2 +- 0.5 N.
    a = make_allocator('pseudo_inverse', HEXAROTOR).allocate([12.0, 0.0, 0.0, 0.06])
    np.testing.assert_allclose(a.thrusts, [2.5, 1.5, 2.5, 1.5, 2.5, 1.5])
    assert a.status is Status.EXACT
    assert str(a) == 'EXACT: thrust 12, roll 0, pitch 0, yaw 0.06'
    # Four times the yaw are 2 +- 2 N: rotors 2, 4, 6 would have to stand still, but give 0.04 N.
    a = make_allocator('pseudo_inverse', HEXAROTOR).allocate([12.0, 0.0, 0.0, 0.24])
    np.testing.assert_allclose(a.thrusts, [4.0, 0.04, 4.0, 0.04, 4.0, 0.04])
    np.testing.assert_allclose(a.residual, [-0.12, 0.0, 0.0, 0.0024], atol=1e-14)
    assert a.violation == pytest.approx(0.04)
    assert str(a) == 'INEXACT: thrust 12.12 of 12, roll 0, pitch 0, yaw 0.2376 of 0.24'
    assert a.status is Status.INEXACT
