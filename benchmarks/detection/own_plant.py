"""Failures in hover on the plant of ca_ros, flown on with what the detector finds.

``python -m benchmarks.detection.own_plant``: rotors that are lost, pairs at once or a second
apart, and servos that stick; noise, gusts, lag and delay are those of ``hexarotor_realistic``.
"""

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from benchmarks.detection.tables import share, table
from ca_ros.arguments import positive
from ca_ros.control.waypoint import Waypoint
from ca_ros.errors import CaRosError
from ca_ros.settings import flat
from ca_ros.simulation.closed_loop import fly
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case

SHOWN = 'hexarotor_realistic'
TAKEN = (
    'detector.motor_time_constant', 'detector.delay', 'simulator.motor_time_constant',
    'simulator.command_delay', 'simulator.position_noise', 'simulator.velocity_noise',
    'simulator.attitude_noise', 'simulator.angular_velocity_noise', 'simulator.rotor_drag',
    'simulator.wind', 'simulator.gust_intensity', 'controller.integral_gain')
"""The parameters of `SHOWN` that all vehicles get."""

SERVOS = [
    f'{part}.{name}' for part in ('simulator', 'detector')
    for name in ('servo_time_constant:=0.03', 'servo_rate:=6.0')]
FIRST = 1000  # the first seed
ANGLES = -0.6, -0.3, 0.3, 0.6  # where servos stick [rad]
BEGIN, APART = 3.0, 1.0  # when a failure happens, and how much later a second one [s]
NAMED, END = 2.0, 7.0  # in which the last failure is to be named; how long a flight is [s]
UP = Waypoint.of(0.0, 0.0, 1.0, 0.0)
NEAR = 1.0  # a flight goes on if it stays so near in its last second [m]
ROTORS = 'hexarotor', 'hexarotor_tilted', 'hexarotor_ppnnpn', 'quadrotor', 'octorotor', 'x8', 'y6'
PAIRS = 'hexarotor', 'octorotor', 'x8', 'y6'
TILTING = 'hexarotor_tilting', 'tricopter'
KINDS = {'lost': ROTORS, 'two at once': PAIRS, 'one, then another': PAIRS, 'servo sticks': TILTING}


def failures(case: Case, kind: str) -> Iterator[dict[int, str]]:
    """Yield by rotor, from 1, how those fail that fail together: as options of ``--fail``."""
    rotors = range(1, case.vehicle.n + 1)
    if kind == 'servo sticks':
        for rotor in sorted({int(each) + 1 for each in case.vehicle.servos.planar}):
            for angle in ANGLES:
                yield {rotor: f'{rotor}@{BEGIN}={angle}rad'}
    elif kind == 'lost':
        yield from ({rotor: f'{rotor}@{BEGIN}'} for rotor in rotors)
    else:
        later = BEGIN + APART * (kind == 'one, then another')
        for one, other in combinations(rotors, 2):
            yield {one: f'{one}@{BEGIN}', other: f'{other}@{later}'}


def flown(case: Case, words: dict[int, str], seed: int) -> tuple[bool, bool, float, bool]:
    """Fly with failures.

    Returns whether the rotors, or their arms, were named and no others, whether another one was,
    how long the last name took [s], and whether the flight goes on.
    """
    case = Case.load(case.name, [*case.changes, f'simulator.seed:={seed}'])
    detection = case.detection('exact')
    failed = RotorFailures(tuple(map(RotorFailure.parse, words.values())), None)
    try:
        flight = fly(case.controller(), case.allocator('exact'), case.plant(), UP, END,
                     detection=detection, failures=failed)
        away = np.linalg.norm(flight.position - UP.position, axis=1)[flight.time > END - 1.0]
        goes_on = bool(away.max() < NEAR)
    except (FloatingPointError, CaRosError):
        goes_on = False
    since = {i + 1: t for i, t in enumerate(detection.detector.since) if t is not None}
    partners = {
        one: other for pair in detection.detector.failed_arms for one, other in (pair, pair[::-1])}
    last = max(failed.times) / 1e9
    others = {rotor for rotor in since.keys() - words.keys() if partners.get(rotor) not in words}
    wrong = bool(others) or min(since.values(), default=np.inf) < 1e9 * BEGIN
    after = max((t for rotor, t in since.items() if rotor in words), default=np.inf) / 1e9 - last
    right = not wrong and words.keys() <= since.keys() and after <= NAMED
    return right, wrong, after, goes_on


def row(task: tuple[str, str], seeds: int = 1, every: int = 1) -> list[str]:
    """Fly failures of a kind with a vehicle; return the row of the table.

    `seeds`: flights of each failure.  `every`: only each so many of the failures is flown.
    """
    kind, vehicle = task
    values = flat(Case.load(SHOWN).flown)
    given = [f'{name}:={np.asarray(values[name]).tolist()}' for name in TAKEN]
    case = Case.load(vehicle, [*given, *(SERVOS if vehicle in TILTING else [])])
    right, wrong, after, goes_on = np.array([
        flown(case, words, seed) for words in [*failures(case, kind)][::every]
        for seed in range(FIRST, FIRST + seeds)]).T
    times = 1e3 * after[right == 1.0]
    return [
        f'`{vehicle}`', kind, share(len(times), len(right)), f'{wrong.sum():.0f}',
        f'{np.median(times):.0f}, {times.max():.0f}' if len(times) else '',
        f'{goes_on.sum():.0f}/{len(goes_on)}']


def run(mapped: Callable[..., Iterable[list[str]]], seeds: int = 1, every: int = 1) -> str:
    """Fly all failures; return the table.  `mapped`: `map`, or that of a pool; see `row`."""
    tasks = [(kind, vehicle) for kind, vehicles in KINDS.items() for vehicle in vehicles]
    head = ['vehicle', 'failure', 'named right [%]', 'wrong', 'median, worst [ms]', 'fly on']
    return table(head, mapped(partial(row, seeds=seeds, every=every), tasks))


def main(argv: Sequence[str] | None = None) -> int:
    """Fly and print a table; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.detection.own_plant', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', type=positive(int), default=1, help='flights of each failure')
    print(run(map, parser.parse_args(argv).seeds))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
