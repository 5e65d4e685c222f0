"""The dynamic study: a flight to a waypoint with each method, as in Figures 2 to 4."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import pandas as pd
from tqdm import tqdm

from ca_ros.allocation import Allocator
from ca_ros.arguments import split
from ca_ros.evaluation.animation import Curves, animate
from ca_ros.evaluation.cases import Case, command, interrupts, parser, positive
from ca_ros.evaluation.dynamic_plots import draw
from ca_ros.evaluation.dynamic_tables import document, observation_lines, table
from ca_ros.evaluation.environment import machine, versions
from ca_ros.evaluation.flight_metrics import margins, metrics, torque_errors
from ca_ros.evaluation.observations import observe
from ca_ros.evaluation.paper import of_the_paper
from ca_ros.evaluation.ros_flight import RosFlightError, check, fly_over_ros
from ca_ros.flight.closed_loop import Change, fly
from ca_ros.flight.record import Flight
from ca_ros.flight.rotor_failures import add_options, arguments, failures_of
from ca_ros.flight.waypoint import Waypoint
from ca_ros.problem.audit import audit
from ca_ros.problem.problem import AllocationProblem

WAYPOINT = Waypoint.of(1.0, 1.0, 1.0, math.radians(45.0))
"""The paper's."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    try:
        case = Case.load(options.vehicle, options.param)
        allocators = case.allocators(options.methods)
        failures = failures_of(options)
        failures.check(case.vehicle.n)
        changes = {name: case.failing(name, failures) for name in allocators}
        if options.ros:
            check(list(allocators))
        options.out.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as error:
        print(f'dynamic_study: {error}', file=sys.stderr)
        return 1
    with interrupts() as stop:
        # Errors in a method of the user's own are shown with their traceback.
        try:
            flights = _fly(case, allocators, changes, options, stop)
            found = _write(case, flights, changes, options) if flights else {}
        except (RosFlightError, FloatingPointError, OSError) as error:
            print(f'dynamic_study: {error}', file=sys.stderr)
            return 1
    if flights:
        print(table(found), *observation_lines(found), sep='\n')
        print(f'written: dynamic.csv, .json, .md and plots in {options.out}')
    if len(flights) < len(allocators):
        print(
            f'dynamic_study: interrupted after {len(flights)} of {len(allocators)} flights',
            file=sys.stderr,
        )
        return 128 + stop[0]
    return 0


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'dynamic_study',
        'Fly to (1, 1, 1) m and 45 degrees with each method: dynamic.csv, dynamic.json, '
        'dynamic.md and plots.',
    )
    made.add_argument(
        '--duration', type=partial(positive, float), default=10.0, help='time of flight [s]'
    )
    made.add_argument(
        '--ros',
        action='store_true',
        help='fly over the ROS nodes, in lockstep: the same flights, to the last bit',
    )
    made.add_argument(
        '--animate', action='store_true', help='write animation.gif too: the flights as a film'
    )
    add_options(made)
    own, ros = split(argv)
    options = made.parse_args(own)
    if given := [word for word in ros if word in ('-p', '--param', '--params-file')]:
        # The nodes would fly something other than what the study judges.
        made.error(f'{given[0]} after --ros-args: give parameters by --vehicle and -p before it')
    options.ros_arguments = ros
    return options


def _fly(
    case: Case,
    allocators: Mapping[str, Allocator],
    changes: Mapping[str, Sequence[Change]],
    options: argparse.Namespace,
    stop: Sequence[int],
) -> dict[str, Flight]:
    """Return the flights by method, as many as were complete when `stop` came."""
    flights = {}
    for name, allocator in tqdm(
        allocators.items(), unit=' flights', disable=not sys.stderr.isatty()
    ):
        flight: Flight | None
        if options.ros:
            words = [*arguments(failures_of(options)), *options.ros_arguments]
            flight = fly_over_ros(case, name, WAYPOINT, options.duration, stop, words)
        else:
            flight = fly(
                case.controller(),
                allocator,
                case.body(),
                WAYPOINT,
                options.duration,
                case.parameters['simulator.time_step'],
                changes=changes[name],
            )
        if stop or flight is None:
            break
        flights[name] = flight
    return flights


def _write(
    case: Case,
    flights: Mapping[str, Flight],
    changes: Mapping[str, Sequence[Change]],
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Write all files; return what dynamic.json holds."""
    controller, failures = case.controller(), failures_of(options)
    paper = of_the_paper(case.parameters)
    last = failures.physical(case.vehicle.health, round(options.duration * 1e9))
    # The paper's observations are about sound vehicles.
    observations = (
        [] if options.fail else observe(flights, AllocationProblem(case.vehicle), WAYPOINT)
    )
    found = {
        'vehicle': case.name,
        'duration': options.duration,
        'flown': 'over ROS nodes in lockstep' if options.ros else 'offline',
        'command': _command(options),
        'methods': {
            name: metrics(flight, controller, WAYPOINT, changes[name])
            for name, flight in flights.items()
        },
        'failures': arguments(failures),
        'lost_axes': audit(case.vehicle.with_health(last)).lost,
        'observations': {each.sentence: each.holds for each in observations if paper},
        'numbers': {
            each.sentence if paper else each.subject: each.numbers for each in observations
        },
        'changes': case.changes,
        'parameters': case.parameters,
        'versions': versions(),
        'machine': machine(),
    }
    rows = pd.concat(
        pd.DataFrame({'method': name, **flight.columns()}) for name, flight in flights.items()
    )
    rows.to_csv(options.out / 'dynamic.csv', index=False, lineterminator='\n')
    text = json.dumps(found, indent=2) + '\n'
    (options.out / 'dynamic.json').write_text(text, encoding='utf-8')
    (options.out / 'dynamic.md').write_text(document(found), encoding='utf-8')
    asked = {
        name: (flight, controller, WAYPOINT, changes[name]) for name, flight in flights.items()
    }
    wanted = options.fail or options.animate
    room = {name: margins(*each) for name, each in asked.items()} if wanted else {}
    if options.animate:
        curves = {name: Curves(room[name], torque_errors(*each)) for name, each in asked.items()}
        path = options.out / 'animation.gif'
        animate(path, flights, curves, case.vehicle, WAYPOINT, failures)
    moments = [time / 1e9 for time in failures.times()]
    draw(
        options.out,
        flights,
        case.vehicle,
        WAYPOINT,
        options.figures,
        moments,
        room if options.fail else {},
    )
    return found


def _command(options: argparse.Namespace) -> list[str]:
    own = {
        name: value
        for name, value in vars(options).items()
        if name not in ('fail', 'announce', 'ros_arguments')
    }
    return [
        *command('dynamic_study', argparse.Namespace(**own)),
        *arguments(failures_of(options)),
    ]


if __name__ == '__main__':
    raise SystemExit(main())
