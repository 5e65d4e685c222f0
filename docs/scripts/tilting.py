"""Draw docs/tilting.png, and fill the tables of docs/tilting.md.  Takes about three minutes.

With --flights, only fly.  With --instructions, print what the kernel takes on an emulated
microcontroller instead.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path
from time import perf_counter

import firmware as counting
import numpy as np
from pages import DOCS, fill, telling
from scipy.optimize import minimize

from ca_ros import AdmissibleSet, Sector, Vehicle, make_allocator
from ca_ros.allocation.tilt_rates import TiltLimited
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.tables import table
from ca_ros.figures import COLORS, style
from ca_ros.firmware import literals
from ca_ros.firmware.command import checked
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.tilting import firmware_of
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.rotor_failures import RotorFailure, RotorFailures
from ca_ros.flight.trajectory import Trajectory
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import TiltingVehicleProblem, VehicleProblem
from ca_ros.vehicle.files import read, shipped_tilting

WRENCHES = 50
SHOWN = '`hexarotor_tilting`'  # the vehicle on the page

PERIOD, TILT_RATE, SPEED_RATE = 0.02, 3.0, 400.0


def sequential(problem: TiltingVehicleProblem, u: np.ndarray) -> np.ndarray:
    """Return the vectors that SciPy's SLSQP finds, from the clipped pseudo-inverse."""
    limits = []
    for each, k in zip(problem.sets.sets, problem.sets.first, strict=True):
        if not isinstance(each, Sector):
            continue
        place = slice(k, k + each.size)
        limits.append({
            'type': 'ineq', 'fun': lambda x, p=place, r=each.radius: r**2 - x[p] @ x[p],
        })
        if each.half_angle < 3.0:
            slope = np.tan(min(each.half_angle, 1.5707))
            limits.append({
                'type': 'ineq',
                'fun': lambda x, p=place, s=slope: s * x[p][0] - np.linalg.norm(x[p][1:]),
            })
    limits.append({'type': 'eq', 'fun': lambda x: problem.gamma @ x - u})
    start = problem.saturate(np.linalg.pinv(problem.gamma) @ u)
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
        for method in ('exact', 'pseudo_inverse', 'weighted_least_squares', 'SLSQP'):
            taken, errors = [], []
            if method != 'SLSQP':
                options = {'wv': 1.0} if method == 'weighted_least_squares' else {}
                allocator = make_allocator(method, problem, **options)
            for u in drawn:
                begin = perf_counter()
                if method == 'SLSQP':
                    vectors = sequential(problem, u)
                else:
                    vectors = allocator.allocate(u).thrusts
                taken.append(perf_counter() - begin)
                errors.append(np.linalg.norm(u - problem.gamma @ vectors))
            missed = np.mean(np.array(errors) > 1e-6)
            rows.append((
                f'`{name}`', f'`{method}`', f'{100 * missed:.0f} %',
                f'{max(errors):.1e}', f'{1e6 * np.median(taken):.2g}',
            ))
    titles = 'vehicle', 'method', 'misses more than 1e-6', 'worst error [N, N m]', 'median [us]'
    return telling('tilting', titles, rows, lambda row: row[0] == SHOWN)


SLALOM = 't,x,y,z,heading\n0,0,0,0,0\n1,0.4,-0.4,0,0\n2,0.8,0.4,0,0\n3,1.2,-0.4,0,0\n'
ROLL = 't,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n0.5,0,0,0,0.7071068,0,0,0.7071068\n'
THERE = 't,x,y,z,heading\n0,1,1,0,0.5\n'
FLIGHTS = (
    ('hexarotor_tilting', 'slalom, level', SLALOM, ()),
    ('omnidirectional_gimbals', 'roll by 90°', ROLL, ()),
    ('tricopter', 'servo of rotor 2 stuck', THERE, ('2@1=0.05rad',)),
    ('azimuth_boat', 'rotor 1 lost', THERE, ('1@1',)),
)  # vehicle, words, waypoints, failures


def flights_table() -> str:
    """Return how far flights with `exact` are from their goals, from 9 s to 10 s."""
    rows = []
    for name, words, waypoints, broken in FLIGHTS:
        case = Case.load(name, ['controller.attitude:=pose'] * (waypoints == ROLL))
        with tempfile.TemporaryDirectory() as place:
            path = Path(place, 'goals.csv')
            path.write_text(waypoints, encoding='utf-8')
            goals = Trajectory.read(path)
        failures = RotorFailures(tuple(map(RotorFailure.parse, broken)), 0.1)
        changes = [*case.failing('exact', failures), *goals.changes()]
        flight = fly(case.controller(), case.allocator('exact'), case.plant(), goals.first, 10.0,
                     changes=changes)
        error = np.linalg.norm(flight.position - goals.last.position, axis=1)
        rows.append((
            f'`{name}`', words, f'{1e3 * error[flight.time >= 9.0].max():.1f}',
            f'{np.degrees(flight.attitude_error(goals.last)):.1f}',
        ))
    titles = 'vehicle', 'flight', 'position [mm]', 'attitude [°]'
    return table(titles, rows, words=2)


