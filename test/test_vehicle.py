"""The vehicle: from parameters to bounds and speeds."""

from dataclasses import FrozenInstanceError
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros import ParameterError, Vehicle
from ca_ros.detection.hypothesis_test import HypothesisTest
from ca_ros.firmware.faults import arms_of
from ca_ros.problem.vehicle_problem import VehicleProblem
from strategies import FLEET, HEXAROTOR, PARAMETERS, SOME, build, file_values, ring, vehicles


def test_the_hexarotor_of_the_paper():
    # f = k_f omega^2: 2.5e-5 * 40^2 = 0.04 N and 2.5e-5 * 400^2 = 4 N.
    assert HEXAROTOR.n == 6
    assert HEXAROTOR.weight == pytest.approx(9.81)
    assert HEXAROTOR.thrust_min == pytest.approx(0.04)
    assert HEXAROTOR.thrust_max == pytest.approx(4.0)
    assert HEXAROTOR.axes == ('thrust', 'roll', 'pitch', 'yaw')
    np.testing.assert_array_equal(HEXAROTOR.inertia, np.diag([0.015, 0.015, 0.03]))
    np.testing.assert_allclose(HEXAROTOR.arms, ring(6), atol=1e-15)


def test_a_shipped_vehicle_loads_from_any_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.testing.assert_array_equal(Vehicle.load('hexarotor').arms, HEXAROTOR.arms)


def test_a_vehicle_loads_from_a_path(tmp_path, monkeypatch):
    shipped = Path(__file__).parent.parent / 'config' / 'hexarotor.yaml'
    own = tmp_path / 'own.yaml'
    own.write_text(shipped.read_text().replace('mass: 1.0', 'mass: 2.5'))
    monkeypatch.chdir(tmp_path)
    for path in (own, str(own), 'own.yaml'):
        assert Vehicle.load(path).mass == 2.5


def test_an_unknown_vehicle_is_named_beside_those_that_there_are():
    with pytest.raises(ParameterError, match=r'hexarotr.*hexarotor'):
        Vehicle.load('hexarotr')


def test_scalars_stand_for_all_rotors_and_lists_for_each():
    one = build(ring(4), 'PNPN', speed_max=500.0)
    each = build(ring(4), 'PNPN', speed_max=[500.0, 600.0, 700.0, 800.0])
    np.testing.assert_array_equal(one.speed_max, [500.0] * 4)
    np.testing.assert_array_equal(each.speed_max, [500.0, 600.0, 700.0, 800.0])


def test_arms_begin_at_the_centre_of_mass():
    vehicle = build(ring(4), 'PNPN', {'vehicle.center_of_mass': [0.1, -0.05, 0.02]})
    np.testing.assert_allclose(vehicle.arms, ring(4) - [0.1, -0.05, 0.02])


