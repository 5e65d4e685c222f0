"""Fly unannounced failures and fill the tables of docs/detection.md; or fly hours without one."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from pages import DOCS, fill, shipped

from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.dynamic.animation import animate
from ca_ros.evaluation.dynamic.metrics import Flights, sample_errors
from ca_ros.evaluation.tables import table
from ca_ros.flight.closed_loop import Change, fly
from ca_ros.flight.detection import Detection
from ca_ros.flight.plant import Plant
from ca_ros.flight.rigid_body import RigidBody
from ca_ros.flight.rotor_failures import RotorFailure, RotorFailures
from ca_ros.flight.trajectory import Trajectory
from ca_ros.flight.waypoint import Waypoint

LONGER = {'y6': 24.0, 'quadrotor': 1.0}
"""How long a flight goes on after a loss, if not 8 s: one comes back late, one falls [s]."""

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
        at + LONGER.get(vehicle, 16.0 if manoeuvre == 'forward' else 8.0), changes=events,
        detection=detection)
    return flight, detection, goal, at, case


def held(flight, goal):
    """Return whether the last second is within 0.5 m of the waypoint."""
    return bool((np.linalg.norm(flight.position[-100:] - goal.position, axis=1) < 0.5).all())


def row(vehicle, manoeuvre, rotor, changes, seed=0):
    """Return what happened to one failure, announced after 0.1 s and detected."""
    flew, detection, flight = [], None, None
    for announce in (0.1, None):
        try:
            flight, detection, goal, at, case = failed(
                vehicle, manoeuvre, rotor, changes, announce, seed)
            flew.append(held(flight, goal))
        except FloatingPointError:
            flew.append(False)
    outcome = {'announced': flew[0], 'detected': flew[1], 'after': None, 'asked': None,
               'wrong': False}
    if detection and detection.found:
        found = detection.found[0][0] / 1e9
        hover = case.vehicle.weight / case.vehicle.n / case.vehicle.thrust_per_squared_speed
        busy = flight.speeds[:, rotor] ** 2 >= 0.5 * hover[rotor]
        since = (flight.time >= at - 1e-9) & (flight.time < found - 1e-9)
        outcome |= {
            'after': found - at, 'asked': 0.01 * int((busy & since).sum()),
            'wrong': bool((np.delete(detection.detector.health, rotor) < 1.0).any()),
        }
    return outcome


def range_of(times):
    """Return the median and the greatest of times [s], in ms."""
    if not times:
        return 'none'
    return f'{1e3 * np.median(times):.0f}, {1e3 * max(times):.0f}'


def flights_table(options):
    """Return the table of failures in manoeuvres, and of rotors that lose half of their thrust."""
    changes = realistic(options.noise, options.lag, options.delay, options.gusts, options.wind)
    rows = []
    for vehicle in options.vehicles:
        n = Case.load(vehicle).vehicle.n
        flown = {way: [row(vehicle, way, i, changes) for i in range(n)] for way in MANOEUVRES}
        found = [each for rows in flown.values() for each in rows]
        named = [each for each in found if each['after'] is not None]
        wrong = sum(each['wrong'] for each in found)
        half = [hovering(vehicle, i, changes, left=0.5) for i in range(n)]
        errors = [error for *_, error in half]
        rows.append((
            f'`{vehicle}`', range_of([each['asked'] for each in named]),
            f'{len(named)}/{len(found)}' + (f'; {wrong} wrong' if wrong else ''),
            *('/'.join(str(sum(each[how] for each in flown[way]))
                       for how in ('announced', 'detected')) for way in MANOEUVRES),
            f'{np.median(errors):.2f}, {max(errors):.2f}',
        ))
        print(*rows[-1], sep=' | ', flush=True)
    titles = 'vehicle', 'after [ms]', 'named', *MANOEUVRES, 'half'
    return table(titles, rows)


class Slow(Detection):
    """A detection that gets one in some states."""

    def __init__(self, detection, each):
        self.detector, self._rebuild, self.found = detection.detector, detection._rebuild, []
        self._each, self._count = each, 0

    def observe(self, time, state):
        self._count += 1
        return super().observe(time, state) if self._count % self._each == 0 else None


def usual(*parameters, further=None, **air):
    """Return a condition: arguments of `realistic`, parameters, arguments of `hovering`."""
    return air, parameters, further or {}


def either(name, *values):
    """Return the conditions of a parameter of the simulator with each value."""
    return [usual(f'simulator.{name}:={value}') for value in values]


CONDITIONS = {
    'usual': [usual()],
    'no noise': [usual(noise=0.0)],
    'noise twice': [usual(noise=2.0)],
    'no gusts, no wind': [usual(gusts=0.0, wind=0.0)],
    'gusts 1 m/s': [usual(gusts=1.0)],
    'gusts 2 m/s, wind 3 m/s': [usual(gusts=2.0, wind=3.0)],
    'noise twice, gusts 1 m/s, wind 2 m/s': [usual(noise=2.0, gusts=1.0, wind=2.0)],
    'lag 0 or 100 ms': [usual(lag=0.0), usual(lag=0.1)],
    'lag 30 or 70 ms, set 50': either('motor_time_constant', 0.03, 0.07),
    'delay 30 ms': [usual(delay=0.03)],
    'delay 0 or 20 ms, set 10': either('command_delay', 0.0, 0.02),
    'states at 500 Hz': either('time_step', 0.002),
    'states at 50 Hz': [usual(further={'each': 2})],
    'states at 20 Hz': [usual(further={'each': 5})],
    'mass, k_f or inertia ± 10 %': [
        *either('mass_factor', 1.1, 0.9), *either('thrust_factor', 1.1, 0.9),
        *(usual(further={'inertia': share}) for share in (1.1, 0.9))],
    'load of 15 %, 5 or 10 cm off centre': [
        usual(further={'load': arm}) for arm in (0.05, 0.1)],
    'load of 15 %, 15 cm': [usual(further={'load': 0.15})],
}
"""Conditions by name, each with its variants."""


def hovering(vehicle, rotor, changes, each=1, inertia=1.0, load=0.0, left=0.0, at=4.0):
    """Lose a rotor at hover, but for the thrust that is `left`.

    Returns whether there was an alarm before, the time to detection, whether there was a wrong
    name, and the error of the health half a second after the loss.
    """
    case = Case.load(vehicle, changes)
    health = np.ones(case.vehicle.n)
    health[rotor] = left

    def body(health, offset=None):
        made = case.body(health)
        changed = replace(made.vehicle, inertia=inertia * made.vehicle.inertia)
        return heavier(RigidBody(changed, made.drag), offset)

    offset = load * np.array([np.cos(rotor), np.sin(rotor), 0.0]) if load else None
    events = [Change(0, body=body(1.0)), Change(round(at * 1e9), body=body(health, offset))]
    if load:
        events.append(Change(2_000_000_000, body=body(1.0, offset)))
    detection = case.detection('exact')
    detection = Slow(detection, each) if each > 1 else detection
    with suppress(FloatingPointError):
        fly(case.controller(), case.allocator('exact'), case.plant(), Waypoint.of(0, 0, 1, 0),
            at + 1.0, changes=events, detection=detection)
    found = [(time / 1e9, lost) for time, lost in detection.found]
    early = any(time < at for time, _ in found)
    after = next((t - at for t, lost in found if t >= at and lost[rotor] < 1.0), None)
    wrong = any((np.delete(lost, rotor) < 1.0).any() for t, lost in found if t >= at)
    known = [lost[rotor] for t, lost in found if t <= at + 0.5]
    return early, after, wrong and not early, abs((known or [1.0])[-1] - left)


def limits_table(options):
    """Return the table of detection at hover, for each condition; `out/` has each vehicle."""
    rows, cells = [], []
    for name, variants in CONDITIONS.items():
        found = {vehicle: [
            hovering(vehicle, i, [*realistic(**air), *parameters], **further)
            for air, parameters, further in variants for i in range(options.rotors)
        ] for vehicle in options.vehicles}
        cells.append((name, *map(outcomes, found.values())))
        rows.append((name, outcomes([each for every in found.values() for each in every])))
        print(*cells[-1], sep=' | ', flush=True)
    folder = DOCS.parent / 'out'
    folder.mkdir(exist_ok=True)
    titles = ('condition', *(f'`{each}`' for each in options.vehicles))
    (folder / 'detection_limits.md').write_text(f'{table(titles, cells)}\n', encoding='utf-8')
    return table(('condition', 'after [ms]'), rows)


def outcomes(found):
    """Return in words what `hovering` found in some flights."""
    early, after, wrong, _ = zip(*found, strict=True)
    counts = (sum(early), 'false'), (sum(wrong), 'wrong'), (after.count(None), 'missed')
    times = range_of([time for time in after if time is not None])
    return '; '.join([times, *(f'{count} {what}' for count, what in counts if count)])


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
    return heavier(case.body(), np.append(rng.uniform(-0.05, 0.05, 2), 0.0))


def heavier(body, offset):
    """Return a body with a load of 15 % of its mass at an offset [m]; None: without it."""
    if offset is None:
        return body
    vehicle = body.vehicle
    heavy = replace(vehicle, mass=1.15 * vehicle.mass, arms=vehicle.arms - 0.15 / 1.15 * offset)
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
    faulty = seed // len(options.vehicles) % 2
    detection = Faulty(detection, rng) if faulty else detection
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
        print(vehicle, seed, found[:2] or 'no alarm', flush=True)
    spent = process_time() - begin
    print(f'{flown / 60:.2f} h, {alarms} flights with a false alarm, {spent:.0f} s')


def animation(path):
    """Animate one unannounced failure, with and without the detector."""
    case, duration, goal = Case.load('hexarotor_realistic'), 6.5, Waypoint.of(0, 0, 1.2, 0)
    failures = RotorFailures((RotorFailure(1, 3.0),), None)
    changes = case.failing('exact', failures)
    flights, samples, detected = {}, {}, {}
    for name in ('with_detection', 'without_detection'):
        detection = case.detection('exact') if name == 'with_detection' else None
        flight = fly(case.controller(), case.allocator('exact'), case.plant(), goal, duration,
                     changes=changes, detection=detection)
        found = case.detected('exact', detection.found) if detection else []
        flights[name], detected[name] = flight, [each.time / 1e9 for each in found]
        samples[name] = sample_errors(
            flight, case.controller(), goal, [*changes, *found], case.body().vehicle)
    trajectory = Trajectory.to(goal)
    animate(path, Flights(flights, samples, case.vehicle, trajectory, failures, detected))


def main():
    """Fill the tables of the page, or fly for hours without a failure."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add('--hours', type=float, default=0.0, help='fly so long without a failure [h]')
    add('--animation', type=Path, metavar='FILE', help='write an animation of a failure instead')
    add('--first', type=int, default=0, help='seed of the first flight')
    add('--vehicles', nargs='+', default=shipped(flying=True))
    add('--rotors', type=int, default=3, help='of each vehicle, in the table of conditions')
    for name, default in (('noise', 1.0), ('lag', 0.05), ('delay', 0.01), ('gusts', 0.5),
                          ('wind', 1.0)):
        add(f'--{name}', type=float, default=default)
    options = parser.parse_args()
    if options.animation:
        animation(options.animation)
    elif options.hours:
        hours(options)
    else:
        fill('detection.md', flights=flights_table(options), limits=limits_table(options))


if __name__ == '__main__':
    main()
