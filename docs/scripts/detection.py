"""Fly unannounced failures and fill the tables of docs/detection.md; or fly hours without one."""

import argparse
from dataclasses import replace
from functools import partial
from time import process_time

import numpy as np
from pages import distance, fill, flown, keep, shipped, trajectory

from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.closed_loop import Change, Detection, waypoint_changes
from ca_ros.simulation.plant import Plant
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from ca_ros.studies.tables import table
from ca_ros.vehicle.files import read

LONGER = {'y6': 24.0, 'quadrotor': 1.0}
"""How long a flight goes on after a loss, if not 8 s: one comes back late, one falls [s]."""

REALISTIC = {
    name: value for name, value in read('hexarotor_realistic').items()
    if name.startswith(('simulator.', 'detector.', 'controller.integral_gain'))
}
USUAL = [f'{name}:={value}' for name, value in REALISTIC.items()]
LOST = 4.0  # when a rotor is lost in `hovering` [s]


# Parameters, waypoints, and when the rotor fails [s].
MANOEUVRES = {
    'hover': ([], trajectory((0, 0, 0, 1, 0)), 4.0),
    'forward': ([], trajectory((0, 0, 0, 2, 0), (2.0, 15, 0, 2, 0)), 4.5),
    'climb': (['controller.speed_max:=20.0'], trajectory((0, 0, 0, 30, 0)), 1.0),
    'slalom': ([], trajectory((0, 0, 0, 2, 0), *(
        (1.5 * k, 3.0 * k, 3.0 * (-1) ** k, 2.0 + 0.5 * (-1) ** k, 1.0 * (-1) ** k)
        for k in range(1, 5))), 3.7),
}


def row(vehicle, manoeuvre, rotor):
    """Return what happened to one failure, announced after 0.1 s and detected."""
    own, goals, at = MANOEUVRES[manoeuvre]
    case = Case.load(vehicle, [*USUAL, *own])
    end = at + LONGER.get(vehicle, 16.0 if manoeuvre == 'forward' else 8.0)
    outcome = {'after': None, 'asked': None, 'wrong': False}
    for how, announce in (('announced', 0.1), ('detected', None)):
        failures = RotorFailures((RotorFailure(rotor + 1, at),), announce)
        detection = None if announce else case.detection('exact')
        changes = [*waypoint_changes(goals), *case.announced('exact', failures)]
        flight = flown(
            case, goals.first, end, changes=changes, detection=detection, failures=failures)
        # The last second: a hundred samples.  It holds the place where it was bound for.
        outcome[how] = flight is not None and distance(flight, goals.last, end - 0.995) < 0.5
    if flight is not None and detection.found:
        found = detection.found[0][0] / 1e9
        hover = case.vehicle.weight / case.vehicle.n / case.vehicle.thrust_per_squared_speed
        busy = flight.speeds[:, rotor] ** 2 >= 0.5 * hover[rotor]
        since = (flight.time >= at - 1e-9) & (flight.time < found - 1e-9)
        wrong = bool((np.delete(detection.detector.health, rotor) < 1.0).any())
        outcome |= {
            'after': found - at, 'asked': 0.01 * int((busy & since).sum()), 'wrong': wrong,
        }
    return outcome


def range_of(times):
    """Return the median and the greatest of times [s], in ms."""
    if not times:
        return 'none'
    return f'{1e3 * np.median(times):.0f}, {1e3 * max(times):.0f}'


def flights_table(options):
    """Return the table of failures in manoeuvres, and of rotors that lose half of their thrust."""
    rows = []
    for vehicle in options.vehicles:
        n = Case.load(vehicle).vehicle.n
        flights = {way: [row(vehicle, way, i) for i in range(n)] for way in MANOEUVRES}
        found = [each for rows in flights.values() for each in rows]
        named = [each for each in found if each['after'] is not None]
        wrong = sum(each['wrong'] for each in found)
        errors = [hovering(vehicle, i, left=0.5)[-1] for i in range(n)]
        rows.append((
            f'`{vehicle}`', range_of([each['asked'] for each in named]),
            f'{len(named)}/{len(found)}' + (f'; {wrong} wrong' if wrong else ''),
            *('/'.join(str(sum(each[how] for each in flights[way]))
                       for how in ('announced', 'detected')) for way in MANOEUVRES),
            f'{np.median(errors):.2f}, {max(errors):.2f}',
        ))
        print(*rows[-1], sep=' | ', flush=True)
    return table(('vehicle', 'after [ms]', 'named', *MANOEUVRES, 'half'), rows)