def on_ring(n, **ring):
    """Make a vehicle of n rotors on a ring that its parameters describe."""
    given = {name: value for name, value in PARAMETERS.items() if name != 'rotors.positions'}
    return Vehicle.from_parameters(given | {
        'rotors.spins': ['cw', 'ccw'] * (n // 2), 'rotors.ring.count': n,
        **{f'rotors.ring.{name}': value for name, value in ring.items()}})


def test_a_ring_gives_the_positions_of_the_paper():
    values = file_values('hexarotor')
    del values['rotors.positions']
    vehicle = Vehicle.from_parameters(
        values | {'rotors.ring.count': 6, 'rotors.ring.radius': 0.4})
    np.testing.assert_allclose(vehicle.arms, HEXAROTOR.arms, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(
        on_ring(4, radius=0.3, first_angle=-45.0, height=0.1).arms,
        ring(4, radius=0.3, first=-np.pi / 4, height=0.1), atol=1e-15)


@pytest.mark.parametrize(('n', 'first'), [(6, 0.0), (6, 30.0), (8, 0.0), (8, 22.5), (12, 15.0)])
def test_a_ring_is_symmetric_to_the_last_bit(n, first):
    places = {tuple(place) for place in on_ring(n, radius=0.37, first_angle=first).arms.tolist()}
    for x, y in ((-1.0, 1.0), (1.0, -1.0)):
        assert places == {(x * a + 0.0, y * b + 0.0, c) for a, b, c in places}
    assert n % 4 or places == {(b, a, c) for a, b, c in places}


@pytest.mark.parametrize(('changes', 'words'), [
    ({}, 'rotors.positions: missing; expected x, y, z of each rotor [m], or rotors.ring'),
    ({'positions': [0.4] * 18, 'ring.count': 6, 'ring.radius': 0.4},
     'rotors.positions: given beside rotors.ring; expected one of them'),
    ({'ring.count': 6}, 'rotors.ring.radius: missing'),
    ({'ring.radius': 0.4}, 'rotors.ring.count: missing'),
    ({'ring.count': 6.5, 'ring.radius': 0.4}, 'rotors.ring.count: must be a whole number'),
    ({'ring.count': 8, 'ring.radius': 0.4}, 'rotors.spins: expected 8 words'),
    ({'ring': 6}, 'rotors.ring: no such parameter'),
    ({'ring.cuont': 6}, 'did you mean rotors.ring.count'),
])
def test_a_wrong_ring_is_named(changes, words):
    values = file_values('hexarotor')
    del values['rotors.positions']
    with pytest.raises(ParameterError) as caught:
        Vehicle.from_parameters(
            values | {f'rotors.{name}': value for name, value in changes.items()})
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_axes_are_made_unit_vectors():
    vehicle = build(ring(4), 'PNPN', axes=[0.0, 0.0, 7.0])
    np.testing.assert_array_equal(vehicle.rotor_axes, [[0.0, 0.0, 1.0]] * 4)


def test_inertia_may_be_a_matrix():
    rows = [0.02, 0.001, 0.0, 0.001, 0.03, -0.002, 0.0, -0.002, 0.04]
    vehicle = build(ring(4), 'PNPN', {'vehicle.inertia': rows})
    np.testing.assert_array_equal(vehicle.inertia, np.reshape(rows, (3, 3)))


def test_health_is_the_share_of_thrust_that_is_left():
    vehicle = HEXAROTOR.with_health([1.0, 0.5, 0.0, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(vehicle.thrust_max, [4.0, 2.0, 0.0, 4.0, 4.0, 4.0])
    np.testing.assert_allclose(vehicle.thrusts([200.0] * 6), [1.0, 0.5, 0.0, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(
        vehicle.speeds([1.0, 0.5, 0.0, 1.0, 1.0, 1.0]), [200.0, 200.0, 0.0, 200.0, 200.0, 200.0])
    assert np.all(HEXAROTOR.health == 1.0)


@pytest.mark.parametrize('health', [
    1, 0.5, np.nan, [1.1] * 6, [-0.1] * 6, [1.0] * 5, [[1.0] * 6], [1.0] * 5 + [np.inf], 'x',
    ['1'] * 6, True, None])
def test_health_is_a_share_per_rotor(health):
    with pytest.raises(ParameterError, match=r'rotors\.health'):
        HEXAROTOR.with_health(health)


def test_a_vehicle_does_not_change():
    with pytest.raises(FrozenInstanceError):
        HEXAROTOR.mass = 2.0
    problem = VehicleProblem(HEXAROTOR)
    for array in (
            HEXAROTOR.health, HEXAROTOR.arms, HEXAROTOR.thrust_max, *HEXAROTOR.speed_limits,
            problem.gamma, problem.lower, problem.hover, problem.center):
        with pytest.raises(ValueError, match='read-only'):
            array[0] = 0.0


@pytest.mark.parametrize('thrusts', [
    [1.0, 1.0, 1.0, 4.1, 1.0, 1.0], [1.0, 1.0, 1.0, -1e-3, 1.0, 1.0],
    [[1.0] * 6, [1.0, 1.0, 1.0, np.nan, 1.0, 1.0]]])
def test_speeds_for_thrusts_out_of_bounds_are_refused(thrusts):
    with pytest.raises(ValueError, match=r'of rotor 4, expected 0\.04 to 4 N'):
        HEXAROTOR.speeds(thrusts)


@pytest.mark.parametrize('thrusts', [1.0, [1.0] * 5, [[1.0] * 7] * 6])
def test_speeds_for_another_number_of_rotors_are_refused(thrusts):
    with pytest.raises(ValueError, match='shape'):
        HEXAROTOR.speeds(thrusts)


def test_speeds_for_thrusts_a_rounding_error_beyond_the_bounds_are_the_bounds():
    beyond = [4.0 + 1e-10, 0.04 - 1e-10] * 3
    for thrusts in (beyond, [beyond] * 2):
        np.testing.assert_array_equal(
            HEXAROTOR.speeds(thrusts), np.broadcast_to([400.0, 40.0] * 3, np.shape(thrusts)))


@given(vehicles(rank=False), st.data())
def test_speeds_give_the_thrusts_and_keep_their_bounds(vehicle, data):
    share = np.array(data.draw(st.lists(
        st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 1.0)),
        min_size=vehicle.n, max_size=vehicle.n)))
    low, high = vehicle.thrust_min, vehicle.thrust_max
    thrusts = np.where(share == 1.0, high, np.minimum(low + share * (high - low), high))
    speeds, lost = vehicle.speeds(thrusts), vehicle.health == 0.0
    assert np.all(speeds[lost] == 0.0)
    assert np.all((vehicle.speed_min <= speeds) & (speeds <= vehicle.speed_max) | lost)
    np.testing.assert_allclose(vehicle.thrusts(speeds), thrusts, rtol=1e-14)


@pytest.mark.parametrize('name', SOME)
def test_speeds_of_many_thrusts_are_those_of_each(name):
    vehicle = FLEET[name]
    thrusts = np.random.default_rng(0).uniform(
        vehicle.thrust_min, vehicle.thrust_max, (5, vehicle.n))
    np.testing.assert_array_equal(
        vehicle.speeds(thrusts), [vehicle.speeds(row) for row in thrusts])


def pair(apart, **others):
    """Return a vehicle of 8 rotors of which two, 1 and 5, are above each other but for `apart`."""
    positions = np.vstack([ring(4, 0.25), ring(4, 0.25) + np.r_[apart, 0.05]])
    positions[5:] *= 1.5
    return Vehicle(
        mass=1.0, positions=positions, spins=('ccw',) * 4 + ('cw',) * 4, torque_coefficient=1e-7,
        thrust_coefficient=1e-5, speed_min=0.0, speed_max=500.0, **others)


@pytest.mark.parametrize(('vehicle', 'pairs'), [
    (Vehicle.load('x8'), [(1, 2), (3, 4), (5, 6), (7, 8)]),
    (Vehicle.load('y6'), [(1, 2), (3, 4), (5, 6)]),
    (Vehicle.load('octorotor'), []), (Vehicle.load('rov'), []), (Vehicle.load('azimuth_boat'), []),
    # Shares of the mean arm, 0.31 m.
    (pair((0.08 * 0.31, 0.0)), [(1, 5)]), (pair((0.12 * 0.31, 0.0)), []),
    # Rotors that tilt far push on other lines.
    (pair((0.0, 0.0), tilt_axes=[1.0, 0.0, 0.0], tilt_min=-0.5, tilt_max=0.5), [(1, 5)]),
    (pair((0.0, 0.0), tilt_axes=[1.0, 0.0, 0.0], tilt_min=-1.0, tilt_max=1.0), []),
])
def test_one_rule_says_which_rotors_are_coaxial(vehicle, pairs):
    """The detector names their arms, and firmware and allocators serve them."""
    partners = {i: j for pair in pairs for i, j in (pair, pair[::-1])}
    expected = [partners.get(i + 1, 0) - 1 for i in range(vehicle.n)]
    assert [-1 if each is None else each for each in vehicle.partners] == expected
    assert HypothesisTest(vehicle, vehicle.wrenches).partners == vehicle.partners
    assert arms_of(vehicle) == pairs
    half = np.full(vehicle.n, 0.5)
    assert vehicle.with_health(half, pairs).failed_arms == tuple(pairs)
    # An arm that has failed stays one.
    assert vehicle.with_health(half, pairs).partners == vehicle.partners
    for i, j in combinations(range(1, vehicle.n + 1), 2):
        if (i, j) not in pairs:
            with pytest.raises(ParameterError, match='expected two rotors on the same axis'):
                vehicle.with_health(half, [(i, j)])
