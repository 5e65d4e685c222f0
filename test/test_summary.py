"""The summary of a flight: what disturbed it, and the hint that the machine was too slow."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from ca_ros import Vehicle
from ca_ros.bringup import report
from ca_ros.bringup.flight import Flown
from ca_ros.bringup.recorder import DEMANDED
from ca_ros.bringup.report import shares_of, summarize
from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.record import Flight
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from nodes import GOAL, fly_offline
from strategies import file_values

HINT = '  hint          the machine may be too slow for real time'
PARAMETERS = file_values('hexarotor')
SHORT = Flown(
    fly_offline('exact', 0.5), 0.5, Counter(), Counter(), Counter(), PARAMETERS,
    Vehicle.from_parameters(PARAMETERS), {})
"""A flight that is too short to reach its waypoint."""

AWAY = replace(SHORT, flight=fly_offline('exact', 1.0, (-1.0, -1.0, 1.0, 0.0)))
"""A flight to elsewhere."""


def lines(flown=AWAY, **changes):
    """Return what the summary of a missed flight says after its rotor speeds."""
    text, reached = summarize(replace(flown, **changes), Waypoint.of(*GOAL))
    assert not reached
    return text.splitlines()[4:]


def bounds(flight, **changes):
    """Return what the summary says of the bounds, in real time unless the changes say else."""
    flown = replace(SHORT, flight=flight, **changes)
    text, _ = summarize(flown, Waypoint.of(*GOAL))
    return re.search(r'(\S+ ?\S*) bounds', text)[1].removeprefix('flight, ')


def flight_of(speeds):
    """Return a flight at rest with these speeds, every 0.1 s."""
    n = len(speeds)
    rest = np.zeros((n, 3))
    attitude = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    return Flight(0.1 * np.arange(n), rest, attitude, rest, rest, np.array(speeds, dtype=float))


@pytest.fixture(autouse=True)
def idle(monkeypatch):
    """Let the machine be idle, with two processors."""
    monkeypatch.setattr(report.os, 'cpu_count', lambda: 2)
    monkeypatch.setattr(report.os, 'getloadavg', lambda: (0.5, 0.0, 0.0))


def test_an_undisturbed_flight_has_no_further_lines():
    assert lines() == []


def test_the_tolerance_of_position_and_heading_is_that_of_the_user():
    there = fly_offline('exact', 0.5, (0.0, 0.0, 0.0, 0.0))
    for goal, needed in (((0.1, 0.0, 0.0, 0.0), 0.1), ((0.0, 0.0, 0.0, np.radians(5.0)), 0.2)):
        for tolerance in (0.99 * needed, 1.01 * needed):
            _, reached = summarize(
                replace(SHORT, flight=there), Waypoint.of(*goal), None, tolerance)
            assert reached == (tolerance > needed)


def test_a_healthy_flight_that_is_too_short_does_not_blame_the_machine(monkeypatch):
    monkeypatch.setattr(report.os, 'getloadavg', lambda: (9.0, 0.0, 0.0))
    for timeouts in (Counter(), Counter(controller=1)):
        *_, hint = lines(SHORT, timeouts=timeouts)
        assert re.fullmatch(
            '  hint          it was still approaching, by .* mm/s: try a longer --duration, '
            'or controller.integral_gain if an offset remains', hint)
    # There, but not yet turned.
    turning = fly_offline('exact', 0.5, (0.0, 0.0, 0.0, GOAL[3]))
    flown = replace(SHORT, flight=replace(turning, position=turning.position + GOAL[:3]))
    [hint] = lines(flown)
    assert 'degrees/s: try a longer --duration' in hint
    boat = replace(SHORT.vehicle, axes=('force_x', 'force_y', 'yaw'))
    [hint] = lines(replace(SHORT, vehicle=boat))
    assert 'no vertical force' in hint


def test_a_lost_rotor_that_turns_long_after_it_was_announced_is_out_of_bounds():
    lost = RotorFailures((RotorFailure(1, 0.2),), 0.1)
    hover, without = [250.0] * 6, [0.0] + [250.0] * 5
    for mode, late, expected in (
            ('realtime', 0, 'within'), ('realtime', 9, 'within'), ('realtime', 12, 'OUT OF'),
            ('lockstep', 0, 'within'), ('lockstep', 1, 'OUT OF')):
        speeds = [hover] * (3 + late) + [without] * (30 - late)
        parameters = PARAMETERS | {'mode': mode}
        assert bounds(flight_of(speeds), failures=lost, parameters=parameters) == expected
    # Never announced, so it is commanded.
    never = RotorFailures(lost.failures, None)
    assert bounds(flight_of([hover] * 30), failures=never) == 'within'


def test_rotors_that_a_timeout_stops_are_within_bounds():
    flight = flight_of([[250.0] * 6, [0.0] * 6])
    timeouts = Counter(simulator=1)
    assert bounds(flight, timeouts=timeouts, stops=True) == 'within'
    assert bounds(flight, stops=True) == 'OUT OF'
    assert bounds(flight, timeouts=timeouts) == 'OUT OF'
    slow = flight_of([[250.0] * 6, [0.0] * 5 + [20.0]])
    assert bounds(slow, timeouts=timeouts, stops=True) == 'OUT OF'


def wrenches_of(commanded, unallocated, residual, times=(0, 10_000_000, 20_000_000)):
    """Return what the nodes tell of force and torque at these times [ns]."""
    return {
        name: dict(zip(times, rows, strict=True))
        for name, rows in zip(DEMANDED, (commanded, unallocated, residual), strict=True)}


HOVER, NONE = (0.0, 0.0, 9.81, 0.0, 0.0, 0.0), (0.0,) * 6
ROLL = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0)


@pytest.mark.parametrize('vehicle', ['hexarotor', 'hexarotor_tilting'])
def test_what_was_served_of_the_demands_and_what_limited_the_rest_is_said(vehicle):
    flight = Case.load(vehicle)
    given = file_values(vehicle)
    rest = np.zeros((3, 3))
    angles = np.zeros((3, len(flight.vehicle.servos)))
    flown = replace(
        SHORT, parameters=given, vehicle=Vehicle.from_parameters(given), flight=Flight(
            np.array([0.0, 0.01, 0.02]), rest, np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)), rest, rest,
            np.full((3, 6), 250.0), angles),
        # Of 2 N m one is cut by the controller, and once the other by the allocator.
        wrenches=wrenches_of(
            [HOVER, np.add(HOVER, ROLL), np.add(HOVER, ROLL)], [NONE, ROLL, ROLL],
            [NONE, NONE, ROLL]),
        limits={'roll': 'rotor 1 at its maximum'})
    served = shares_of(flown)
    assert served.axes == flown.vehicle.axes
    expected = np.ones((3, len(served.axes)))
    expected[1:, served.axes.index('roll')] = 0.5, 0.0
    np.testing.assert_allclose(served.values, expected, atol=1e-12)
    assert served.cuts == (
        'roll for 0.02 s, at 0.02 s to 0 %, limited by rotor 1 at its maximum',)
    text, _ = summarize(flown, Waypoint.of(*GOAL), served)
    assert f'\n  cut           {served.cuts[0]}' in text
    # A node that does not say it gets no reason; one that says nothing no line.
    [cut] = shares_of(replace(flown, limits={})).cuts
    assert cut == 'roll for 0.02 s, at 0.02 s to 0 %'
    for name in DEMANDED[1:]:
        assert shares_of(replace(flown, wrenches={**flown.wrenches, name: {}})) is None
    # A lost message leaves its sample out, and so does an axis that is given up.
    for wrenches in flown.wrenches.values():
        del wrenches[20_000_000]
    served = shares_of(flown)
    assert np.isnan(served.values[2]).all()
    assert served.cuts[0].startswith('roll for 0.01 s, at 0.01 s to 50 %')


def test_an_axis_that_is_given_up_has_no_share():
    # Three rotors that are left turn in the same sense.
    lost = RotorFailures(tuple(RotorFailure(i, 0.005) for i in (1, 3, 5)), 0.0)
    flight = replace(SHORT.flight, **{
        name: getattr(SHORT.flight, name)[:3] for name in vars(SHORT.flight)
        if getattr(SHORT.flight, name) is not None})
    flown = replace(
        SHORT, flight=flight, failures=lost,
        wrenches=wrenches_of([HOVER] * 3, [NONE] * 3, [NONE] * 3))
    detected = {
        'failures': replace(lost, announce=None), 'detected': dict.fromkeys((1, 3, 5), 0.005)}
    for changes in ({}, detected):
        shares = shares_of(replace(flown, **changes)).values
        np.testing.assert_array_equal(shares[0], 1.0)
        np.testing.assert_array_equal(shares[1:], [[1.0, 1.0, 1.0, np.nan]] * 2)
    withheld = replace(flown, **detected, withheld=(1, 3, 5))
    np.testing.assert_array_equal(shares_of(withheld).values, 1.0)
    assert [line.endswith(' 0.01 s, not acted on, never announced') for line in lines(withheld)
            if line.startswith('  failure ')] == [True] * 3


def test_timeouts_are_counted_and_hint_at_a_slow_machine():
    counts, hint = lines(timeouts=Counter(controller=1, simulator=2))
    assert counts == '  timeouts      controller 1, simulator 2'
    assert hint == f'{HINT} (load average 0.5 on 2 processors): try --mode lockstep'


def test_a_busy_machine_is_hinted_at_in_real_time_alone(monkeypatch):
    monkeypatch.setattr(report.os, 'getloadavg', lambda: (7.25, 0.0, 0.0))
    [hint] = lines()
    assert hint.startswith(f'{HINT} (load average 7.2 on 2')
    assert lines(parameters=file_values('hexarotor') | {'mode': 'lockstep'}) == []


def test_faults_are_counted_and_explain_a_miss():
    faults = Counter(received=400, dropped=40, delayed=360)
    assert lines(faults=faults, timeouts=Counter(allocator=3), respawned=Counter(allocator=1)) == [
        '  respawned     allocator 1', '  timeouts      allocator 3',
        '  faults        dropped 40, delayed 360, of 400 messages']
    assert lines(faults=Counter(received=400)) == ['  faults        none, of 400 messages']
