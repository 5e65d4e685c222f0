"""The methods that are flown, against the numbers that their own projects publish."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from ca_ros import (
    ALLOCATORS,
    AdmissibleSet,
    AllocationProblem,
    Status,
    Vehicle,
    control_allocation_matrix,
)
from ca_ros.allocation.sequential_desaturation import SequentialDesaturation
from ca_ros.allocation.weighted_least_squares import WeightedLeastSquares
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.studies.dynamic import study as dynamic_study
from ca_ros.studies.plot_style import styles
from ca_ros.studies.static import study as static_study
from strategies import (
    FLEET,
    HEXAROTOR,
    PARAMETERS,
    PX4_ROWS,
    UNIT_QUADROTOR,
    build,
    generators,
    ring,
    vehicles,
)
from strategies import unaudited as make_allocator

AIRMODES = ('disabled', 'roll_pitch', 'roll_pitch_yaw')

UPRIGHT = (
    'exact', 'pseudo_inverse', 'conventional', 'direct', 'weighted_pseudo_inverse',
    'redistributed_pseudo_inverse', 'weighted_least_squares', 'sequential_desaturation',
    'betaflight_mixer')
"""Methods that hold the hexarotor upright without rotor 1."""


def unit(positions, spins, **changes):
    """Make a vehicle whose thrusts are 0 to 1 N, without reaction torque except 1 N m per N."""
    return Vehicle.from_parameters(PARAMETERS | {
        'rotors.positions': np.ravel(positions).tolist(),
        'rotors.spins': ['cw' if spin > 0 else 'ccw' for spin in spins],
        'rotors.thrust_coefficient': 1.0, 'rotors.torque_coefficient': 1.0,
        'rotors.speed_min': 0.0, 'rotors.speed_max': 1.0, **changes})


# PX4

def desaturated(airmode, roll, pitch, yaw, thrust):
    """Return the four thrusts for PX4's controls: thrust is the mean."""
    allocator = make_allocator('sequential_desaturation', UNIT_QUADROTOR, airmode=airmode)
    return allocator.allocate([4.0 * thrust, roll, pitch, yaw]).thrusts


@pytest.mark.parametrize(('mode', 'sums'), [
    # Sums over the 39 unattainable rows: of the lengths of the errors of roll and pitch, of the
    # errors of the mean thrust, and of the errors of yaw.
    (0, (11.83, 4.38, 9.08)), (1, (0.0, 7.04, 6.02)), (2, (0.0, 8.54, 0.0))])
def test_all_rows_of_px4(mode, sums):
    allocator = make_allocator(
        'sequential_desaturation', UNIT_QUADROTOR, airmode=AIRMODES[mode])
    wrenches = np.column_stack([4.0 * PX4_ROWS[:, 3], PX4_ROWS[:, :3]])
    batch = allocator.allocate_batch(wrenches)
    expected = PX4_ROWS[:, 4 + 4 * mode:8 + 4 * mode]
    assert len(expected) == 65
    np.testing.assert_allclose(batch.thrusts, expected, rtol=0.0, atol=1e-12)
    lost = ~AdmissibleSet(UNIT_QUADROTOR).contains(wrenches, tolerance=1e-9)
    assert np.count_nonzero(lost) == 39
    error = np.abs(batch.residual[lost])
    found = np.hypot(error[:, 1], error[:, 2]).sum(), error[:, 0].sum() / 4.0, error[:, 3].sum()
    np.testing.assert_allclose(found, sums, atol=0.006)
    # No axis is reversed or moved without demand.
    share = batch.wrench[lost, 1:] * np.sign(wrenches[lost, 1:])
    assert np.all(share > -1e-12)
    assert np.all(np.abs(batch.wrench[lost, 1:])[wrenches[lost, 1:] == 0.0] < 1e-12)


