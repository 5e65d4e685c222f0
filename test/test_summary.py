"""The summary of a flight: what disturbed it, and the hint that the machine was too slow."""

from collections import Counter
from dataclasses import replace

import pytest

from ca_ros.bringup import summary
from ca_ros.bringup.session import Flown
from ca_ros.bringup.summary import summarize
from ca_ros.flight.rotor_failures import RotorFailures
from ca_ros.flight.waypoint import Waypoint
from ca_ros.nodes.parameters import load
from test_bringup import WAYPOINT, fly_offline

HINT = '  hint          the machine may be too slow for real time'
MISSED = Flown(
    fly_offline('exact', 0.5), 0.5, Counter(), Counter(), Counter(), load('hexarotor'))
"""A flight that is too short to reach its waypoint."""


def lines(**changes):
    """Return what the summary of the missed flight says after its rotor speeds."""
    text, reached = summarize(replace(MISSED, **changes), Waypoint.of(*WAYPOINT), RotorFailures())
    assert not reached
    return text.splitlines()[4:]


@pytest.fixture(autouse=True)
def idle(monkeypatch):
    """Let the machine be idle, with two processors."""
    monkeypatch.setattr(summary.os, 'cpu_count', lambda: 2)
    monkeypatch.setattr(summary.os, 'getloadavg', lambda: (0.5, 0.0, 0.0))


def test_an_undisturbed_flight_has_no_further_lines():
    assert lines() == []


def test_timeouts_are_counted_and_hint_at_a_slow_machine():
    counts, hint = lines(timeouts=Counter(controller=1, simulator=2))
    assert counts == '  timeouts      controller 1, simulator 2'
    assert hint == f'{HINT} (load average 0.5 on 2 processors): try --mode lockstep'


def test_a_busy_machine_is_hinted_at_in_real_time_alone(monkeypatch):
    monkeypatch.setattr(summary.os, 'getloadavg', lambda: (7.25, 0.0, 0.0))
    [hint] = lines()
    assert hint.startswith(f'{HINT} (load average 7.2 on 2')
    assert lines(parameters=load('hexarotor') | {'mode': 'lockstep'}) == []


def test_faults_are_counted_and_explain_a_miss():
    faults = Counter(received=400, dropped=40, delayed=360)
    assert lines(faults=faults, timeouts=Counter(allocator=3), respawned=Counter(allocator=1)) == [
        '  respawned     allocator 1', '  timeouts      allocator 3',
        '  faults        dropped 40, delayed 360, of 400 messages']
    assert lines(faults=Counter(received=400)) == ['  faults        none, of 400 messages']
