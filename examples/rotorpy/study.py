"""Flights in rotorpy 3.0.0 behind its SE3 controller, one allocation method beside the other.

    pip install rotorpy==3.0.0
    python examples/rotorpy/study.py --seeds 30 --out out/rotorpy

writes flights.csv (a row a flight), study.md (recoveries of each cell) and study.png.  A study
that was interrupted goes on where flights.csv ends.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from multiprocessing import Pool
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from adapter import AnyMultirotor, Controller, params_of, vehicle_of
from scipy.spatial.transform import Rotation

from ca_ros import Allocator, Vehicle, make_allocator
from ca_ros.arrays import Array
from ca_ros.problem.vehicle_problem import problem_of

STEP, DURATION = 0.005, 8.0  # [s]
FAILURE, TOLD = 1.0, 1.1  # when a rotor is lost, and when the allocator is told [s]
FIRST_SEED = 10  # seeds 0 to 9 served to write the study
ERROR_MAX = {'wind': 2.0, 'aggressive': 2.0}  # in the last second of a recovered flight [m]
STILL_ERROR_MAX, TILT_MAX = 0.5, 0.5  # of other conditions; of the tilt [m, rad]



def weights_in_si(vehicle: Vehicle) -> dict[str, Any]:
    """Return weights of N and N m, which suit vehicles of about 1 kg, as ca_ros had before."""
    problem = problem_of(vehicle)
    moving = problem.half_range > 0.0
    return {'wu': np.where(moving, problem.half_range, 1.0),
            'wv': [100.0, 1000.0, 1000.0, 1.0] * problem.extent}  # fmt: skip


METHODS: dict[str, tuple[str, dict[str, Any] | Callable[[Vehicle], dict[str, Any]]]] = {
    "rotorpy's own": ('', {}),
    'pseudo-inverse': ('pseudo_inverse', {}),
    "PX4's": ('sequential_desaturation', {}),
    'exact, scale': ('exact', {'policy': 'scale'}),
    'WLS, weights in SI': ('weighted_least_squares', weights_in_si),
    'WLS': ('weighted_least_squares', {}),
    "PX4's, airmode": ('sequential_desaturation', {'airmode': 'roll_pitch_yaw'}),
    'exact, free thrust': ('exact', {'axis_reversal': 'allow'}),
    'exact': ('exact', {}),
}
"""The methods by their names in the table: name and settings for `make_allocator`.

PX4's method is that since its #28589; with the failures here that of before gives the same bits.
"""

CONDITIONS = 'upset', 'step', 'wind', 'aggressive', 'rotor lost'
OURS = {'hexarotor': (0.02, 5e-4), 'hexarotor_ppnnpn': (0.02, 5e-4), 'octorotor': (0.02, 5e-4)}
"""Shipped vehicles, with the lag of their motors [s] and the drag of a rotor [N s^2/(rad m)]."""


class Flight(NamedTuple):
    """One flight."""

    vehicle: str
    condition: str
    method: str
    seed: int


def parameters(name: str) -> tuple[dict[str, Any], Vehicle]:
    """Return rotorpy's parameters and ours of a vehicle."""
    if name in OURS:
        vehicle = Vehicle.load(name)
        return params_of(vehicle, *OURS[name]), vehicle
    from rotorpy.vehicles import crazyflie_params, hummingbird_params

    params = {'crazyflie': crazyflie_params, 'hummingbird': hummingbird_params}[name].quad_params
    return params, vehicle_of(params)


def allocator_of(method: str, vehicle: Vehicle, health: Array) -> Allocator | None:
    """Return the allocator of a method, or None: rotorpy's own, which is told of no failure."""
    name, given = METHODS[method]
    settings = given(vehicle.with_health(health)) if callable(given) else given
    return make_allocator(name, vehicle, **settings).with_health(health) if name else None


def start(condition: str, rng: np.random.Generator, n: int) -> dict[str, Array]:
    """Return the initial state."""
    state = {
        'x': np.zeros(3), 'v': np.zeros(3), 'q': np.array([0.0, 0.0, 0.0, 1.0]),
        'w': np.zeros(3), 'wind': np.zeros(3),
    }
    if condition == 'upset':
        way = rng.uniform(0.0, 2.0 * np.pi)
        tilt = rng.uniform(np.radians(60.0), np.radians(170.0))
        turn = Rotation.from_rotvec(tilt * np.array([np.cos(way), np.sin(way), 0.0]))
        state['q'] = (Rotation.from_euler('z', rng.uniform(-np.pi, np.pi)) * turn).as_quat()
        state['w'] = rng.uniform(-1.0, 1.0, 3) * [8.0, 8.0, 3.0]
        state['v'] = rng.uniform(-2.0, 2.0, 3)
    return state


