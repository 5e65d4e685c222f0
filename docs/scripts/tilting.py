"""Draw docs/tilting.png, and fill the tables of docs/tilting.md.  Takes about three minutes.

With --flights, only fly.  With --instructions, print what the kernel takes on an emulated
microcontroller instead.
"""

import argparse
import tempfile
from functools import partial
from pathlib import Path
from time import perf_counter

import firmware as counting
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from pages import DOCS, distance, fill, flown, telling, trajectory
from scipy.optimize import minimize

from ca_ros import AdmissibleSet, Sector, Vehicle, make_allocator
from ca_ros.allocation.tilt_rates import TiltLimited
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.figures import COLORS, style
from ca_ros.firmware import literals
from ca_ros.firmware.command import checked
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.tilting import firmware_of
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.simulation.closed_loop import waypoint_changes
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from ca_ros.studies.tables import table
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.files import read, shipped_tilting
from ca_ros.vehicle.settings import AXES

WRENCHES = 50
METHODS = 'exact', 'pseudo_inverse', 'weighted_least_squares'
SHOWN = '`hexarotor_tilting`'  # the vehicle on the page

PERIOD, TILT_RATE, SPEED_RATE = 0.02, 3.0, 400.0


def sequential(problem: VehicleProblem, u: np.ndarray) -> np.ndarray:
    """Return the vectors that SciPy's SLSQP finds, from the clipped pseudo-inverse."""
    sectors = [
        (slice(k, k + each.size), each.radius, each.half_angle)
        for each, k in zip(problem.sets.sets, problem.sets.first, strict=True)
        if isinstance(each, Sector)
    ]

    def inside(x: np.ndarray) -> list[float]:
        """Return numbers that are not negative for vectors in their sectors."""
        found = []
        for place, radius, angle in sectors:
            found.append(radius**2 - x[place] @ x[place])
            if angle < 3.0:
                slope = np.tan(min(angle, 1.5707))
                found.append(slope * x[place][0] - np.linalg.norm(x[place][1:]))
        return found

    limits = [{'type': 'ineq', 'fun': inside},
              {'type': 'eq', 'fun': lambda x: problem.gamma @ x - u}]
    start = problem.sets.saturate(np.linalg.pinv(problem.gamma) @ u)
    found = minimize(
        lambda x: x @ x, start, jac=lambda x: 2.0 * x, method='SLSQP', constraints=limits,
        bounds=list(zip(problem.lower, problem.upper, strict=True)),
        options={'ftol': 1e-9, 'maxiter': 200},
    )
    return problem.clip(found.x)


def methods_table(wrenches: int) -> str:
    """Return how often and by how much the methods miss attainable wrenches."""
    rows = []
    for name in shipped_tilting():
        problem = VehicleProblem(Vehicle.load(name))
        drawn = AdmissibleSet(problem).sample(np.random.default_rng(0), wrenches)
        calls = {method: make_allocator(method, problem).allocate for method in METHODS[:2]}
        calls[METHODS[2]] = make_allocator(METHODS[2], problem, wv=1.0).allocate
        calls['SLSQP'] = partial(sequential, problem)
        for method, call in calls.items():
            taken, errors = [], []
            for u in drawn:
                begin = perf_counter()
                answer = call(u)
                taken.append(perf_counter() - begin)
                vectors = getattr(answer, 'thrusts', answer)
                errors.append(np.linalg.norm(u - problem.gamma @ vectors))
            missed = np.mean(np.array(errors) > 1e-6)
            rows.append((
                f'`{name}`', f'`{method}`', f'{100 * missed:.0f} %',
                f'{max(errors):.1e}', f'{1e6 * np.median(taken):.2g}',
            ))
    titles = 'vehicle', 'method', 'misses more than 1e-6', 'worst error [N, N m]', 'median [us]'
    return telling('tilting', titles, rows, lambda row: row[0] == SHOWN)


SLALOM = trajectory((0, 0, 0, 0, 0), (1, 0.4, -0.4, 0, 0), (2, 0.8, 0.4, 0, 0),
                    (3, 1.2, -0.4, 0, 0))
ROLLED = Waypoint(np.zeros(3), np.array([1.0, 0.0, 0.0, 1.0]) / np.sqrt(2.0))
ROLL = Trajectory((0, 500_000_000), (Waypoint.of(0, 0, 0, 0), ROLLED))
THERE = trajectory((0, 1, 1, 0, 0.5))
FLIGHTS = (
    ('hexarotor_tilting', 'slalom, level', SLALOM, ()),
    ('omnidirectional_gimbals', 'roll by 90°', ROLL, ()),
    ('tricopter', 'servo of rotor 2 stuck at 0.05 rad', THERE, ('2@1=0.05rad',)),
    ('azimuth_boat', 'rotor 1 lost', THERE, ('1@1',)),
)  # vehicle, words, waypoints, failures


def flights_table() -> str:
    """Return how far flights with `exact` are from their goals, from 9 s to 10 s."""
    rows = []
    for name, words, goals, broken in FLIGHTS:
        case = Case.load(name, ['controller.attitude:=pose'] * (goals is ROLL))
        failures = RotorFailures(tuple(map(RotorFailure.parse, broken)), 0.1)
        changes = [*case.announced('exact', failures), *waypoint_changes(goals)]
        flight = flown(case, goals.first, 10.0, changes=changes, failures=failures)
        rows.append((
            f'`{name}`', words, f'{1e3 * distance(flight, goals.last, 9.0):.1f}',
            f'{np.degrees(flight.attitude_error(goals.last)):.1f}',
        ))
    return table(('vehicle', 'flight', 'position [mm]', 'attitude [°]'), rows, words=2)


