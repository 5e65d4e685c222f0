"""The pages that scripts fill, and what the scripts share."""

import re
import warnings
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.closed_loop import fly
from ca_ros.simulation.record import Flight
from ca_ros.studies.cases import Case
from ca_ros.studies.engine import compute
from ca_ros.studies.tables import table
from ca_ros.vehicle.files import shipped_vehicles
from ca_ros.vehicle.vehicle import Vehicle

DOCS = Path(__file__).resolve().parents[1]
HEAVY = 1.35  # ratio of greatest thrust to weight of the heavy vehicles


def filled(text: str, mark: str, content: str) -> str:
    """Return a page with the text between `<!-- MARK -->` and `<!-- end of MARK -->` replaced."""
    new, count = re.subn(
        rf'(<!-- {mark} -->\n).*?(<!-- end of {mark} -->)',
        lambda match: f'{match[1]}\n{content}\n\n{match[2]}', text, flags=re.DOTALL,
    )
    if count != 1:
        raise ValueError(f'expected one place that is marked for {mark}, got {count}')
    return new


def fill(name: str, **contents: str) -> None:
    """Replace the marked parts of a page; an underscore in a name stands for a blank."""
    page = DOCS / name
    text = page.read_text(encoding='utf-8')
    for mark, content in contents.items():
        text = filled(text, mark.replace('_', ' '), content)
    page.write_text(text, encoding='utf-8')


def put(name: str, before: str, after: str, figure: str) -> None:
    """Replace the figure between words that stand once on a page, in one line."""
    page = DOCS / name
    text, count = re.subn(
        rf'({re.escape(before)})[^\n]*?({re.escape(after)})',
        lambda match: f'{match[1]}{figure}{match[2]}', page.read_text(encoding='utf-8'))
    if count != 1:
        raise ValueError(f'{name}: expected {before!r} and {after!r} once, got {count} places')
    page.write_text(text, encoding='utf-8')


def keep(name: str, titles: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> None:
    """Write a table that is too long for a page to `out/NAME.md`."""
    folder = DOCS.parent / 'out'
    folder.mkdir(exist_ok=True)
    (folder / f'{name}.md').write_text(f'{table(titles, rows, words)}\n', encoding='utf-8')


def telling(
    name: str, titles: Sequence[str], rows: Sequence[Sequence[str]],
    shown: Callable[[Sequence[str]], bool], words: int = 1,
) -> str:
    """Keep the table of all rows; return that of the rows that a page shows."""
    keep(name, titles, rows, words)
    return table(titles, [row for row in rows if shown(row)], words)


def shipped(flying: bool = False) -> list[str]:
    """Return the names of the shipped vehicles; one in water does not fly, and has other gains."""
    names = shipped_vehicles()
    return [name for name in names if not (flying and Vehicle.load(name).buoyancy)]


def both_masses(
    name: str, changes: Sequence[str] = (), methods: Sequence[str] = ()
) -> Iterator[tuple[str, Case]]:
    """Yield a vehicle as its file says and as a heavy one, with their titles."""
    case = Case.load(name, changes, methods)
    yield f'`{name}`', case
    mass = float(case.vehicle.thrust_max.sum()) / case.vehicle.gravity / HEAVY
    yield f'`{name}`, heavy', Case.load(name, (*changes, f'vehicle.mass:={mass}'), methods)


def spread(task: Callable[..., Any], cells: Sequence[Sequence[Any]]) -> list[Any]:
    """Return what a task of a script finds for each of the cells, its arguments, on all cores."""
    everywhere = Namespace(workers=None, scheduler=None)
    return compute(partial(_cell, task, cells), len(cells), everywhere, unit=' cells')


def _cell(task: Callable[..., Any], cells: Sequence[Sequence[Any]], number: int) -> Any:
    # The state of a tumbling vehicle overflows.
    warnings.simplefilter('ignore', RuntimeWarning)
    return task(*cells[number])


def trajectory(*points: Sequence[float]) -> Trajectory:
    """Return the trajectory of waypoints (t, x, y, z, heading) [s, m, rad]."""
    times = tuple(round(t * 1e9) for t, *_ in points)
    return Trajectory(times, tuple(Waypoint.of(*where) for _, *where in points))


def flown(
    case: Case, goal: Waypoint, duration: float, method: str = 'exact', plant: Any = None,
    **more: Any,
) -> Flight | None:
    """Fly a case to a waypoint, by default with its plant; return None if the flight diverges."""
    loop = case.controller(), case.allocator(method), plant or case.plant()
    try:
        return fly(*loop, goal, duration, **more)
    except FloatingPointError:
        return None


def distance(flight: Flight, goal: Waypoint, since: float) -> float:
    """Return the greatest distance from a waypoint [m] from some time [s] on."""
    late = flight.position[flight.time >= since]
    return float(np.linalg.norm(late - goal.position, axis=1).max(initial=0.0))