class Slow(Detection):
    """A detection that gets one in some states."""

    each, count = 1, 0

    def observe(self, time, state):
        self.count += 1
        return super().observe(time, state) if self.count % self.each == 0 else None


def noise(share):
    """Return the parameters of a share of the usual noise."""
    names = [name for name in REALISTIC if name.endswith('_noise')]
    return [f'{name}:={share * REALISTIC[name]}' for name in names]


def air(gusts, wind=1.0):
    """Return the parameters of gusts and wind [m/s]."""
    return [f'simulator.gust_intensity:=[{gusts}, {gusts}, {gusts}]',
            f'simulator.wind:=[{wind}, 0.0, 0.0]']


def either(name, *values, known=None):
    """Return the conditions of a parameter with each value, `known` to a setting or not."""
    names = [f'simulator.{name}', *([f'detector.{known}'] if known else [])]
    return [{'changes': [f'{each}:={value}' for each in names]} for value in values]


CONDITIONS = {
    'usual': [{}],
    'no noise': [{'changes': noise(0.0)}],
    'noise twice': [{'changes': noise(2.0)}],
    'no gusts, no wind': [{'changes': air(0.0, 0.0)}],
    'gusts 1 m/s': [{'changes': air(1.0)}],
    'gusts 2 m/s, wind 3 m/s': [{'changes': air(2.0, 3.0)}],
    'noise twice, gusts 1 m/s, wind 2 m/s': [{'changes': [*noise(2.0), *air(1.0, 2.0)]}],
    'lag 0 or 100 ms': either('motor_time_constant', 0.0, 0.1, known='motor_time_constant'),
    'lag 30 or 70 ms, set 50': either('motor_time_constant', 0.03, 0.07),
    'delay 30 ms': either('command_delay', 0.03, known='delay'),
    'delay 0 or 20 ms, set 10': either('command_delay', 0.0, 0.02),
    'states at 500 Hz': either('time_step', 0.002),
    'states at 50 Hz': [{'each': 2}],
    'states at 20 Hz': [{'each': 5}],
    'mass, k_f or inertia ± 10 %': [
        *either('mass_factor', 1.1, 0.9), *either('thrust_factor', 1.1, 0.9),
        {'inertia': 1.1}, {'inertia': 0.9}],
    'load of 15 %, 5 or 10 cm off centre': [{'load': 0.05}, {'load': 0.1}],
    'load of 15 %, 15 cm': [{'load': 0.15}],
}
"""Conditions by name, each with its variants: arguments of `hovering`."""


def hovering(vehicle, rotor, changes=(), each=1, inertia=1.0, load=0.0, left=0.0):
    """Lose a rotor at hover, but for the thrust that is `left`.

    Returns whether there was an alarm before, the time to detection, whether there was a wrong
    name, and the error of the health half a second after the loss.
    """
    case = Case.load(vehicle, [*USUAL, *changes])
    health = np.ones(case.vehicle.n)
    health[rotor] = left

    def body(health, offset=None):
        made = case.body(health)
        changed = replace(made.vehicle, inertia=inertia * made.vehicle.inertia)
        return heavier(RigidBody(changed, made.drag), offset)

    offset = load * np.array([np.cos(rotor), np.sin(rotor), 0.0]) if load else None
    events = [Change(0, body=body(1.0)), Change(round(LOST * 1e9), body=body(health, offset))]
    if load:
        events.append(Change(2_000_000_000, body=body(1.0, offset)))
    detection = Slow(case.detector(), partial(case.reconfiguration, 'exact'))
    detection.each = each
    flown(case, Waypoint.of(0, 0, 1, 0), LOST + 1.0, changes=events, detection=detection)
    found = [(time / 1e9, lost) for time, lost, _ in detection.found]
    early = any(time < LOST for time, _ in found)
    after = next((t - LOST for t, lost in found if t >= LOST and lost[rotor] < 1.0), None)
    wrong = any((np.delete(lost, rotor) < 1.0).any() for t, lost in found if t >= LOST)
    known = [lost[rotor] for t, lost in found if t <= LOST + 0.5]
    return early, after, wrong and not early, abs((known or [1.0])[-1] - left)