@pytest.mark.parametrize(('airmode', 'control', 'thrusts'), [
    # ControlAllocationSequentialDesaturationTest.cpp of PX4-Autopilot.
    ('disabled', (0.0, 0.0, 1.0, 3.2), (1.0, 0.7, 1.0, 0.7)),
    ('disabled', (0.0, 2.0, 0.0, 3.0), (1.0, 0.0, 0.0, 1.0)),
    ('disabled', (0.0, 0.0, 1.0, 0.75), (1.0, 0.5, 1.0, 0.5)),
    ('roll_pitch', (0.05, 0.05, 0.025, 0.0), (0.025, 0.0, 0.025, 0.05)),
    ('roll_pitch', (0.0, 4.0, 1.2, 0.5), (1.0, 0.0, 0.0, 1.0)),
    ('roll_pitch_yaw', (0.0, 0.0, 1.0, 1.0), (1.0, 0.5, 1.0, 0.5)),
])
def test_other_cases_of_px4(airmode, control, thrusts):
    np.testing.assert_allclose(desaturated(airmode, *control), thrusts, atol=1e-12)


def lost(vehicle, *rotors):
    for rotor in rotors:
        vehicle = vehicle.fail(rotor)
    return VehicleProblem(vehicle)


SURVEYED = Vehicle.ring(
    count=6, radius=0.3, mass=1.5, thrust_coefficient=1e-5, torque_coefficient=5e-7, speed_min=0.0,
    speed_max=900.0)
SURVEYED = Vehicle(
    mass=1.5, positions=SURVEYED.arms + np.random.default_rng(1).normal(0.0, 3e-3, (6, 3)),
    spins=['cw', 'ccw'] * 3, thrust_coefficient=1e-5, torque_coefficient=5e-7, speed_min=0.0,
    speed_max=900.0)
"""Rotors 3 mm beside the corners of a hexagon, as a survey finds them."""


@pytest.mark.parametrize('pair', [(1, 4), (2, 5), (3, 6)])
def test_an_axis_that_depends_on_others_is_dropped_as_px4_does(pair):
    # Two opposite rotors fail: the rows of yaw and of a tilt are 1 to 3 degrees apart.
    problem = lost(SURVEYED, *pair)
    now, before = (
        SequentialDesaturation(problem, airmode='roll_pitch', dependent_axes=choice).allocate(
            [14.7, 0.1, 0.05, 0.02]) for choice in ('drop', 'keep'))
    np.testing.assert_allclose(now.residual[:3], 0.0, atol=1e-12)
    assert np.abs(before.residual[0]) > 1.0


def test_what_px4_keeps_changes_no_bit():
    fleet = [*(lost(SURVEYED, rotor) for rotor in range(1, 7)), VehicleProblem(SURVEYED),
             *map(VehicleProblem, FLEET.values())]
    rng = np.random.default_rng(0)
    for problem in fleet:
        u = problem.center + rng.normal(size=(20, len(problem.axes))) * problem.extent
        now, before = (
            SequentialDesaturation(problem, dependent_axes=choice).allocate_batch(u).thrusts
            for choice in ('drop', 'keep'))
        np.testing.assert_array_equal(now, before)


# Betaflight

TABLES = {
    # Roll, pitch and yaw of each motor in mixer_init.c of Betaflight.
    'QuadX': [(-1, 1, -1), (-1, -1, 1), (1, 1, 1), (1, -1, -1)],
    'Hex6X': [
        (-0.5, 0.866025, 1), (-0.5, -0.866025, 1), (0.5, 0.866025, -1), (0.5, -0.866025, -1),
        (-1, 0, -1), (1, 0, 1)],
    'OctoX8': [
        (-1, 1, -1), (-1, -1, 1), (1, 1, 1), (1, -1, -1),
        (-1, 1, 1), (-1, -1, -1), (1, 1, -1), (1, -1, 1)],
}


def betaflight(table, airmode, throttle, controls):
    """Return the motor outputs of Betaflight's mixer, as its applyMixerAdjustment describes."""
    mix = table @ controls
    span = max(mix.max(), 0.0) - min(mix.min(), 0.0)
    authority = 1.0 if airmode or throttle >= 0.5 else 0.5 + throttle
    mix *= authority / max(span, 1.0)
    return mix + np.clip(throttle, -mix.min(), 1.0 - mix.max())


