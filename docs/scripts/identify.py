"""Identify simulated flights in wind and gusts; print the figures of docs/identify.md."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.closed_loop import Change, fly
from ca_ros.studies.cases import Case
from ca_ros.vehicle.formats.recording import read_recording
from ca_ros.vehicle.identification import Identification, identify

VEHICLE = 'hexarotor_realistic'
FLIGHTS = 24
LEG, LEGS = 1.5, 24  # time to each waypoint, and how many there are [s]
GUESS = [1.4, 0.7, 1.2]  # inertia of the first guess, over the true one
LAG, DELAY = 0.05, 0.01  # of the simulator [s]
AXES = 'roll', 'pitch', 'yaw'


def identified(case: Case, seed: int) -> Identification:
    """Fly to random waypoints at 100 Hz, and identify the vehicle from the flight's file."""
    rng = np.random.default_rng(seed)
    goals = [
        Change(round(1e9 * LEG * k),
               waypoint=Waypoint.of(*rng.uniform(-2.0, 2.0, 3), rng.uniform(-2.0, 2.0)))
        for k in range(LEGS)]
    flight = fly(case.controller(), case.allocator('exact'), case.plant(), goals[0].waypoint,
                 LEG * LEGS, changes=goals)
    guess = replace(case.vehicle, inertia=np.diag(GUESS * np.diag(case.vehicle.inertia)))
    with TemporaryDirectory() as folder:
        file = Path(folder) / 'flight.csv'
        flight.write_csv(file)
        return identify(guess, [read_recording(file, case.vehicle.n)])


def main() -> None:
    """Print the error of each number, and how often its interval holds the truth."""
    truth = {'lag': LAG, 'delay': DELAY, **dict(zip(AXES, GUESS, strict=True))}
    errors: dict[str, list[float]] = {}
    held: dict[str, int] = {}
    for seed in range(FLIGHTS):
        case = Case.load(VEHICLE, [
            f'simulator.seed:={seed}', f'simulator.motor_time_constant:={LAG}',
            f'simulator.command_delay:={DELAY}'])
        found = identified(case, seed)
        pairs = {'lag': found.lag, 'delay': found.delay}
        pairs |= {axis: found.effectiveness[axis] for axis in AXES}
        for name, each in pairs.items():
            errors.setdefault(name, []).append(each.value / truth[name] - 1.0)
            held[name] = held.get(name, 0) + (each.low <= truth[name] <= each.high)
    for name, each in errors.items():
        low, middle, high = 100.0 * np.quantile(each, [0.0, 0.5, 1.0])
        print(f'{name}: {middle:+.1f} % in the median, {low:+.1f} to {high:+.1f} %; '
              f'{held[name]} of {FLIGHTS} intervals hold it')


if __name__ == '__main__':
    main()
