"""The admissible set against convex hulls, linear programs and the volumes of its parts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros import AdmissibleSet, ParameterError, control_allocation_matrix
from strategies import (
    FLEET,
    HEXAROTOR,
    build,
    demands,
    middle,
    random_vehicle,
    reach,
    ring,
    seeded,
    vehicles,
)

SOME = {name: FLEET[name] for name in ('hexarotor', 'y6', 'asymmetric')} | {
    f'random with {n} rotors': random_vehicle(seeded(n), n) for n in (4, 7)}


def test_the_hexarotor_has_22_facets_and_a_volume_known_by_hand():
    # Three columns span a facet.  Opposite columns add up to (2, 0, 0, 0), all pairs alike, so two
    # pairs span but one, with all four triples from them: 3 facets.  Another 2^3 = 8 triples take
    # one rotor from each pair.  All of them come twice, on either side of the centre.
    # Volume = sum over the choices of 4 rotors of |det Gamma_4| times their ranges, 3.96^4.
    gamma = control_allocation_matrix(HEXAROTOR)
    admissible = AdmissibleSet(HEXAROTOR)
    assert len(admissible.facets[0]) == 22
    total = sum(abs(np.linalg.det(np.delete(gamma, [i, j], axis=1)))
                for i in range(6) for j in range(i))
    assert admissible.volume == pytest.approx(3.96**4 * total, rel=1e-12)
    np.testing.assert_allclose(admissible.center, [12.12, 0.0, 0.0, 0.0], atol=1e-14)


def test_the_quadrotor_is_a_parallelepiped():
    # Four columns, 2 facets each; volume |det Gamma| 3.96^4 = 16 a^2 k 3.96^4 for arms (a, a).
    quadrotor = FLEET['quadrotor']
    admissible = AdmissibleSet(quadrotor)
    assert len(admissible.facets[0]) == 8
    a = 0.4 / np.sqrt(2.0)
    assert admissible.volume == pytest.approx(16.0 * a * a * 0.02 * 3.96**4)


@given(st.data())
def test_it_contains_what_a_linear_program_can_allocate(data):
    vehicle = data.draw(vehicles())
    u = data.draw(demands(vehicle))
    center = middle(vehicle)
    share = reach(vehicle, center, u - center, limit=2.0)
    admissible = AdmissibleSet(vehicle)
    if abs(share - 1.0) > 1e-6:
        assert admissible.contains(u) == (share > 1.0)
    else:
        assert admissible.contains(u, tolerance=1e-4)


@pytest.mark.parametrize('name', SOME)
def test_margin_is_the_distance_to_the_boundary(name):
    # No way out is shorter than the margin, and one is as short.
    vehicle, rng = SOME[name], seeded(0)
    admissible = AdmissibleSet(vehicle)
    normals, offsets = admissible.facets
    for u in admissible.sample(rng, 5):
        margin = admissible.margin(u)
        for direction in rng.normal(size=(5, len(u))):
            assert reach(vehicle, u, direction / np.linalg.norm(direction)) >= margin - 1e-8
        nearest = normals[np.argmin(offsets - normals @ u)]
        assert reach(vehicle, u, nearest) == pytest.approx(margin, abs=1e-8)


def test_margins_worked_out_by_hand():
    # With the hexarotor at the least thrust of all, 0.24 N, it is at a vertex; 1 N less is 1 N
    # outside.  At its centre the yaw is the weakest: 0.02 * 1.98 * 6 = 0.2376 N m.
    admissible = AdmissibleSet(HEXAROTOR)
    assert admissible.margin([0.24, 0.0, 0.0, 0.0]) == pytest.approx(0.0, abs=1e-14)
    assert not admissible.contains([-0.76, 0.0, 0.0, 0.0])
    assert 0.0 < admissible.margin([12.12, 0.0, 0.0, 0.0]) <= 0.2376 + 1e-14
    assert admissible.contains([12.12, 0.0, 0.0, 0.2375])
    assert not admissible.contains([12.12, 0.0, 0.0, 0.2377])


def test_margin_and_contains_of_many_are_those_of_each():
    admissible = AdmissibleSet(HEXAROTOR)
    wrenches = admissible.center + seeded(0).normal(size=(3, 5, 4))
    margins = admissible.margin(wrenches)
    assert margins.shape == (3, 5)
    np.testing.assert_allclose(
        margins, [[admissible.margin(u) for u in row] for row in wrenches], rtol=1e-12)
    np.testing.assert_array_equal(admissible.contains(wrenches), margins >= 0.0)


@given(st.data())
def test_scale_goes_as_far_as_the_set_does(data):
    vehicle = data.draw(vehicles())
    u = data.draw(demands(vehicle))
    admissible = AdmissibleSet(vehicle)
    about = data.draw(st.sampled_from([None, admissible.center]))
    start = admissible.reference if about is None else about
    assert admissible.contains(start)
    served = admissible.scale(u, about)
    size = np.linalg.norm(admissible.center) + 1.0
    assert admissible.contains(served, tolerance=1e-12 * size)
    if admissible.contains(u):
        np.testing.assert_array_equal(served, u)
        return
    share = reach(vehicle, start, u - start, limit=1.0)
    np.testing.assert_allclose(served, start + share * (u - start), atol=1e-7 * size)


def test_scale_refuses_a_reference_outside():
    with pytest.raises(ValueError, match='scale_reference'):
        AdmissibleSet(HEXAROTOR).scale([30.0, 0.0, 0.0, 0.0], scale_reference=[0.0, 0.0, 0.0, 0.0])


def test_the_reference_is_hover_or_else_the_centre():
    # 40 N of weight are more than six rotors of 4 N lift.
    heavy = build(ring(6), 'PNPNPN', {'vehicle.mass': 40.0 / 9.81})
    np.testing.assert_allclose(AdmissibleSet(HEXAROTOR).reference, [9.81, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(AdmissibleSet(heavy).reference, AdmissibleSet(heavy).center)


@pytest.mark.parametrize('health', [
    [1.0, 0.0, 1.0, 1.0], [1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
def test_rotors_that_no_longer_command_all_axes_leave_no_volume(health):
    with pytest.raises(ValueError, match='thrust, roll, pitch, yaw'):
        AdmissibleSet(FLEET['quadrotor'].with_health(health))


def test_bounds_that_leave_no_room_leave_no_volume():
    stuck = build(ring(4), 'PNPN', speed_min=[40.0, 40.0, 40.0, 400.0])
    with pytest.raises(ValueError, match='volume'):
        AdmissibleSet(stuck)


@pytest.mark.parametrize('axes', [['thrust'], ['thrust', 'yaw'], ['roll', 'pitch', 'yaw']])
def test_any_axes_may_be_commanded(axes):
    vehicle = build(ring(6), 'PNPNPN', {'allocation.axes': axes})
    admissible = AdmissibleSet(vehicle)
    inside = middle(vehicle)
    assert admissible.contains(inside)
    assert admissible.margin(inside) == pytest.approx(min(
        reach(vehicle, inside, normal) for normal in admissible.facets[0]), abs=1e-8)


@pytest.mark.parametrize('u', [
    [9.81, 0.0, 0.0], [9.81, 0.0, 0.0, np.nan], [np.inf, 0.0, 0.0, 0.0], 9.81, None, 'hover'])
@pytest.mark.parametrize('query', ['margin', 'contains', 'scale', 'prioritize'])
def test_what_is_no_wrench_is_refused(query, u):
    with pytest.raises(ValueError, match='wrench') as caught:
        getattr(AdmissibleSet(HEXAROTOR), query)(u)
    assert not isinstance(caught.value, ParameterError)


# Sampling

@pytest.mark.parametrize('name', SOME)
def test_samples_are_uniform_by_volume(name):
    # Copies of half the size, about points of the set, have 1/16 of its volume (in 4 dimensions).
    vehicle, size = SOME[name], 20_000
    share = 0.5 ** len(vehicle.axes)
    low, high = vehicle.thrust_min, vehicle.thrust_max
    admissible, rng = AdmissibleSet(vehicle), seeded(0)
    samples = admissible.sample(rng, size)
    assert np.all(admissible.contains(samples, tolerance=1e-12))
    thrusts = rng.uniform(low, high, (10, vehicle.n))
    thrusts[5:] = np.where(rng.random((5, vehicle.n)) < 0.5, low, high)
    for about in (admissible.center, *thrusts @ control_allocation_matrix(vehicle).T):
        fraction = np.mean(admissible.contains(about + 2.0 * (samples - about)))
        assert abs(fraction - share) < 4.0 * np.sqrt(share * (1.0 - share) / size)


def test_what_is_no_generator_or_number_of_samples_is_named():
    admissible = AdmissibleSet(HEXAROTOR)
    with pytest.raises(TypeError, match=r'rng: expected a numpy\.random\.Generator, got 0'):
        admissible.sample(0, 3)
    with pytest.raises(ValueError, match='size: expected a number of wrenches, got -1'):
        admissible.sample(np.random.default_rng(), -1)