@pytest.mark.parametrize('airmode', [True, False])
@pytest.mark.parametrize('frame', TABLES)
def test_the_mixer_tables_of_betaflight(frame, airmode):
    table = np.array(TABLES[frame], dtype=float)
    positions = np.column_stack([-table[:, 1], table[:, 0], np.zeros(len(table))])
    vehicle = unit(positions, table[:, 2])
    gamma = control_allocation_matrix(vehicle)
    allocator = make_allocator('betaflight_mixer', vehicle, airmode=airmode)
    rng = np.random.default_rng(0)
    scaled = 0
    for _ in range(300):
        throttle, controls = rng.random(), rng.normal(0.0, rng.choice([0.05, 0.3, 1.0]), 3)
        a = allocator.allocate(gamma @ (throttle + table @ controls))
        expected = betaflight(table, airmode, throttle, controls)
        # The tables have six digits.
        np.testing.assert_allclose(a.thrusts, expected, atol=1e-5)
        scaled += np.ptp(table @ controls) > 1.0
    assert 50 < scaled < 250


def test_the_mixer_worked_out_by_hand():
    quadrotor = UNIT_QUADROTOR
    enabled = make_allocator('betaflight_mixer', quadrotor)
    disabled = make_allocator('betaflight_mixer', quadrotor, airmode=False)
    # Roll of 1.2 N m is 0.3 N more for rotors 3 and 4: without thrust, it is raised to 0.3 N.
    a, b = enabled.allocate([0, 1.2, 0, 0]), disabled.allocate([0, 1.2, 0, 0])
    np.testing.assert_allclose(a.thrusts, [0, 0, 0.6, 0.6], atol=1e-12)
    np.testing.assert_allclose(b.thrusts, [0, 0, 0.3, 0.3], atol=1e-12)
    # At a quarter of the throttle three quarters of the roll are left: 0.25 - 0.225 = 0.025.
    np.testing.assert_allclose(
        disabled.allocate([1.0, 1.2, 0, 0]).thrusts, [0.025, 0.025, 0.475, 0.475])
    # A roll of 4 N m and a yaw of 2 N m span 3 N, three times the range: one third is left.
    a = enabled.allocate([2.0, 4.0, 0, 2.0])
    np.testing.assert_allclose(a.wrench, [2.0, 4 / 3, 0.0, 2 / 3], atol=1e-12)


# Weighted least squares

EFFECTIVENESS = np.array([
    [-8.0, -8.0, -8.0, -8.0, -8.0, -8.0],
    [-1.1698896285233666, -2.6163428670767597, -1.2556785460347368,
     1.2236780362072879, 2.2348889474123692, 1.1174386848806879],
    [2.0263082758503517, 2e-16, -2.1748990397063803,
     -2.1194725308171325, 1.6e-15, 1.9354605765563011],
    [0.05, -0.05, 0.05, -0.05, 0.05, -0.05]])
WU = [1.0246609892531906, 1.5560964580733374, 1.3817811635099275,
      1.4521209351267423, 1.0, 1.6243160846552192]
WLS_CASES = np.loadtxt(
    Path(__file__).with_name('wls_cases.csv'), delimiter=',', skiprows=1)[:, 1:]
"""Cases of a hexarotor with 0 to 6 saturated motors.

Source: test_cases.h of github.com/tblaha/ActiveSetCtlAlloc (T. Blaha, Delft): v, and the solution
of the constrained least squares.  The cost there is |Wv (B u - v)|^2 + g^2 |Wu u|^2 with motors
from 0 to 1; the residuals of the cases give g = 0.31788395460742563.
"""


def test_the_cases_of_a_wls_project():
    problem = AllocationProblem(EFFECTIVENESS, 0.0, 1.0)
    allocator = WeightedLeastSquares(
        problem, gamma=0.31788395460742563**-2, wu=np.multiply(WU, problem.half_range),
        wv=[10.0, np.sqrt(1000.0), np.sqrt(1000.0), 1.0] * problem.extent)
    expected = WLS_CASES[:, 4:]
    saturated = np.count_nonzero((expected == 0.0) | (expected == 1.0), axis=1)
    assert set(saturated) == set(range(7))
    found = allocator.allocate_batch(WLS_CASES[:, :4])
    np.testing.assert_allclose(found.thrusts, expected, rtol=0.0, atol=1e-11)


