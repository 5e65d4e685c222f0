"""The dynamic study: a flight to a waypoint with each method, as in Figures 2 to 4."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from tqdm import tqdm

from ca_ros.allocation import Allocator
from ca_ros.arguments import named, positive
from ca_ros.bringup.flight_options import (
    add_options,
    failure_words,
    failures_of,
    trajectory_of,
    trajectory_words,
)
from ca_ros.problem.audit import audit
from ca_ros.settings import ParameterError
from ca_ros.simulation.closed_loop import Change, Found, fly, waypoint_changes
from ca_ros.simulation.record import Flight
from ca_ros.studies.cases import Case
from ca_ros.studies.dynamic.manoeuvres import MANOEUVRES, fly_seeds, summary
from ca_ros.studies.dynamic.metrics import (
    RECOVERED,
    Flights,
    has_margin,
    metrics,
    sample_errors,
)
from ca_ros.studies.dynamic.plots import ROWS, draw
from ca_ros.studies.dynamic.tables import document, observations
from ca_ros.studies.result_files import facts, write
from ca_ros.studies.study_cli import case_of, parser, run_command, run_function
from ca_ros.studies.tables import render
from ca_ros.vehicle.state import NULL_STATE

FOR_MANOEUVRES = {'vehicle', 'methods', 'param', 'out', 'manoeuvres', 'seeds'}
"""The options that count with ``--manoeuvres``."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    return run_command('dynamic_study', _study, options)


def dynamic_study(**options: Any) -> pd.DataFrame:
    """Fly; return a row for each moment and method, as in dynamic.csv.

    With `manoeuvres` it has a row for each flight, as manoeuvres.csv.

    Parameters
    ----------
    **options
        Those of the command: ``vehicle='x8', duration=5.0, fail='1@2'``.  With `out`, a folder,
        its files are written, too.

    Raises
    ------
    ValueError, CaRosError
        If an option is wrong.
    """
    return run_function(_parse, _study, options)


def _study(options: argparse.Namespace) -> tuple[pd.DataFrame, str]:
    """Fly and write all files; return the rows, and what is printed."""
    case, allocators = case_of(options, flying=True)
    options.out.mkdir(parents=True, exist_ok=True)
    if options.manoeuvres is not None:
        rows, text = _fly_manoeuvres(case, allocators, options)
        return rows, f'{text}\nwritten: manoeuvres.csv, .json and .md in {options.out}'
    if 'margin' in options.plot_rows and not has_margin(case.problem):
        raise ParameterError('--plot-rows margin: expected a vehicle whose rotors do not tilt')
    failures = failures_of(options, case.vehicle)
    options.goals = goals = trajectory_of(options)
    changes = {
        name: [*case.announced(name, failures), *waypoint_changes(goals)] for name in allocators}
    if options.detect and failures.failures and failures.announce is not None:
        raise ParameterError('--detect: with --announce never, since nobody else names failures')
    flights, found = _fly(case, allocators, changes, options)
    changes = {name: [*changes[name], *case.detected(name, found[name])] for name in flights}
    rows, text = _write(case, flights, changes, found, options)
    return rows, f'{text}\nwritten: dynamic.csv, .json, .md and plots in {options.out}'


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'dynamic_study',
        'Fly to a waypoint or along a trajectory with each method: dynamic.csv, dynamic.json, '
        'dynamic.md and plots.',
    )
    add = made.add_argument
    add('--duration', type=positive(float), default=10.0, help='time of flight [s]')
    add('--manoeuvres', type=named(MANOEUVRES), metavar='A,B',
        help=f'instead fly manoeuvres that saturate the rotors: {", ".join(MANOEUVRES)}')
    add('--seeds', type=positive(int), default=50, metavar='N', help='of each manoeuvre')
    add('--plot-rows', type=named(ROWS), default=(), metavar='A,B',
        help=f'also draw these rows of each method, rows.png: {", ".join(ROWS)}')
    add_options(made)
    options = made.parse_args(argv)
    given = _given(made, argv)
    # The results name the command, without the options that do not count.
    if 'manoeuvres' in given:
        if strange := given - FOR_MANOEUVRES:
            words = ', '.join(f'--{name.replace("_", "-")}' for name in sorted(strange))
            made.error(f'--manoeuvres: not with {words}')
        options.duration = None
    else:
        if 'seeds' in given:
            made.error('--seeds: only with --manoeuvres')
        options.seeds = None
    return options


