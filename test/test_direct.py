"""Direct allocation: direction kept, as far as another linear program goes, Eqs. (14)-(17)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros import Status
from strategies import HEXAROTOR, demands, reach, vehicles
from strategies import unaudited as make_allocator


def check(vehicle, u, a):
    """Check direction, greatest alpha and vertex; u is not zero."""
    size = np.linalg.norm(u)
    alpha = reach(vehicle, np.zeros(len(u)), u / size, limit=size, method='highs-ipm')
    if a.status is Status.REJECTED:
        assert alpha is None
        return
    assert a.status in (Status.EXACT, Status.SCALED)
    assert (a.level == 1.0) == (a.status is Status.EXACT)
    scale = 1.0 + np.linalg.norm(a.wrench)
    np.testing.assert_allclose(a.wrench, a.level * u, rtol=0.0, atol=1e-11 * scale)
    assert a.level * size == pytest.approx(alpha, rel=1e-6, abs=1e-6)
    # A vertex: no more rotors between their bounds than equations, and one less if alpha is free.
    room = np.minimum(a.thrusts - vehicle.thrust_min, vehicle.thrust_max - a.thrusts)
    between = np.sum(room > 1e-9 * (1.0 + vehicle.thrust_max))
    assert between <= len(u) - (0.0 < a.level < 1.0)


@given(st.data())
def test_it_goes_as_far_as_possible_in_the_direction_of_the_demand(data):
    vehicle = data.draw(vehicles())
    u = data.draw(demands(vehicle))
    if np.linalg.norm(u) > 1e-6:
        check(vehicle, u, make_allocator('direct', vehicle).allocate(u))


def test_hover_is_given_by_rotors_at_their_bounds():
    # Opposite rotors alike give no torque but yaw, and pairs of 4, 0.04 and x N add up to 9.81 N
    # with x = (9.81 - 8.08) / 2 = 0.865 N: sqrt(0.865 / 2.5e-5) = 186.01 rad/s.
    a = make_allocator('direct', HEXAROTOR).allocate([9.81, 0.0, 0.0, 0.0])
    assert a.status is Status.EXACT
    np.testing.assert_allclose(
        np.sort(a.speeds), [40.0, 40.0, 186.011, 186.011, 400.0, 400.0], atol=1e-3)


def test_a_level_worked_out_by_hand():
    # 30 N are 24 N too much by 4 / 5.
    a = make_allocator('direct', HEXAROTOR).allocate([30.0, 0.0, 0.0, 0.0])
    assert a.status is Status.SCALED
    assert a.level == pytest.approx(0.8, rel=1e-9)
    np.testing.assert_allclose(a.thrusts, 4.0, rtol=1e-12)


@pytest.mark.parametrize('u', [
    [0.0, 0.0, 0.0, 0.0], [-9.81, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.1, 0.0, 0.0, 0.05]])
def test_a_ray_that_misses_the_set_is_rejected(u):
    # The least thrust is 0.24 N, and with it goes no torque.
    a = make_allocator('direct', HEXAROTOR).allocate(u)
    assert a.status is Status.REJECTED
    np.testing.assert_array_equal(a.saturation, -1)
    assert a.level == 0.0