# Pseudo-inverses

def test_the_redistributed_pseudo_inverse_worked_out_by_hand():
    # 10.8 N and 0.216 N m of yaw are 1.8 +- 1.8 N: rotors 2, 4, 6 stay at 0.04 N.  The others
    # have to give 10.68 N and 0.2184 N m, which is 0.02 m times their thrust: the sum s of least
    # squares is (10.68 + 0.02 * 0.2184) / (1 + 0.02^2).
    a = make_allocator('redistributed_pseudo_inverse', HEXAROTOR).allocate([10.8, 0, 0, 0.216])
    s = 10.684368 / 1.0004
    np.testing.assert_allclose(a.thrusts, [s / 3, 0.04] * 3, rtol=1e-12)
    assert a.violation == pytest.approx(0.04)
    # Rotor 1 is beyond its bound for this wrench, and the others give what it cannot.
    u = [18.0, 0.0, -1.2, 0.06]
    clipped = make_allocator('pseudo_inverse', HEXAROTOR).allocate(u)
    assert clipped.status is Status.INEXACT
    assert list(clipped.saturation).count(1) == 1
    a = make_allocator('redistributed_pseudo_inverse', HEXAROTOR).allocate(u)
    assert a.status is Status.EXACT


def test_the_weighted_pseudo_inverse_shares_by_squared_weights():
    # Rotors i and i + 4 have equal columns: their thrusts are as 1 / w^2, 4 to 1.
    vehicle = FLEET['x8_identical_columns']
    weights = [1.0] * 4 + [2.0] * 4
    a = make_allocator('weighted_pseudo_inverse', vehicle, weights=weights).allocate(
        [10.0, 0.1, -0.2, 0.01])
    assert a.status is Status.EXACT
    np.testing.assert_allclose(a.thrusts[:4], 4.0 * a.thrusts[4:], rtol=1e-12)


@given(data=st.data())
def test_the_weighted_pseudo_inverse_has_the_least_weighted_norm(data):
    vehicle = data.draw(vehicles())
    weights = np.array(data.draw(st.lists(
        st.floats(0.1, 10.0), min_size=vehicle.n, max_size=vehicle.n)))
    allocator = make_allocator('weighted_pseudo_inverse', vehicle, weights=weights)
    moving = vehicle.thrust_max > 0.0
    gamma = control_allocation_matrix(vehicle)[:, moving]
    inverse = allocator.inverse[moving]
    np.testing.assert_allclose(gamma @ inverse, np.eye(4), atol=1e-8)
    # The gradient of |W f|^2 / 2 is a combination of the rows of Gamma.
    gradient = weights[moving, None] ** 2 * inverse
    multipliers = np.linalg.lstsq(gamma.T, gradient)[0]
    size = np.abs(gradient).max()
    np.testing.assert_allclose(gamma.T @ multipliers, gradient, atol=1e-7 * size)


# Any matrix, bounds of any sign

@st.composite
def problems(draw):
    """Draw a problem with a matrix of random numbers; some effectors may be fixed."""
    rng, n = draw(generators), draw(st.integers(4, 10))
    low = rng.choice([-2.0, -0.5, 0.0, 0.7], n) * rng.uniform(0.1, 1.0, n)
    high = low + rng.choice([0.0, 1.0, 1.0, 1.0, 3.0], n) * rng.uniform(0.1, 1.0, n)
    axes = ['thrust', 'roll', 'pitch', 'yaw', 'force_x'][:draw(st.integers(1, 5))]
    return AllocationProblem(rng.normal(size=(len(axes), n)), low, high, axes=axes)


