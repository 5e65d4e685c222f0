"""Flights for docs/detection.md: unannounced failures, and hours without one."""

from __future__ import annotations

import argparse
from dataclasses import replace
from time import process_time

import numpy as np

from ca_ros.evaluation.cases import Case
from ca_ros.flight.closed_loop import Change, fly
from ca_ros.flight.detection import Detection
from ca_ros.flight.plant import Plant
from ca_ros.flight.rigid_body import RigidBody
from ca_ros.flight.waypoint import Waypoint

VEHICLES = ('hexarotor', 'hexarotor_ppnnpn', 'hexarotor_tilted', 'octorotor', 'x8', 'y6')

NOISE = {'position': 0.01, 'velocity': 0.03, 'attitude': 0.005, 'angular_velocity': 0.02}


def realistic(noise=1.0, lag=0.05, delay=0.01, gusts=0.5, wind=1.0):
    """Return the parameters of a realistic simulation."""
    return [
        f'detector.motor_time_constant:={lag}', f'detector.delay:={delay}',
        f'simulator.motor_time_constant:={lag}', f'simulator.command_delay:={delay}',
        'controller.integral_gain:=0.5', 'simulator.rotor_drag:=5.0e-4',
        f'simulator.wind:=[{wind}, 0.0, 0.0]',
        f'simulator.gust_intensity:=[{gusts}, {gusts}, {gusts}]',
        *(f'simulator.{part}_noise:={noise * one}' for part, one in NOISE.items()),
    ]


def turns(*points):
    """Return the changes of a flight to waypoints (t, x, y, z, heading)."""
    return [Change(round(t * 1e9), waypoint=Waypoint.of(*where)) for t, *where in points]


# Parameters, the first waypoint, further ones, and when the rotor fails [s].
MANOEUVRES = {
    'hover': ([], (0, 0, 1, 0), [], 4.0),
    'forward': ([], (0, 0, 2, 0), turns((2.0, 15, 0, 2, 0)), 4.5),
    'climb': (['controller.speed_max:=20.0'], (0, 0, 30, 0), [], 1.0),
    'slalom': ([], (0, 0, 2, 0), turns(*(
        (1.5 * k, 3.0 * k, 3.0 * (-1) ** k, 2.0 + 0.5 * (-1) ** k, 1.0 * (-1) ** k)
        for k in range(1, 5))), 3.7),
}


def failed(vehicle, manoeuvre, rotor, changes, announce=None, seed=0):
    """Fly with a failure; return the flight and its detection (None if it is announced)."""
    own, first, points, at = MANOEUVRES[manoeuvre]
    case = Case.load(vehicle, [*changes, *own, f'simulator.seed:={seed}'])
    health = np.ones(case.vehicle.n)
    health[rotor] = 0.0
    events = [*points, Change(round(at * 1e9), body=case.body(health))]
    detection = case.detection('exact') if announce is None else None
    if announce is not None:
        told = case.audited(health)
        events.append(Change(
            round((at + announce) * 1e9), case.controller(told), case.allocator('exact', told)))
    goal = points[-1].waypoint if points else Waypoint.of(*first)
    # It holds the place where it was bound for.
    flight = fly(
        case.controller(), case.allocator('exact'), case.plant(), Waypoint.of(*first),
        at + (16.0 if manoeuvre == 'forward' else 8.0), changes=events,
        detection=detection)
    return flight, detection, goal, at, case


def held(flight, goal):
    """Return whether the last second is within 0.5 m of the waypoint."""
    return bool((np.linalg.norm(flight.position[-100:] - goal.position, axis=1) < 0.5).all())


def row(vehicle, manoeuvre, rotor, changes, seed=0):
    """Return what happened to one failure, announced after 0.1 s and detected."""
    cells = []
    for announce in (0.1, None):
        try:
            flight, detection, goal, at, case = failed(
                vehicle, manoeuvre, rotor, changes, announce, seed)
            cells.append(held(flight, goal))
        except FloatingPointError:
            cells.append(False)
            continue
    first = next(((t, h) for t, h in detection.found), None) if detection else None
    after = asked = named = None
    if first:
        named = [int(i) + 1 for i in np.flatnonzero(detection.detector.health < 1.0)]
        after = first[0] / 1e9 - at
        hover = case.vehicle.weight / case.vehicle.n / case.vehicle.thrust_per_squared_speed
        begin = round(at * 100)
        end = round(first[0] / 1e7)
        busy = flight.speeds[begin:end, rotor] ** 2 >= 0.5 * hover[rotor]
        asked = 0.01 * int(busy.sum())
    return {'announced': cells[0], 'detected': cells[-1], 'after': after, 'asked': asked,
            'named': named}


