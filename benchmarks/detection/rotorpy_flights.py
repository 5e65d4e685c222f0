"""Flights in rotorpy 3.0.0: its rigid body, rotors, drag and SE3 controller, our noise.

It runs at some ten times real time.
"""

import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.detection import tables
from benchmarks.detection.conditions import NOISE
from benchmarks.detection.flights import (
    NAMED,
    VEHICLES,
    Count,
    Outcome,
    Setup,
    namings,
    outcome_of,
    rng_of,
)
from benchmarks.detection.plant import PERIOD, ROW, Rows
from ca_ros import make_allocator
from ca_ros.arrays import Array

sys.path.append(str(Path(__file__).parents[2] / 'examples' / 'rotorpy'))

LAG, DELAY = 0.02, 0.01  # told; the gains of SE3 are for quick motors [s]
SUB = 2  # steps of rotorpy between two states; a command and a state are one step old each
MINUTE, LOST = 60.0, (4.0, 8.0)  # duration of a flight; when a rotor is lost [s]


def target(time: float, points: Sequence[tuple[float, Array, float]]) -> dict[str, Any]:
    """Return the target of rotorpy's controller: the newest of (time, place, heading)."""
    now = [point for point in points if point[0] <= time][-1]
    still = {key: np.zeros(3) for key in ('x_dot', 'x_ddot', 'x_dddot', 'x_ddddot')}
    return {**still, 'x': now[1], 'yaw': now[2], 'yaw_dot': 0.0, 'yaw_ddot': 0.0}


def fly(setup: Setup, seed: int, duration: float, rotor: int | None = None) -> Rows:
    """Return the rows of a flight of a duration [s]; a rotor is lost if one is named."""
    adapter: Any = import_module('adapter')
    rng, n = rng_of(seed, setup.name, 'rotorpy'), setup.vehicle.n
    lag = LAG * (1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.3))
    params = adapter.params_of(setup.vehicle, lag, 5e-4 * rng.uniform(0.8, 1.2))
    params |= {'mass': params['mass'] * rng.uniform(0.97, 1.03)}
    state = {key: np.zeros(3) for key in ('x', 'v', 'w', 'wind')}
    hover = np.sqrt(setup.vehicle.weight / (n * params['k_eta']))
    state |= {'q': np.array([0.0, 0.0, 0.0, 1.0]), 'rotor_speeds': np.full(n, hover)}
    plant = adapter.AnyMultirotor(params, state)
    controller = adapter.Controller(adapter.params_of(setup.vehicle, LAG))
    allocator = make_allocator('exact', setup.vehicle)
    mean, gusts = rng.uniform(-4.0, 4.0, 3) * [1.0, 1.0, 0.2], rng.normal(size=(5, 3)) * 0.5
    speeds, phases = rng.uniform(0.3, 8.0, 5), rng.uniform(0.0, 6.0, 5)
    times = np.arange(0.0, duration, 3.0)
    points = [(t, rng.uniform(-2.0, 2.0, 3), rng.uniform(-0.5, 0.5)) for t in times]
    at, rows = rng.uniform(*LOST), np.zeros(round(duration / PERIOD), ROW)
    old, command = state, np.full(n, hover)
    for i, row in enumerate(rows):
        time = i * PERIOD
        row['time'] = round(time * 1e9)
        turned = Rotation.from_quat(old['q']) * Rotation.from_rotvec(
            NOISE['attitude_noise'] * rng.standard_normal(3))
        measured = {**old, 'q': turned.as_quat()}
        measured['x'] = old['x'] + NOISE['position_noise'] * rng.standard_normal(3)
        row['velocity'] = Rotation.from_quat(old['q']).inv().apply(old['v'])
        row['velocity'] += NOISE['velocity_noise'] * rng.standard_normal(3)
        measured['v'] = turned.apply(row['velocity'])
        measured['w'] = old['w'] + NOISE['rate_noise'] * rng.standard_normal(3)
        row['attitude'], row['rates'] = measured['q'], measured['w']
        row['position'], row['speeds'][:n] = state['x'], state['rotor_speeds']
        wrench = controller.wrench(time, measured, target(time, points))
        new = allocator.allocate(wrench).speeds
        row['command'][:n] = new
        busy = new[rotor or 0] >= np.sqrt(0.5) * hover
        if rotor is not None and time >= at and busy:
            plant.lost[rotor] = True
        row['failed'] = plant.lost.any()
        for k in range(SUB):
            old = state
            state['wind'] = mean + gusts.T @ np.sin(speeds * (time + 0.005 * k) + phases)
            state = plant.step(state, {'cmd_motor_speeds': command if k == 0 else new},
                               PERIOD / SUB)
        command = new
        if not np.isfinite(state['x']).all() or np.linalg.norm(state['x']) > 200.0:
            return rows[:i + 1]
    return rows


def setup_of(seed: int) -> Setup:
    """Return the set-up of a seed: the vehicles take turns."""
    told = {'motor_time_constant': LAG, 'delay': DELAY}
    return Setup.load(VEHICLES[seed % len(VEHICLES)], settings=told)


def healthy(seed: int) -> Count:
    """Fly for a minute without a failure; return what was counted."""
    setup, count = setup_of(seed), Count()
    rows = fly(setup, seed, MINUTE)
    count.overturned += len(rows) < round(MINUTE / PERIOD)
    count.add(rows, list(namings(setup.detector(), rows, setup.vehicle.n)))
    return count


def failing(seed: int) -> Outcome | None:
    """Let a rotor fail; return what the detector named, or None if it did not fail."""
    setup = setup_of(seed)
    rotor = seed // len(VEHICLES) % setup.vehicle.n
    return outcome_of(setup, fly(setup, seed, LOST[1] + NAMED + 2.0, rotor), rotor)


def run(pool: ProcessPoolExecutor, minutes: int, losses: int, first: int) -> str:
    """Fly minutes without a failure, and losses, on seeds from the first on; return the tables."""
    counts = {name: {'rotorpy': Count()} for name in VEHICLES}
    found: dict[tuple[str, ...], list[Outcome]] = {(name, 'total'): [] for name in VEHICLES}
    seeds = range(first, first + minutes)
    for seed, count in zip(seeds, pool.map(healthy, seeds), strict=True):
        counts[setup_of(seed).name]['rotorpy'] += count
    seeds = range(first, first + losses)
    for seed, outcome in zip(seeds, pool.map(failing, seeds), strict=True):
        if outcome is not None:
            found[setup_of(seed).name, 'total'].append(outcome)
    return tables.alarms(counts) + '\n' + tables.names(found, ('vehicle', 'failure'))