@pytest.mark.parametrize('method', list(ALLOCATORS)[4:])
@given(data=st.data())
def test_laws_for_any_matrix(method, data):
    problem = data.draw(problems())
    rng = data.draw(generators)
    share = rng.random((6, problem.n)) * rng.choice([1.0, 1.0, 2.0], (6, 1))
    demands = (problem.lower + share * (problem.upper - problem.lower)) @ problem.gamma.T
    allocator = ALLOCATORS[method](problem)
    batch = allocator.allocate_batch(demands)
    assert np.all((problem.lower <= batch.thrusts) & (batch.thrusts <= problem.upper))
    reached = np.linalg.norm(batch.residual, axis=1) <= problem.tolerance(demands)
    np.testing.assert_array_equal(batch.status == Status.EXACT, reached)
    for u, thrusts in zip(demands[::-1], batch.thrusts[::-1], strict=True):
        np.testing.assert_allclose(allocator.allocate(u).thrusts, thrusts, atol=1e-12)


@pytest.mark.parametrize(('method', 'options'), [
    ('redistributed_pseudo_inverse', {}), ('betaflight_mixer', {}),
    # With the other airmodes, what saturates before yaw is added is not restored.
    ('sequential_desaturation', {'airmode': 'roll_pitch_yaw', 'dependent_axes': 'keep'})])
@given(data=st.data())
def test_what_the_pseudo_inverse_attains_is_exact_for_any_matrix(method, options, data):
    rng, n = data.draw(generators), data.draw(st.integers(4, 10))
    gamma = rng.normal(size=(4, n))
    # Of least norm, and within bounds of any sign.
    wanted = gamma.T @ rng.normal(size=4)
    problem = AllocationProblem(
        gamma, wanted - rng.random(n), wanted + rng.random(n),
        axes=['thrust', 'roll', 'pitch', 'yaw'])
    a = ALLOCATORS[method](problem, **options).allocate(gamma @ wanted)
    scale = np.linalg.cond(gamma)
    np.testing.assert_allclose(a.thrusts, wanted, atol=1e-13 * scale)


@given(data=st.data())
def test_weighted_least_squares_is_optimal_for_any_matrix(data):
    problem = data.draw(problems())
    rng = data.draw(generators)
    u = problem.center + rng.normal(size=len(problem.axes)) * problem.extent
    wv, wu = rng.uniform(0.5, 2.0, len(u)), rng.uniform(0.5, 2.0, problem.n)
    preferred = rng.normal(size=problem.n)
    allocator = WeightedLeastSquares(problem, gamma=100.0, wu=wu, wv=wv, preferred=preferred)
    found = allocator.allocate(u).thrusts
    moving = problem.half_range > 0.0
    wv, wu = (
        weights / np.where(ranges > 0.0, ranges, 1.0)
        for weights, ranges in ((wv, problem.extent), (wu, problem.half_range)))
    matrix = np.vstack([10.0 * wv[:, None] * problem.gamma, np.diag(wu)])
    target = np.concatenate([10.0 * wv * u, wu * preferred])
    other = problem.middle.copy()
    if moving.any():
        other[moving] = lsq_linear(
            matrix[:, moving], target - matrix[:, ~moving] @ other[~moving],
            (problem.lower[moving], problem.upper[moving]), method='bvls', tol=1e-14).x
    cost, least = (np.sum((matrix @ f - target) ** 2) for f in (found, other))
    assert cost <= least * (1.0 + 1e-9) + 1e-12


@given(data=st.data())
def test_weighted_least_squares_is_the_same_in_other_units(data):
    problem, rng = data.draw(problems()), data.draw(generators)
    assume(problem.extent.min() > 0.0)
    u = problem.center + rng.normal(size=len(problem.axes)) * problem.extent
    effectors, axes = 10.0 ** rng.uniform(-2, 2, problem.n), 10.0 ** rng.uniform(-2, 2, len(u))
    other = AllocationProblem(
        axes[:, None] * problem.gamma / effectors, effectors * problem.lower,
        effectors * problem.upper, axes=problem.axes)
    options = {'wv': rng.uniform(0.5, 2.0, len(u)), 'gamma': 100.0}
    found = WeightedLeastSquares(problem, **options).allocate(u).thrusts
    expected = WeightedLeastSquares(other, **options).allocate(axes * u).thrusts / effectors
    np.testing.assert_allclose(found, expected, atol=1e-7)


# Faults

