"""The audit: what the rotors can command, as they are."""

import numpy as np
import pytest

from ca_ros import AdmissibleSet, ParameterError, Vehicle, audit
from ca_ros.parameter_files import load
from ca_ros.vehicle_audit import INDEPENDENCE_MIN


def without(vehicle, *rotors):
    """Return the vehicle with some rotors lost, counted from 1."""
    return vehicle.with_health([0.0 if i + 1 in rotors else 1.0 for i in range(vehicle.n)])


@pytest.fixture(scope='module')
def pnpnpn():
    return Vehicle.load('hexarotor')


@pytest.fixture(scope='module')
def ppnnpn():
    return Vehicle.load('hexarotor_ppnnpn')


@pytest.mark.parametrize(
    'name',
    ['hexarotor', 'hexarotor_ppnnpn', 'hexarotor_tilted', 'octorotor', 'quadrotor', 'x8', 'y6'],
)
def test_every_shipped_vehicle_is_sound(name):
    report = audit(Vehicle.load(name))
    assert report.sound
    assert report.rank == len(report.vehicle.axes)
    assert all(low < 0.0 < high for low, high in report.authority.values())


def test_the_authority_of_the_hexarotor_worked_out_by_hand(pnpnpn):
    # At hover each rotor gives 1.635 N. For yaw alone three rotors give t more and three t less,
    # 6 k t = 0.12 t N m; the first end is the lower bound of 0.04 N: 0.12 (1.635 - 0.04).
    low, high = audit(pnpnpn).authority['yaw']
    assert high == pytest.approx(0.02 * 6.0 * (1.635 - 0.04), rel=1e-12)
    assert low == pytest.approx(-high, rel=1e-12)
    # Thrust goes from 6 * 0.04 N to 6 * 4 N.
    assert audit(pnpnpn).authority['thrust'] == pytest.approx((0.24 - 9.81, 24.0 - 9.81))


@pytest.mark.parametrize('rotor', range(1, 7))
def test_pnpnpn_loses_hover_with_any_rotor(pnpnpn, rotor):
    report = audit(without(pnpnpn, rotor))
    assert report.lost == ('yaw',)
    # Just outside of the set, as every rotor keeps turning at 40 rad/s.
    assert -0.01 < report.hover_margin < 0.0
    assert report.kept_hover_margin > 0.0
    assert 'yaw lost' in str(report)
    # What is lost for the sake of hover is still commanded, with what the others leave.
    assert 'yaw' in report.vehicle.axes


@pytest.mark.parametrize('rotor', range(1, 7))
def test_pnpnpn_with_stopping_rotors_hovers_on_the_boundary(rotor):
    vehicle = Vehicle.from_parameters({**load('hexarotor'), 'rotors.speed_min': 0.0})
    report = audit(without(vehicle, rotor))
    assert abs(report.hover_margin) < 1e-12
    assert report.lost == ('yaw',)


def test_ppnnpn_hovers_without_any_of_rotors_1_to_4(ppnnpn):
    margins = [audit(without(ppnnpn, rotor)).hover_margin for rotor in range(1, 7)]
    assert all(margin > 0.05 for margin in margins[:4])
    assert all(margin < 0.0 for margin in margins[4:])


def test_two_opposite_rotors_lost_leave_no_independent_yaw(pnpnpn):
    # Rotors 1 and 4 carry roll nothing, pitch most: without them pitch and yaw have parallel rows.
    report = audit(without(pnpnpn, 1, 4))
    assert report.lost == ('yaw',)
    assert report.rank == 3
    assert report.independence['yaw'] < 1e-12
    assert 'yaw' not in report.vehicle.axes
    AdmissibleSet(report.vehicle)


def test_nearly_parallel_rows_are_not_commanded_with_great_gains(pnpnpn):
    # The same, but with a rotor moved a little: the rows are about a degree apart, and pitch
    # against yaw would take fifty times the thrusts (PX4 issue 28589).
    parameters = load('hexarotor')
    positions = list(parameters['rotors.positions'])
    positions[3] += 0.012
    moved = without(Vehicle.from_parameters({**parameters, 'rotors.positions': positions}), 1, 4)
    report = audit(moved)
    assert 0.0 < report.independence['yaw'] < INDEPENDENCE_MIN
    assert report.lost == ('yaw',)
    gains = np.linalg.pinv(AdmissibleSet(report.vehicle).problem.gamma)
    assert np.abs(gains).max() < 10.0


def test_too_heavy_a_vehicle_keeps_its_axes_and_cannot_hover():
    # Six rotors lift 24 N.
    report = audit(Vehicle.from_parameters({**load('hexarotor'), 'vehicle.mass': 2.5}))
    assert report.lost == ()
    assert not report.sound
    assert 'cannot hover' in str(report)


def test_a_geometry_without_yaw_is_refused_or_flown_without_it():
    parameters = {**load('hexarotor'), 'rotors.torque_coefficient': 0.0}
    with pytest.raises(ParameterError, match='rank 3'):
        Vehicle.from_parameters(parameters)
    vehicle = Vehicle.from_parameters({**parameters, 'allocation.lost_axes': 'drop'})
    assert audit(vehicle).lost == ('yaw',)
    assert audit(vehicle).vehicle.axes == ('thrust', 'roll', 'pitch')


@pytest.mark.parametrize('health', [0.0, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
def test_next_to_no_rotors_are_reported_not_raised(pnpnpn, health):
    report = audit(pnpnpn.with_health(health))
    assert not report.sound
    assert 'cannot hover' in str(report)
