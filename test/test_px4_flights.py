"""Flights of PX4: when they are in the air, which rotors are taken, and what a row counts."""

from types import SimpleNamespace

import numpy as np

from benchmarks.detection import px4_flights
from benchmarks.detection.recordings import Taken

TIMES = np.arange(100.0, 180.0)  # of the land detector's rows [s]
LANDED = (TIMES < 110.0) | ((TIMES >= 142.0) & (TIMES < 150.0))


def test_flights_are_between_the_changes_of_the_land_detector():
    np.testing.assert_allclose(
        px4_flights.flights(TIMES, LANDED), [[110.0, 142.0], [150.0, np.inf]])
    assert px4_flights.flights(TIMES, np.ones(len(TIMES), bool)).shape == (0, 2)


def test_rotors_are_taken_in_turn_where_the_land_detector_says_not_landed():
    flown = px4_flights.flights(TIMES, LANDED)
    vehicle, recording = SimpleNamespace(n=2), SimpleNamespace(span=(101.0, 181.0))
    found = SimpleNamespace(times=np.array([0.0, 80.0]))
    # At 40 s it lands within 2 s; at 80 s the recording ends.
    assert list(px4_flights.in_turn(vehicle, recording, found, flown)) == [(0, 20.0), (1, 60.0)]


def log(named, taken, fault=''):
    """Return a log of 80 s from 100 s on, with alarms at some times."""
    found = SimpleNamespace(
        named=[SimpleNamespace(time=time) for time in named], times=np.array([0.0, 80.0]))
    return SimpleNamespace(begin=100.0, found=found, taken=taken, fault=fault)


def test_a_row_counts_alarms_landings_and_taken_rotors():
    flown = px4_flights.flights(TIMES, LANDED)
    taken = [
        Taken(0, 20.0, SimpleNamespace(), 0.05), Taken(1, 20.0, SimpleNamespace(), np.inf),
        Taken(0, 60.0, None, np.inf)]
    logs = [log([12.0, 45.0], taken), log([5.0], [], 'lag')]
    row = dict(zip(
        px4_flights.TITLES, px4_flights.row('calm', logs, [flown, flown]), strict=True))
    assert row['in the air [s]'] == '124'
    assert row['landings'] == '2'
    assert (row['alarms: in the air'], row['on the ground']) == ('1', '2')
    assert row['taken rotors named right [%]'].startswith('1/3')
    assert (row['wrong'], row['not named']) == ('1', '1')
    assert row['median, 90 % [ms]'] == 'never, never'
    assert row['warnings of the lag'] == '1'
