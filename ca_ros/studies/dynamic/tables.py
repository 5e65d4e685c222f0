"""The tables and sentences of dynamic.md, about each method."""

from collections.abc import Callable, Collection, Iterator, Mapping
from math import degrees
from typing import Any

from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.record import Flight
from ca_ros.studies.dynamic.metrics import RECOVERED, TURNING, heading_rate
from ca_ros.studies.tables import number, render, table

Metrics = Mapping[str, Any]


def _heading(own: Metrics, lost: Collection[str]) -> str:
    error = own['steady_state_error']['yaw']
    words = ['given up'] if 'yaw' in lost else []
    if error is None:
        words.append(f'turns at {own["heading_rate"]:.2f} rad/s')
    return ', '.join(words) or f'{degrees(error):.4f}'


def _settled(own: Metrics, lost: Collection[str]) -> str:
    times = [time for axis, time in own['settling_time'].items() if axis not in lost]
    return ', '.join('never' if time is None else f'{time:.2f}' for time in times)


def _overshoot(own: Metrics, lost: Collection[str]) -> str:
    shares = [share for axis, share in own['overshoot'].items() if axis not in lost]
    return ', '.join('turns' if share is None else f'{100.0 * share:.1f}' for share in shares)


COLUMNS: dict[str, Callable[[Metrics, Collection[str]], str]] = {
    'steady-state error of x, y, z [mm]': lambda own, lost: ', '.join(
        f'{1e3 * own["steady_state_error"][axis]:.2f}' for axis in 'xyz'
    ),
    'of the heading [°]': _heading,
    'settling time x, y, z, heading [s]': _settled,
    'overshoot x, y, z, heading [%]': _overshoot,
    'effort [N² s]': lambda own, lost: f'{own["effort"]:.1f}',
    'time at a bound [%]': lambda own, lost: f'{100.0 * own["time_at_bound"]:.1f}',
    'worst residual [N], [N m]': lambda own, lost: ', '.join(
        f'{own[f"worst_{part}_residual"]:.1e}' for part in ('force', 'torque')
    ),
    'greatest tilt [°]': lambda own, lost: f'{degrees(own["greatest_tilt"]):.1f}',
}
"""A cell of each column, from the metrics of a flight and the lost axes."""

BEYOND: dict[str, Callable[[Metrics], str]] = {
    'energy [N¹·⁵ s]': lambda own: f'{own["energy"]:.1f}',
    'change of thrust [N/s]': lambda own: f'{own["smoothness"]:.2f}',
    'recovered': lambda own: 'yes' if own['recovered'] else 'lost',
    'height lost [m]': lambda own: f'{own["height_lost"]:.2f}',
}
"""A cell of each column of the second table, of metrics that the paper leaves out."""


def document(found: Metrics) -> str:
    """Return dynamic.md for a study as in dynamic.json."""
    rows = [
        [f'`{name}`', *(cell(own, found['lost_axes']) for cell in COLUMNS.values())]
        for name, own in found['methods'].items()
    ]
    made = table(['method', *COLUMNS], rows)
    beyond = [
        [f'`{name}`', *(cell(own) for cell in BEYOND.values())]
        for name, own in found['methods'].items()
    ]
    return render(
        'dynamic.md', **found, table=made, beyond=table(['method', *BEYOND], beyond),
        recovered=RECOVERED, turning=TURNING,
    )


def observations(
    flights: Mapping[str, Flight], waypoint: Waypoint, lost: Collection[str] = ()
) -> Iterator[str]:
    """Yield a sentence per flight, for flights that are not the paper's and lose some axes."""
    for name, flight in flights.items():
        error, rate = flight.position_error(waypoint), heading_rate(flight)
        words = [f'With `{name}` the flight ends {number(error)} m from the waypoint']
        if 'yaw' in lost:
            words.append('the heading is given up')
        if abs(rate) > TURNING:
            words.append(f'the vehicle turns at {rate:.2f} rad/s')
        elif 'yaw' not in lost:
            angle = degrees(flight.heading_error(waypoint))
            words.append(f'with a heading error of {number(angle)}°')
        yield f'{", ".join(words)}.'
