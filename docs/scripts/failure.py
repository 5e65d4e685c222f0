"""Fly every shipped vehicle with each of its rotors lost; fill the tables of docs/failure.md.

Takes some minutes.
"""

import warnings
from math import degrees, inf
from typing import NamedTuple

import numpy as np
from pages import distance, fill, flown, shipped

from ca_ros.control.waypoint import Waypoint
from ca_ros.problem.audit import audit
from ca_ros.simulation.closed_loop import Change
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from ca_ros.studies.tables import table
from ca_ros.vehicle.failure_words import with_failures

START, GOAL = Waypoint.of(0.0, 0.0, 0.0, 0.0), Waypoint.of(1.2, 1.2, 1.06, 0.0)
"""The waypoint at which the rotor is lost, and the next waypoint, 2 m away."""

LOST, SENT, SETTLED, END = 1.0, 3.0, 15.0, 75.0  # loss, next waypoint, reached by, end [s]
THERE = 0.05  # greatest distance from the waypoint [m]
METHODS = 'exact', 'pseudo_inverse'
DRAG = 5e-4  # rotational drag of six cylindrical arms, see the page [N m s^2/rad^2]


class Outcome(NamedTuple):
    """The result of a flight with a lost rotor: distances [m], greatest tilt [rad], spin [rad/s].

    `away` is the greatest distance from the waypoint after `SETTLED`, `end` the distance at the
    end, `drop` the depth below the height at which the vehicle lost the rotor.
    """

    away: float = inf
    tilt: float = np.pi
    drop: float = inf
    spin: float = inf
    end: float = inf


def lose(case: Case, method: str, rotor: int, announce: float | None = 0.1) -> Outcome:
    """Lose a rotor at hover, fly 2 m, and stay there for a minute."""
    failures = RotorFailures((RotorFailure(rotor, LOST),), announce)
    changes = [*case.announced(method, failures), Change(round(SENT * 1e9), waypoint=GOAL)]
    flight = flown(case, START, END, method, case.body(), changes=changes, failures=failures)
    if flight is None:
        return Outcome()
    return Outcome(
        distance(flight, GOAL, SETTLED), float(flight.tilt.max()),
        float(-flight.position[:, 2].min()), float(np.abs(flight.angular_velocity[-1, 2])),
        flight.position_error(GOAL),
    )


def rotors_table() -> str:
    """Return the lost axes of each vehicle without each rotor, and whether it flies."""
    rows: dict[tuple[str, ...], list[tuple[int, Outcome]]] = {}
    for name in shipped(flying=True):
        sound = Case.load(name)
        for rotor in range(1, sound.vehicle.n + 1):
            report = audit(with_failures(sound.vehicle, {str(rotor): 0.0}))
            torque = f'{abs(report.spin_torque):.2g}' if report.spin_torque else '0'
            for drag in [0.0, DRAG] if report.lost == ('yaw',) else [0.0]:
                case = Case.load(name, [f'simulator.rotational_drag:={drag}'])
                found = {method: lose(case, method, rotor) for method in METHODS}
                lost, verdicts = ', '.join(report.lost) or 'none', map(verdict, found.values())
                key = (f'`{name}`', lost, torque, f'{drag:g}', *verdicts)
                rows.setdefault(key, []).append((rotor, found['exact']))
    lines = []
    for (name, lost, torque, drag, ours, theirs), pairs in rows.items():
        rotors, outcomes = zip(*pairs, strict=True)
        # The worst of the rotors of a row.
        tilt, spin = max(each.tilt for each in outcomes), max(each.spin for each in outcomes)
        worst = (f'{degrees(tilt):.0f}', f'{spin:.1f}') if ours == 'flies' else ('', '')
        lines.append((name, spans(rotors), lost, torque, drag, ours, *worst, theirs))
    titles = (
        *('vehicle', 'rotor', 'lost axes', 'yaw torque left [N m]', 'drag [N m s²/rad²]'),
        *('`exact`', 'tilt [°]', 'spin [rad/s]', '`pseudo_inverse`'),
    )
    return table(titles, lines)


def verdict(outcome: Outcome) -> str:
    """Return in words whether the vehicle flies."""
    if outcome.away <= THERE:
        return 'flies'
    if outcome.end <= THERE:
        return 'late'
    return f'{outcome.away:.2f} m off' if outcome.away < 1.0 else 'falls'


def spans(numbers: list[int]) -> str:
    """Return numbers as ranges: 1-4, 6."""
    first = [number for number in numbers if number - 1 not in numbers]
    last = [number for number in numbers if number + 1 not in numbers]
    return ', '.join(f'{a}' if a == b else f'{a}-{b}' for a, b in zip(first, last, strict=True))


def delays_table() -> str:
    """Return tilt and drop for each time between loss and announcement."""
    rows = []
    delays = (0.05, 0.1, 0.2, 0.5, 1.0, None)
    for name in ('hexarotor', 'hexarotor_ppnnpn', 'octorotor', 'x8', 'y6'):
        case, words = Case.load(name), []
        for delay in delays:
            found = lose(case, 'exact', 1, delay)
            how = f'{degrees(found.tilt):.0f}°, {max(found.drop, 0.0):.2f} m'
            words.append({'flies': how, 'late': f'{how}, late'}.get(verdict(found), 'falls'))
        rows.append((f'`{name}`', *words))
    return table(('rotor 1 of', *(f'{d:g} s' if d else 'never' for d in delays)), rows)


if __name__ == '__main__':
    # The state of a tumbling vehicle overflows.
    warnings.simplefilter('ignore', RuntimeWarning)
    fill('failure.md', rotors=rotors_table(), delays=delays_table())