def limits_table(options):
    """Return the table of detection at hover, for each condition; `out/` has each vehicle."""
    rows, cells = [], []
    for name, variants in CONDITIONS.items():
        found = [
            [hovering(vehicle, i, **each) for each in variants for i in range(options.rotors)]
            for vehicle in options.vehicles
        ]
        cells.append((name, *map(outcomes, found)))
        rows.append((name, outcomes([each for own in found for each in own])))
        print(*cells[-1], sep=' | ', flush=True)
    keep('detection_limits', ('condition', *(f'`{each}`' for each in options.vehicles)), cells)
    return table(('condition', 'after [ms]'), rows)


def outcomes(found):
    """Return in words what `hovering` found in some flights."""
    early, after, wrong, _ = zip(*found, strict=True)
    counts = (sum(early), 'false'), (sum(wrong), 'wrong'), (after.count(None), 'missed')
    times = range_of([time for time in after if time is not None])
    return '; '.join([times, *(f'{count} {what}' for count, what in counts if count)])


class Faulty(Detection):
    """A detection whose states are late, repeated or dropped."""

    def __init__(self, rng, *parts):
        super().__init__(*parts)
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


def heavier(body, offset):
    """Return a body with a load of 15 % of its mass at an offset [m]; None: without it."""
    if offset is None:
        return body
    vehicle = body.vehicle
    heavy = replace(vehicle, mass=1.15 * vehicle.mass, arms=vehicle.arms - 0.15 / 1.15 * offset)
    return RigidBody(heavy, body.drag)


def eventless(vehicle, seed, options, duration=60.0):
    """Fly a minute without a failure; return the false alarms [s], None if the flight diverges."""
    rng = np.random.default_rng(seed)
    factors = rng.choice([0.9, 1.0, 1.1], 2)
    case = Case.load(vehicle, [
        *USUAL, *air(options.gusts), f'simulator.seed:={seed}', 'simulator.ground:=flat',
        f'simulator.mass_factor:={factors[0]}', f'simulator.thrust_factor:={factors[1]}',
    ])
    points, t = [(0, 0, 0, 2, 0)], 4.0
    while t < duration - 10.0:
        points.append((t, *rng.uniform(-10, 10, 2), rng.uniform(3, 8), rng.uniform(-3, 3)))
        t += rng.uniform(1.0, 6.0)
    points += [(duration - 8.0, *rng.uniform(-5, 5, 2), 1.0, 0.0), (duration - 4.0, 0, 0, -0.5, 0)]
    goals, taken_up = trajectory(*points), round(rng.uniform(5.0, 45.0) * 1e9)
    loaded = heavier(case.body(), np.append(rng.uniform(-0.05, 0.05, 2), 0.0))
    parts = case.detector(), partial(case.reconfiguration, 'exact')
    faulty = seed // len(options.vehicles) % 2
    detection = Faulty(rng, *parts) if faulty else Detection(*parts)
    flight = flown(
        case, goals.first, duration, plant=Weather(case.body(), case.flown.simulator),
        changes=[*waypoint_changes(goals), Change(taken_up, body=loaded)], detection=detection)
    found = [(time / 1e9, health.round(2).tolist()) for time, health, _ in detection.found]
    return None if flight is None else found


def hours(options):
    """Fly without a failure, and print the false alarms."""
    flights = alarms = 0
    begin = process_time()
    for seed in range(options.first, options.first + round(60 * options.hours)):
        vehicle = options.vehicles[seed % len(options.vehicles)]
        found = eventless(vehicle, seed, options)
        words = 'diverges' if found is None else found[:2] or 'no alarm'
        print(vehicle, seed, words, flush=True)
        flights += found is not None
        alarms += bool(found)
    spent = process_time() - begin
    print(f'{flights / 60:.2f} h, {alarms} flights with a false alarm, {spent:.0f} s')


def main():
    """Fill the tables of the page, or fly for hours without a failure."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add('--hours', type=float, default=0.0, help='fly so long without a failure [h]')
    add('--gusts', type=float, default=0.5, help='in these hours [m/s]')
    add('--first', type=int, default=0, help='seed of the first flight of these hours')
    add('--vehicles', nargs='+', default=shipped(flying=True))
    add('--rotors', type=int, default=3, help='of each vehicle, in the table of conditions')
    options = parser.parse_args()
    if options.hours:
        hours(options)
    else:
        fill('detection.md', flights=flights_table(options), limits=limits_table(options))


if __name__ == '__main__':
    main()