def figure() -> None:
    """Draw the angles of a thruster whose thrust passes through zero."""
    import matplotlib

    matplotlib.use('agg')
    from matplotlib import pyplot

    vehicle = Vehicle.load('azimuth_boat')
    exact, limited = make_allocator('exact', vehicle), TiltLimited(vehicle, SPEED_RATE, TILT_RATE)
    plain = make_allocator('pseudo_inverse', vehicle)
    inverse = np.linalg.pinv(exact.problem.gamma)
    side = -4.0 * (inverse @ [0.0, 0.0, 8.0])[1] + 0.02
    times = np.arange(0.0, 2.0 * np.pi, PERIOD)
    demands = np.array([[16.0 * np.cos(t), side, 8.0] for t in times])
    first = exact.allocate(demands[0])
    speeds, angles, found, slow = first.speeds, first.angles, [], None
    for u in demands:
        answer = limited.allocate(u, speeds, angles, PERIOD)
        speeds, angles = answer.speeds, answer.angles
        jump = plain.allocate(u)
        slow = jump.angles if slow is None else slow
        step = (jump.angles - slow + np.pi) % (2.0 * np.pi) - np.pi
        slow = slow + np.clip(step, -TILT_RATE * PERIOD, TILT_RATE * PERIOD)
        turned = vehicle.tilts.directions(slow)
        forces = vehicle.thrusts(jump.speeds)[:, None] * turned
        torque = np.cross(vehicle.arms, forces).sum(axis=0)[2]
        wrench = np.array([*forces.sum(axis=0)[:2], torque])
        found.append((
            angles[0], jump.angles[0], np.linalg.norm(answer.residual),
            np.linalg.norm(u - wrench), vehicle.thrusts(speeds)[0],
            vehicle.thrusts(jump.speeds)[0],
        ))
    mine, other, error, missed, thrust, before = np.array(found).T
    mine = np.unwrap(mine)
    print(f'steps up to {np.abs(np.diff(mine)).max():.3f} rad, errors up to {error.max():.1e}; '
          f'pseudo-inverse {np.abs(np.diff(other)).max():.2f} rad, {missed.max():.2f} N')
    with pyplot.rc_context(style()):
        drawing, axes = pyplot.subplots(3, 1, figsize=(7.1, 5.6), sharex=True)
        for values, label, color in ((other, 'pseudo-inverse', COLORS[1]),
                                     (mine, 'exact, servos at most 3 rad/s', COLORS[0])):
            axes[0].plot(times, values, color=color,
                         label=label)
        axes[0].set_ylabel('angle [rad]')
        axes[0].legend(loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=2)
        axes[1].plot(times, before, color=COLORS[1])
        axes[1].plot(times, thrust, color=COLORS[0])
        axes[1].set_ylabel('thrust [N]')
        axes[2].plot(times, missed, color=COLORS[1])
        axes[2].plot(times, error, color=COLORS[0])
        axes[2].set_ylabel('|u - wrench| [N, N m]')
        axes[2].set_xlabel('time [s]')
        drawing.align_ylabels()
        drawing.tight_layout()
        drawing.savefig(DOCS / 'tilting.png', dpi=150, metadata={'Software': None})


def instructions(name: str, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the instructions of sets and of boxes around them (size,).

    The wrenches are uniform in the attainable set, of the boxes in their own one, which is larger.
    """
    vehicle = Vehicle.load(name)
    problem = VehicleProblem(vehicle)
    drawn = AdmissibleSet(problem).sample(np.random.default_rng(0), size).astype(np.float32)
    settings = checked(read(name) | {'allocation.exact.policy': 'scale'}).allocation
    made = firmware_of(faults_of(vehicle, ['none']), settings, 'single')
    boxes = AllocationProblem(problem.gamma, problem.lower, problem.upper)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / 'vectored_data.h').write_text(literals.problems(made), encoding='utf-8')
        own = AdmissibleSet(boxes).sample(np.random.default_rng(0), size).astype(np.float32)
        built = counting.build(boxes, 'kernel', folder)
        box, same = counting.run(built, own), counting.run(built, drawn)
        program, sizes = folder / 'vectored.elf', made.problem.gamma.shape
        parts = [f'-I{folder}', f'-I{counting.KERNEL}', f'-I{DOCS.parent / "benchmarks"}',
                 f'-DCA_M={sizes[0]}', f'-DCA_N={sizes[1]}', '-DCA_FLOAT', '-DCA_FIXED',
                 '-DCOUNT_VECTORED']
        kernel = [counting.KERNEL / f'vectored{part}.c' for part in ('', '_priorities')]
        sources = [str(counting.PROGRAM), *map(str, kernel)]
        command = [counting.COMPILER, *counting.FLAGS, *counting.KERNEL_FLAGS, *parts, *sources]
        subprocess.check_call([*command, '-lm', '-o', str(program)])
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
        raise SystemExit(0)
    fill('tilting.md', flights=flights_table())
    if not options.flights:
        figure()
        fill('tilting.md', methods=methods_table(options.wrenches))