def target_of(condition: str, rng: np.random.Generator) -> Callable[[float], dict[str, Any]]:
    """Return the target over time."""
    still = {key: np.zeros(3) for key in ('x', 'x_dot', 'x_ddot', 'x_dddot', 'x_ddddot')}
    still |= {'yaw': 0.0, 'yaw_dot': 0.0, 'yaw_ddot': 0.0}
    if condition == 'step':
        way = rng.normal(size=3)
        place = rng.uniform(4.0, 8.0) * way / np.linalg.norm(way)
        yaw = rng.uniform(-np.pi, np.pi)
        return lambda t: {**still, 'x': place, 'yaw': yaw}
    if condition == 'aggressive':
        radius, speed = rng.uniform(3.0, 5.0), rng.uniform(5.0, 7.0)
        rate, first = rng.choice([-1.0, 1.0]) * speed / radius, rng.uniform(0.0, 2.0 * np.pi)
        heading = rng.uniform(0.5, 1.5)

        def circle(t: float) -> dict[str, Any]:
            # The circle begins at the origin and slows down for the last second.
            angle = first + rate * t
            ray = np.array([np.cos(angle), np.sin(angle), 0.0])
            tangent = np.array([-ray[1], ray[0], 0.0])
            origin = radius * np.array([np.cos(first), np.sin(first), 0.0])
            return {**still, 'x': radius * ray - origin, 'x_dot': radius * rate * tangent,
                    'x_ddot': -radius * rate**2 * ray, 'yaw': heading * t,
                    'yaw_dot': heading}  # fmt: skip

        return circle
    return lambda t: still


def wind_of(condition: str, rng: np.random.Generator) -> Callable[[float], Array]:
    """Return the wind over time [m/s]."""
    if condition != 'wind':
        return lambda t: np.zeros(3)
    way = rng.uniform(0.0, 2.0 * np.pi)
    mean = rng.uniform(4.0, 8.0) * np.array([np.cos(way), np.sin(way), 0.0])
    gusts, rates, phases = rng.normal(size=(4, 3)), rng.uniform(0.5, 6.0, 4), rng.uniform(0, 6, 4)
    return lambda t: mean + gusts.T @ np.sin(rates * t + phases)


def fly(flight: Flight) -> dict[str, Any]:
    """Fly once; return what came of it, as a row."""
    rng = np.random.default_rng((flight.seed, CONDITIONS.index(flight.condition)))
    params, vehicle = parameters(flight.vehicle)
    state, target = start(flight.condition, rng, vehicle.n), target_of(flight.condition, rng)
    wind, rotor = wind_of(flight.condition, rng), int(rng.integers(vehicle.n))
    hover = np.sqrt(params['mass'] * 9.81 / (vehicle.n * params['k_eta']))
    state['rotor_speeds'] = np.full(vehicle.n, hover)
    plant, controller = AnyMultirotor(params, state), Controller(params)
    allocator = allocator_of(flight.method, vehicle, np.ones(vehicle.n))
    errors, tilts, lowest = [], [], 0.0
    for k in range(round(DURATION / STEP)):
        now = k * STEP
        if flight.condition == 'rotor lost':
            if k == round(FAILURE / STEP):
                plant.lost[rotor] = True
            if k == round(TOLD / STEP):
                allocator = allocator_of(flight.method, vehicle, 1.0 - np.eye(vehicle.n)[rotor])
        state['wind'] = wind(now)
        goal = target(now)
        wrench = controller.wrench(now, state, goal)
        speeds = allocator.allocate(wrench).speeds if allocator else plant.own_speeds(wrench)
        state = plant.step(state, {'cmd_motor_speeds': speeds}, STEP)
        error = float(np.linalg.norm(state['x'] - goal['x']))
        lowest = min(lowest, float(state['x'][2] - goal['x'][2]))
        if not np.isfinite(error) or error > 50.0:
            errors, tilts = [np.inf], [np.pi]
            break
        if now >= DURATION - 1.0:
            errors.append(error)
            up = Rotation.from_quat(state['q']).as_matrix()[2, 2]
            tilts.append(float(np.arccos(np.clip(up, -1.0, 1.0))))
    # A circle, and a place in wind, are flown tilted.
    upright = flight.condition in ERROR_MAX or max(tilts) < TILT_MAX
    recovered = upright and max(errors) < ERROR_MAX.get(flight.condition, STILL_ERROR_MAX)
    outcome = {'recovered': recovered, 'drop': abs(lowest), 'error': max(errors)}
    return {**flight._asdict(), **outcome}


def flights(seeds: int) -> Iterator[Flight]:
    """Yield all flights: a failure only where enough rotors are left."""
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        for name in ('crazyflie', 'hummingbird', *OURS):
            for condition in CONDITIONS:
                if condition != 'rotor lost' or name in OURS:
                    for method in METHODS:
                        yield Flight(name, condition, method, seed)


