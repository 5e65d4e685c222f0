"""Why: the shares served and the rotors that limit them, from multipliers."""

import numpy as np
import pytest

from ca_ros import AdmissibleSet, Status, Vehicle, make_allocator
from ca_ros.problem.limits import BY_BOUND, BY_HEALTH
from ca_ros.problem.vehicle_problem import VehicleProblem
from strategies import FLEET, HEXAROTOR, SOME, length, need_kernel, unaudited

LIMITS = [1.0, 0.0, [0.3, 0.1]]


@pytest.mark.parametrize('name', SOME)
def test_both_engines_name_the_same(name, monkeypatch):
    need_kernel()
    problem = VehicleProblem(FLEET[name])
    rng = np.random.default_rng(3)
    demands = problem.center + rng.uniform(-2.0, 2.0, (length(10, 60), problem.gamma.shape[0])) \
        * problem.extent
    for limit in LIMITS:
        made = []
        for engine in ('c', 'numpy'):
            monkeypatch.setenv('CA_ROS_KERNEL', engine)
            made.append(make_allocator('exact', problem, airmode_limit=limit))
        for u in demands:
            ours, theirs = (allocator.allocate(u).explanation for allocator in made)
            np.testing.assert_allclose(ours.served, theirs.served, atol=1e-8)
            assert ours.margin == pytest.approx(theirs.margin, abs=1e-9)
            # Where rotors are alike, other multipliers prove the same.
            if name == 'asymmetric':
                np.testing.assert_array_equal(ours.limit, theirs.limit)
                np.testing.assert_allclose(ours.gain, theirs.gain, atol=1e-7)
                np.testing.assert_allclose(ours.airmode, theirs.airmode, atol=1e-7)


@pytest.mark.parametrize('name', ['hexarotor', 'asymmetric'])
def test_a_multiplier_is_what_the_last_axis_gains_if_a_bound_moves(name):
    problem = VehicleProblem(FLEET[name])
    exact, rng, checked = unaudited('exact', FLEET[name]), np.random.default_rng(1), 0
    yaw = problem.axes.index('yaw')
    for u in problem.center + rng.uniform(-1.2, 1.2, (30, 4)) * problem.extent:
        u[yaw] = 3.0 * problem.extent[yaw] * np.sign(u[yaw] or 1.0)
        answer = exact.allocate(u)
        why = answer.explanation
        if np.any(why.served[:yaw] < 1.0):
            continue
        for i in np.flatnonzero(why.gain[yaw])[:2]:
            upper, lower, step = problem.upper.copy(), problem.lower.copy(), 1e-6
            if why.limit[i] > 0:
                upper[i] += step
            else:
                lower[i] -= step
            moved = problem.bounded(lower, upper)
            served = AdmissibleSet(moved).prioritize(u)
            gained = (served - answer.wrench)[yaw] * np.sign(u[yaw])
            assert gained == pytest.approx(why.gain[yaw, i] * step, rel=1e-3, abs=1e-13)
            checked += 1
    assert checked > 5


def test_a_rotor_at_a_bound_that_limits_nothing_is_not_named():
    # By hand: yaw of 0.08 (f_P - f_N), all of a kind alike, is served in full with f_N = 0.04.
    exact = make_allocator('exact', HEXAROTOR)
    answer = exact.allocate([9.81, 0.0, 0.0, 0.03])
    assert answer.status is Status.EXACT
    np.testing.assert_array_equal(answer.explanation.limit, 0)
    np.testing.assert_array_equal(answer.explanation.served, 1.0)
    assert str(answer.explanation).startswith('all axes are served; margin')


def test_by_hand_and_in_words():
    # Yaw 0.06 (f_P - f_N) with f_P + f_N = 7 N: f_P = 4, f_N = 3, so 0.06 N m of 0.12.
    why = make_allocator('exact', HEXAROTOR, thrust_deviation='allow').allocate(
        [21.0, 0.0, 0.0, 0.12]).explanation
    np.testing.assert_allclose(why.served, [1.0, 1.0, 1.0, 0.5], atol=1e-9)
    np.testing.assert_array_equal(why.limit, [BY_BOUND, 0] * 3)
    assert why.limits == {'yaw': 'rotors 1, 3, 5 at their maximum'}
    assert str(why) == 'yaw 50 % served, limited by rotors 1, 3, 5 at their maximum'


@pytest.mark.parametrize('engine', ['c', 'numpy'])
def test_where_all_rotors_are_at_a_bound_none_is_left_out(engine, monkeypatch):
    if engine == 'c':
        need_kernel()
    monkeypatch.setenv('CA_ROS_KERNEL', engine)
    for name in ('quadrotor', 'hexarotor', 'x8'):
        vehicle = Vehicle.load(name)
        rotors = ', '.join(str(i + 1) for i in range(vehicle.n))
        why = make_allocator('exact', vehicle).allocate([100.0, 0.0, 0.0, 0.0]).explanation
        assert why.limits == {'thrust': f'rotors {rotors} at their maximum'}
        np.testing.assert_allclose(why.gain[0], 1.0)


def test_a_lost_rotor_is_not_one_at_its_minimum():
    vehicle = Vehicle.load('hexarotor').with_health([0.0, 1.0, 1.0, 0.5, 1.0, 1.0])
    exact = make_allocator('exact', VehicleProblem(vehicle))
    # Rotor 1 is forward: it would lift the nose.
    answer = exact.allocate([12.0, 0.0, -4.0, 0.0])
    why = answer.explanation
    assert why.served[2] < 1.0
    assert why.limit[0] == BY_HEALTH
    assert 'rotor 1 which is lost' in why.limits['pitch']
    assert 'rotor 4 by its health' in exact.allocate(
        [12.0, 0.0, 4.0, 0.0]).explanation.limits['pitch']


def test_a_limit_on_airmode_is_named():
    why = make_allocator('exact', HEXAROTOR, airmode_limit=0.1).allocate(
        [0.1, 1.5, 0.0, 0.0]).explanation
    assert why.airmode[1] > 0.0
    assert 'the limit on airmode' in why.limits['roll']


@pytest.mark.parametrize('method', ['pseudo_inverse', 'direct', 'sequential_desaturation'])
def test_other_methods_are_explained_too(method):
    allocator = make_allocator(method, HEXAROTOR)
    why = allocator.allocate([9.81, 3.0, 0.0, 0.0]).explanation
    assert why.margin < 0.0
    assert why.served[1] < 1.0
    assert 'rotor' in why.limits['roll']
    inside = allocator.allocate([9.81, 0.0, 0.0, 0.0]).explanation
    assert inside.limits == {}