def _given(parser: argparse.ArgumentParser, argv: Sequence[str]) -> set[str]:
    """Return the names of the options on a command line, also of those with their defaults."""
    unset: list[str] = []
    names = dict.fromkeys(vars(parser.parse_args([])), unset)
    found = vars(parser.parse_args(argv, argparse.Namespace(**names)))
    return {name for name, value in found.items() if value is not unset}


def _fly_manoeuvres(
    case: Case, allocators: Mapping[str, Allocator], options: argparse.Namespace
) -> tuple[pd.DataFrame, str]:
    """Fly each manoeuvre of each seed with each method; return rows and manoeuvres.md."""
    names = options.manoeuvres
    rows = tqdm(
        fly_seeds(case, list(allocators), names, options.seeds), unit=' flights', disable=None,
        total=len(names) * options.seeds * len(allocators),
    )
    found = pd.DataFrame(rows)
    text = render(
        'manoeuvres.md', table=summary(found), recovered=RECOVERED,
        **(about := facts(case, 'dynamic_study', options)),
    )
    write(options.out / 'manoeuvres', found, about, text)
    return found, text


def _fly(
    case: Case, allocators: Mapping[str, Allocator], changes: Mapping[str, Sequence[Change]],
    options: argparse.Namespace,
) -> tuple[dict[str, Flight], dict[str, Found]]:
    """Return the flights by method, and what a detector found in each."""
    flights, found = {}, dict[str, Found]()
    failures = failures_of(options)
    for name, allocator in tqdm(allocators.items(), unit=' flights', disable=None):
        detection = case.detection(name) if options.detect else None
        flights[name] = fly(
            case.controller(), allocator, case.plant(), options.goals.first, options.duration,
            changes=changes[name], detection=detection, failures=failures)
        found[name] = detection.found if detection else []
    return flights, found


def _write(
    case: Case, flights: Mapping[str, Flight], changes: Mapping[str, Sequence[Change]],
    detected: Mapping[str, Found], options: argparse.Namespace,
) -> tuple[pd.DataFrame, str]:
    """Write all files; return the rows of dynamic.csv, and dynamic.md."""
    goal = options.goals.last
    out, failures = options.out, failures_of(options)
    last = failures.after(case.vehicle, round(options.duration * 1e9))
    samples = {
        name: sample_errors(
            flight, case.controller(), options.goals.first, changes[name], case.body().vehicle,
            failures,
        ) for name, flight in flights.items()
    }
    resting = bool((case.plant().state == NULL_STATE).all())
    words = trajectory_words(options)
    lost = audit(last).lost
    found = {
        'duration': options.duration,
        'start': 'rest at the origin' if resting else 'the initial state of the parameters',
        'goal': str(options.goals),
        **facts(case, 'dynamic_study', options, [*words, *failure_words(failures)]),
        'methods': {
            name: metrics(flight, samples[name], goal) for name, flight in flights.items()
        },
        'failures': failure_words(failures),
        'detected': {name: _named(case, each) for name, each in detected.items()}
        if options.detect else {},
        'lost_axes': lost,
        'observations': list(observations(flights, goal, lost)),
    }
    tables = [{'method': name, **flight.columns()} for name, flight in flights.items()]
    rows = pd.concat(map(pd.DataFrame, tables))
    text = document(found)
    write(out / 'dynamic', rows, found, text)
    times = {name: [time / 1e9 for time, *_ in found] for name, found in detected.items()}
    study = Flights(flights, samples, case.vehicle, options.goals, failures, times)
    if options.figures:
        draw(out, study, options.figures, options.figure_width, options.plot_rows)
    return rows, text


def _named(case: Case, found: Found) -> str:
    """Return which rotors a detector named, when, and on which names nothing was done."""
    first: dict[int, float] = {}
    for time, health, _ in found:
        for rotor in (health < case.vehicle.health).nonzero()[0].tolist():
            first.setdefault(rotor + 1, time / 1e9)
    withheld = found[-1][2].withheld if found else ()
    return ', '.join(
        f'rotor {rotor} at {time:.2f} s{" (not acted on)" * (rotor in withheld)}'
        for rotor, time in first.items()) or 'none'