def figure() -> None:
    """Draw the angles of a thruster whose thrust passes through zero."""
    vehicle = Vehicle.load('azimuth_boat')
    exact, limited = make_allocator('exact', vehicle), TiltLimited(vehicle, SPEED_RATE, TILT_RATE)
    plain, rows = make_allocator('pseudo_inverse', vehicle), list(map(AXES.index, vehicle.axes))
    inverse = np.linalg.pinv(exact.problem.gamma)
    side = -4.0 * (inverse @ [0.0, 0.0, 8.0])[1] + 0.02
    times = np.arange(0.0, 2.0 * np.pi, PERIOD)
    demands = np.array([[16.0 * np.cos(t), side, 8.0] for t in times])
    first = exact.allocate(demands[0])
    speeds, angles, found = first.speeds, first.angles, []
    slow = plain.allocate(demands[0]).angles
    for u in demands:
        answer, jump = limited.allocate(u, speeds, angles, PERIOD), plain.allocate(u)
        speeds, angles = answer.speeds, answer.angles
        step = (jump.angles - slow + np.pi) % (2.0 * np.pi) - np.pi
        slow = slow + np.clip(step, -TILT_RATE * PERIOD, TILT_RATE * PERIOD)
        thrusts, pushed = vehicle.thrusts(speeds), vehicle.thrusts(jump.speeds)
        missed = u - rotor_wrenches(vehicle, slow)[rows] @ pushed
        found.append((
            angles[0], jump.angles[0], np.linalg.norm(answer.residual), np.linalg.norm(missed),
            thrusts[0], pushed[0],
        ))
    mine, other, error, missed, thrust, before = np.array(found).T
    mine = np.unwrap(mine)
    print(f'steps up to {np.abs(np.diff(mine)).max():.3f} rad, errors up to {error.max():.1e}; '
          f'pseudo-inverse {np.abs(np.diff(other)).max():.2f} rad, {missed.max():.2f} N')
    panels = {
        'angle [rad]': (other, mine), 'thrust [N]': (before, thrust),
        'error of the wrench\n[N, N m]': (missed, error),
    }
    with matplotlib.rc_context(style()):
        drawing = Figure(figsize=(7.1, 5.6))
        parts = drawing.subplots(3, 1, sharex=True)
        for axes, (label, (theirs, ours)) in zip(parts, panels.items(), strict=True):
            axes.plot(times, theirs, color=COLORS[1], label='pseudo-inverse')
            axes.plot(times, ours, color=COLORS[0], label='exact, servos at most 3 rad/s')
            axes.set_ylabel(label)
        parts[0].set_title(
            'Thruster 1 of azimuth_boat; demand: force x 16 cos(t) N, '
            f'force y {side:.2f} N, yaw 8 N m', y=1.22)
        parts[0].legend(loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=2)
        parts[2].set_xlabel('time [s]')
        drawing.align_ylabels()
        drawing.tight_layout()
        drawing.savefig(DOCS / 'tilting.png', dpi=150, metadata={'Software': None})


def instructions(name: str, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the instructions of sets and of boxes around them (size,).

    The wrenches are uniform in the attainable set, of the boxes in their own one, which is larger.
    """
    vehicle = Vehicle.load(name)
    problem = VehicleProblem(vehicle)
    settings = checked(read(name) | {'allocation.exact.policy': 'scale'}).allocation
    made = firmware_of(faults_of(vehicle, ['none']), settings, 'single')
    boxes = AllocationProblem(problem.gamma, problem.lower, problem.upper)
    drawn, own = (
        AdmissibleSet(each).sample(np.random.default_rng(0), size).astype(np.float32)
        for each in (problem, boxes)
    )
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / 'vectored_data.h').write_text(literals.problems(made), encoding='utf-8')
        built = counting.build(boxes, 'kernel', folder)
        box, same = counting.run(built, own), counting.run(built, drawn)
        options = '-DCA_FLOAT', '-DCA_FIXED', '-DCOUNT_VECTORED', f'-I{counting.KERNEL}'
        program = counting.compiled(
            folder / 'vectored.elf', *counting.given(boxes, folder),
            *options, counting.PROGRAM,
            *(counting.KERNEL / file for file in counting.FILES['vectored']['sources']),
        )
        found = counting.run(program, drawn)
    print(f'{name}: exact {np.mean(found[:, 1] == 0):.3f}, boxes {np.mean(box[:, 1] == 0):.3f}; '
          f'median {np.median(found[:, 0]):.0f} and {np.median(box[:, 0]):.0f}, '
          f'most {found[:, 0].max()} and {box[:, 0].max()}; '
          f'boxes with the wrenches of the sets {np.median(same[:, 0]):.0f}')
    return found[:, 0], box[:, 0]


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--wrenches', type=int, default=WRENCHES)
    parser.add_argument('--flights', action='store_true')
    parser.add_argument('--instructions', type=int, metavar='WRENCHES')
    options = parser.parse_args()
    if options.instructions:
        for vehicle in shipped_tilting():
            instructions(vehicle, options.instructions)
    else:
        fill('tilting.md', flights=flights_table())
        if not options.flights:
            figure()
            fill('tilting.md', methods=methods_table(options.wrenches))