@pytest.mark.parametrize('method', ['sequential_desaturation', 'betaflight_mixer'])
def test_missing_axes(method):
    without = build(ring(4), 'PNPN', {'allocation.axes': ['roll', 'pitch', 'yaw']})
    with pytest.raises(ValueError, match=f'{method} .* needs thrust; .* roll, pitch, yaw'):
        make_allocator(method, without)
    # A vehicle that has lost its yaw flies on.
    three = build(ring(4), 'PNPN', {'allocation.axes': ['thrust', 'roll', 'pitch']})
    assert make_allocator(method, three).allocate([9.81, 0.1, 0.1]).status is Status.EXACT


@pytest.mark.parametrize(('method', 'option', 'wrong', 'words'), [
    ('weighted_pseudo_inverse', 'weights', [1.0] * 5, 'weights: expected 1 or 6 numbers'),
    ('weighted_pseudo_inverse', 'weights', [1.0] * 5 + [0.0], r'weights\[5\]: must be positive'),
    ('weighted_pseudo_inverse', 'weights', [1.0] * 5 + [1e5], 'weights: 100000 is more than'),
    # Gamma / W overflows, and LAPACK did not return.
    ('weighted_pseudo_inverse', 'weights', [1e-309] + [1.0] * 5, r'weights\[0\]: .*1e-30'),
    ('redistributed_pseudo_inverse', 'weights', [1e-5] + [1.0] * 5, 'weights: 1 is more than'),
    ('weighted_least_squares', 'gamma', 0.0, 'gamma: must be positive'),
    ('weighted_least_squares', 'wu', [1e-5] + [1.0] * 5, 'wu: 1 is more than 10000 times 1e-05'),
    ('weighted_least_squares', 'wu', 1e-9, 'wv: sqrt.* is more than 1e.10 times Wu, 1e-09'),
    ('weighted_least_squares', 'wv', ['roll'], "wv: .* such as 'roll 1000', got 'roll'"),
    ('weighted_least_squares', 'wv', ['rol 3'], "wv: .* thrust, roll, .* got 'rol 3'"),
    ('weighted_least_squares', 'wv', ['roll 1', 'roll 2'], 'wv: expected each axis once'),
    ('weighted_least_squares', 'wv', [1.0, 2.0], r'wv: expected 1 or 4 numbers, .* got 2'),
    ('weighted_least_squares', 'preferred', 'most', 'preferred: must be one of zero, minimum'),
    ('sequential_desaturation', 'airmode', 'yes', 'airmode: must be one of disabled, roll_pitch'),
    ('betaflight_mixer', 'airmode', 'yes', 'airmode: must be true or false'),
])
def test_wrong_options(method, option, wrong, words):
    with pytest.raises(ValueError, match=f'^{words}'):
        make_allocator(method, HEXAROTOR, **{option: wrong})


# The studies

@pytest.mark.slow
def test_the_studies_have_all_methods(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for study in (static_study, dynamic_study):
        monkeypatch.setattr(study, 'draw', lambda *_: None)
    assert static_study.main(['--methods', 'all', '--samples', '20']) == 0
    assert list(json.loads(Path('static.json').read_text())['methods']) == list(ALLOCATORS)
    # A hexarotor without a rotor has no yaw.  Without airmode, sequential desaturation overturns
    # it: thrust must not be raised for the opposite rotor, which is at its minimum.
    command = ['--methods', 'all', '--duration', '1.5', '--fail', '1@0.5']
    command += ['-p', 'allocation.sequential_desaturation.airmode:=roll_pitch']
    assert dynamic_study.main(command) == 0
    found = json.loads(Path('dynamic.json').read_text())['methods']
    assert list(found) == list(ALLOCATORS)
    # A further method need not hold the vehicle.
    assert all(abs(found[method]['greatest_tilt']) < 0.5 for method in UPRIGHT)


def test_each_method_has_a_style_of_its_own():
    looks = [
        (look['color'], look['linestyle'])
        for look in styles([*ALLOCATORS, 'osqp_tight', 'my:Own']).values()]
    assert len(set(looks)) == len(ALLOCATORS) + 2