def interval(difference: Array, rng: np.random.Generator) -> tuple[float, float]:
    """Return the interval of 95 % of the mean of a difference, by bootstrap over seeds."""
    drawn = rng.choice(difference, (2000, len(difference))).mean(axis=1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(low), float(high)


def row(*cells: Any) -> str:
    """Return a row of a table."""
    return f'| {" | ".join(map(str, cells))} |'


def tables(rows: pd.DataFrame) -> str:
    """Return recoveries by condition, by method with paired differences to `exact`, by cell."""
    names, seeds = list(METHODS), rows['seed'].nunique()
    head = [row('condition', 'of', *names), row(*['---'] * (len(names) + 2))]
    lines = [f'Flights of {seeds} seeds a cell.', '', '## By condition', '', *head]
    flown = rows.pivot_table('recovered', 'condition', 'method', 'count')[names[0]]
    sums = rows.pivot_table('recovered', 'condition', 'method', 'sum', sort=False)[names]
    for condition, counts in sums.iterrows():
        lines.append(row(condition, flown[condition], *(f'{x:.0f}' for x in counts)))
    total = len(rows) // len(names)
    lines += ['', '## By method', '',
              row('method', f'recovered of {total}', '`exact` more, in 100 [95 %]'),
              row(*['---'] * 3)]  # fmt: skip
    wide = rows.pivot_table('recovered', ['vehicle', 'condition', 'seed'], 'method')
    rng = np.random.default_rng(0)
    for name in names:
        apart = 100.0 * (wide['exact'] - wide[name]).groupby('seed').mean().to_numpy()
        low, high = interval(apart, rng)
        differs = '' if name == 'exact' else f'{apart.mean():.1f} [{low:.1f}, {high:.1f}]'
        lines.append(row(name, f'{wide[name].sum():.0f}', differs))
    cells = rows.pivot_table(
        'recovered', ['vehicle', 'condition'], 'method', 'sum', sort=False)[names]
    lines += ['', '## By cell', '', head[0].replace('condition | of', 'vehicle | condition'),
              head[1]]  # fmt: skip
    lines += [row(*cell, *(f'{x:.0f}' for x in counts)) for cell, counts in cells.iterrows()]
    return '\n'.join(lines) + '\n'


def draw(rows: pd.DataFrame, file: Path) -> None:
    """Draw the share of recovered flights of each method, by condition."""
    import matplotlib.pyplot as plt

    from ca_ros.figures import STYLE

    shares = 100.0 * rows.pivot_table('recovered', 'condition', 'method')
    shares = shares.reindex(index=list(CONDITIONS), columns=list(METHODS))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            1, len(shares), figsize=(8.0, 2.6), sharey=True, layout='constrained')
        for ax, (condition, row) in zip(axes, shares.iterrows(), strict=True):
            colors = ['#9aa3ad'] * (len(row) - 1) + ['#1f77b4']
            ax.barh(range(len(row)), row, color=colors)
            ax.set(title=condition, xlim=(0, 118), xticks=[0, 50, 100])
            for i, share in enumerate(row):
                ax.text(share + 2.0, i, f'{share:.0f}', va='center', fontsize=7)
        axes[0].set_yticks(range(len(row)), list(shares.columns))
        axes[len(axes) // 2].set_xlabel('recovered flights [%]')
        figure.savefig(file, dpi=150)
        plt.close(figure)


def main() -> int:
    """Fly all, and write table and figure; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    add = parser.add_argument
    add('--seeds', type=int, default=30, help=f'flights of each cell, from seed {FIRST_SEED} on')
    add('--processes', type=int, default=None)
    add('--out', type=Path, default=Path('out/rotorpy'), metavar='DIR')
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    file, wanted = options.out / 'flights.csv', list(flights(options.seeds))
    done = {*pd.read_csv(file)[[*Flight._fields]].itertuples(index=False, name=None)} if (
        file.exists()) else set()
    begin, todo = time.perf_counter(), [flight for flight in wanted if flight not in done]
    with Pool(options.processes) as pool, file.open('a', encoding='utf-8') as out:
        for i, row in enumerate(pool.imap(fly, todo)):
            out.write(pd.DataFrame([row]).to_csv(
                index=False, header=not done and not i, lineterminator='\n'))
            out.flush()
    rows = pd.read_csv(file).set_index([*Flight._fields]).loc[wanted].reset_index()
    text = tables(rows)
    (options.out / 'study.md').write_text(text, encoding='utf-8')
    draw(rows, options.out / 'study.png')
    print(text)
    print(f'{len(todo)} flights in {time.perf_counter() - begin:.0f} s', file=sys.stderr)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