def table(options):
    """Print the table of failures."""
    changes = realistic(options.noise, options.lag, options.delay, options.gusts, options.wind)
    for vehicle in options.vehicles:
        for manoeuvre in options.manoeuvres:
            n = Case.load(vehicle).vehicle.n
            rotors = range(n) if options.rotors is None else options.rotors
            rows = {i + 1: row(vehicle, manoeuvre, i, changes) for i in rotors}
            times = [1000 * each['after'] for each in rows.values() if each['after'] is not None]
            print(
                f'{vehicle:16s} {manoeuvre:8s} announced',
                ''.join('x' if each['announced'] else '-' for each in rows.values()), 'detected',
                ''.join('x' if each['detected'] else '-' for each in rows.values()),
                'median', np.median(times) if times else None,
                'all', ' '.join(
                    f'{1000 * e["after"]:.0f}' if e['after'] is not None else 'none'
                    for e in rows.values()),
                'wrong', {i: e['named'] for i, e in rows.items()
                          if e['named'] not in (None, [i])},
                flush=True)


class Faulty(Detection):
    """A detection whose states are late, repeated or dropped."""

    def __init__(self, detection, rng):
        self.detector, self._rebuild, self.found = detection.detector, detection._rebuild, []
        self._rng, self._waiting = rng, []

    def observe(self, time, state):
        if self._rng.random() < 0.02:
            return None
        late = time + int(self._rng.integers(0, 20_000_000))
        self._waiting += [(late, time, state)] * (1 + (self._rng.random() < 0.02))
        due = sorted((each for each in self._waiting if each[0] <= time), key=lambda e: e[0])
        self._waiting = [each for each in self._waiting if each[0] > time]
        parts = None
        for _, stamp, old in due:
            parts = super().observe(stamp, old) or parts
        return parts


class Weather(Plant):
    """A plant whose wind steps at times."""

    def step(self, command):
        """Take a step; every five seconds, in the mean, the wind steps."""
        if not hasattr(self, '_steps'):
            self._steps = np.random.default_rng(int(self._settings.seed))
        if self._steps.random() < self.time_step / 5.0:
            self._wind.mean = self._steps.uniform(-4.0, 4.0, 3) * [1.0, 1.0, 0.3]
        return super().step(command)

    def restarted(self, state=None):
        """As `Plant.restarted`, with the steps of the wind."""
        return Weather(self.body, self._settings, state)


def loaded(case, rng):
    """Return the body with 15 % more mass, up to 5 cm off the centre."""
    body, vehicle = case.body(), case.vehicle
    offset = 0.15 / 1.15 * np.append(rng.uniform(-0.05, 0.05, 2), 0.0)
    heavy = replace(body.vehicle, mass=body.vehicle.mass * 1.15, arms=vehicle.arms - offset)
    return RigidBody(heavy, body.drag)


def eventless(vehicle, seed, options, duration=60.0):
    """Fly a minute without a failure; return the false alarms [s]."""
    rng = np.random.default_rng(seed)
    factors = rng.choice([0.9, 1.0, 1.1], 2)
    case = Case.load(vehicle, [
        *realistic(options.noise, options.lag, options.delay, options.gusts, options.wind),
        f'simulator.seed:={seed}', 'simulator.ground:=flat',
        f'simulator.mass_factor:={factors[0]}', f'simulator.thrust_factor:={factors[1]}',
    ])
    points, t = [], 4.0
    while t < duration - 10.0:
        points.append((t, *rng.uniform(-10, 10, 2), rng.uniform(3, 8), rng.uniform(-3, 3)))
        t += rng.uniform(1.0, 6.0)
    points += [(duration - 8.0, *rng.uniform(-5, 5, 2), 1.0, 0.0), (duration - 4.0, 0, 0, -0.5, 0)]
    events = [*turns(*points), Change(round(rng.uniform(5.0, 45.0) * 1e9), body=loaded(case, rng))]
    detection = case.detection('exact')
    detection = Faulty(detection, rng) if seed % 2 else detection
    plant = Weather(case.body(), case.flown.simulator)
    fly(case.controller(), case.allocator('exact'), plant, Waypoint.of(0, 0, 2, 0), duration,
        changes=events, detection=detection)
    return [(time / 1e9, health.round(2).tolist()) for time, health in detection.found]


def hours(options):
    """Fly without a failure, and print the false alarms."""
    flown = alarms = 0
    begin = process_time()
    for seed in range(options.first, options.first + round(60 * options.hours)):
        vehicle = options.vehicles[seed % len(options.vehicles)]
        try:
            found = eventless(vehicle, seed, options)
        except FloatingPointError as error:
            print(vehicle, seed, error)
            continue
        flown += 1
        alarms += bool(found)
        if found:
            print(vehicle, seed, found[:2], flush=True)
    spent = process_time() - begin
    print(f'{flown / 60:.2f} h, {alarms} flights with a false alarm, {spent:.0f} s')


def main():
    """Print a table of failures, or fly for hours without one."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add('--hours', type=float, default=0.0, help='fly so long without a failure [h]')
    add('--first', type=int, default=0, help='seed of the first flight')
    add('--vehicles', nargs='+', default=VEHICLES)
    add('--manoeuvres', nargs='+', default=list(MANOEUVRES))
    add('--rotors', nargs='+', type=int)
    for name, default in (('noise', 1.0), ('lag', 0.05), ('delay', 0.01), ('gusts', 0.5),
                          ('wind', 1.0)):
        add(f'--{name}', type=float, default=default)
    options = parser.parse_args()
    (hours if options.hours else table)(options)


if __name__ == '__main__':
    main()
