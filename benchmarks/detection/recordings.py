"""Recorded flights of one vehicle through the detector.

``python -m benchmarks.detection.recordings FLIGHT... VEHICLE.yaml``; files and options are those
of ``ca_ros replay``.  `benchmarks.detection.real_flights` does it for what others published.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.detection.tables import share
from ca_ros.arrays import BoolArray
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.injected_loss import WAIT, without_rotor
from ca_ros.detection.kernel_detector import make_detector
from ca_ros.detection.lag_check import LagCheck
from ca_ros.detection.recorded_motion import Motion, motion_of
from ca_ros.detection.replay import Naming, Replay, replay
from ca_ros.errors import message
from ca_ros.studies.replay import settings_of
from ca_ros.vehicle.formats.recording import Recording, read_recording
from ca_ros.vehicle.identification import speeds_of
from ca_ros.vehicle.match import match
from ca_ros.vehicle.vehicle import Vehicle

PHASES = 'launch', 'flight', 'landing'
BUSY = 0.5  # least mean thrust of a rotor that is taken, over its share of the weight
ASKED = 0.2  # time over which this mean is taken [s]


@dataclass(frozen=True)
class Taken:
    """A rotor that was taken from a recorded flight.

    - `rotor` and `time` [s]
    - `named`: what the detector named first after it, if anything
    - `after`: how much later [s]; infinite if the rotor is not in it
    """

    rotor: int
    time: float
    named: Naming | None
    after: float


@dataclass(frozen=True, eq=False)
class Replayed:
    """A recorded flight through the detector.

    - `begin`: when it begins, by the stamps of the recording [s]
    - `found`: what it named
    - `fault`: what the check of the motors' lag says
    - `other`: why the file is that of another vehicle
    - `taken`: rotors that were taken from it
    """

    name: str
    begin: float
    found: Replay
    fault: str
    other: str
    taken: list[Taken] = field(default_factory=list)

    def __str__(self) -> str:
        """Return the flight in a line, and one more for each rotor that is not named right."""
        names = ', '.join(
            f'{each.phase} {each.time:.2f} s {each.words}' for each in self.found.named)
        lines = [f'{self.name}: {self.found.in_air:.1f} s in the air; {names or "nothing named"}; '
                 f'{"; ".join(filter(None, [self.fault, self.other]))}'.rstrip('; ')]
        lines += [
            f'    rotor {each.rotor + 1} at {each.time:.2f} s: '
            f'{each.named.words if each.named else "not named"}'
            for each in self.taken if not np.isfinite(each.after)]
        return '\n'.join(lines)


def random_losses(
    vehicle: Vehicle, recording: Recording, found: Replay, seed: int
) -> Iterator[tuple[int, float]]:
    """Yield a rotor and a time [s] in the middle third, twice for each rotor.

    The vehicle is then in the air, and asks the rotor for half of its share of the weight.
    """
    rng = np.random.default_rng(seed)
    times = recording.times['command'] - recording.span[0]
    thrusts = vehicle.thrusts(recording.values['command'])
    end = found.times[-1]
    for rotor in np.repeat(np.arange(vehicle.n), 2).tolist():
        for at in rng.uniform(end / 3.0, 2.0 * end / 3.0, 20).tolist():
            asked = thrusts[(times > at - ASKED) & (times <= at), rotor]
            flies = found.flying[(found.times > at - ASKED) & (found.times <= at)]
            if flies.all() and asked.mean() > BUSY * vehicle.weight / vehicle.n:
                yield rotor, at
                break


def lag_fault(
    vehicle: Vehicle, recording: Recording, settings: DetectorSettings, motion: Motion,
    flying: BoolArray,
) -> str:
    """Return what the check of the motors' lag says at the end of a flight."""
    check, sent, begin = LagCheck(vehicle, settings), 0, motion.times[0]
    times, commands = recording.times['command'], recording.values['command']
    for now, gyro, flies in zip(motion.times, motion.gyro, flying, strict=True):
        if flies:
            check.observe(round(1e9 * (now - begin)), gyro, vehicle.health)
        while sent < len(times) and times[sent] <= now:
            check.command(round(1e9 * (times[sent] - begin)), commands[sent])
            sent += 1
    return check.fault


def no_losses(
    vehicle: Vehicle, recording: Recording, found: Replay
) -> Iterable[tuple[int, float]]:
    """Return no rotor."""
    return ()


def through_detector(
    file: Path, vehicle_file: Path, throttle: str | None = None, frame: str = 'flu',
    losses: Callable[[Vehicle, Recording, Replay], Iterable[tuple[int, float]]] = no_losses,
) -> Replayed:
    """Replay a flight; `losses` says which rotors are also taken from it, and when."""
    vehicle = Vehicle.load(vehicle_file)
    settings = settings_of(vehicle_file)
    recording = speeds_of(vehicle, read_recording(file, vehicle.n, frame), throttle)
    motion = motion_of(vehicle, recording)
    found = replay(vehicle, recording, settings, motion, make_detector)
    fault = lag_fault(vehicle, recording, settings, motion, found.flying)
    like = match(
        vehicle, recording, settings.motor_time_constant, settings.delay, found.carried)
    replayed = Replayed(file.stem, float(motion.times[0]), found, fault, like.fault)
    for rotor, at in losses(vehicle, recording, found):
        lost = without_rotor(vehicle, recording, settings, motion, rotor, at)
        named = replay(vehicle, recording, settings, lost, make_detector).named
        after = [each for each in named if each.time >= at]
        right = bool(after) and rotor in after[0].rotors
        replayed.taken.append(Taken(
            rotor, at, after[0] if after else None, after[0].time - at if right else np.inf))
    return replayed


def named_right(taken: Sequence[Taken]) -> tuple[str, str, str]:
    """Return how many are named right [%], how many wrong, and the median and 90 % [ms]."""
    if not taken:
        return '', '', ''
    after = np.array([each.after for each in taken])
    right = int(np.isfinite(after).sum())
    times = [f'{1e3 * np.quantile(after, q, method="higher"):.0f}' for q in (0.5, 0.9)]
    return (share(right, len(taken)), str(sum(bool(each.named) for each in taken) - right),
            ', '.join(times).replace('inf', 'never'))


def alarms(flights: Sequence[Replayed]) -> Counter[str]:
    """Return the alarms of flights in each phase."""
    return Counter(each.phase for flight in flights for each in flight.found.named)


def main(argv: Sequence[str] | None = None) -> int:
    """Replay and print; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.detection.recordings', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add('flights', type=Path, nargs='+', metavar='FLIGHT')
    add('vehicle', type=Path)
    add('--throttle', choices=['linear', 'quadratic', 'curve'])
    add('--frame', choices=['flu', 'frd'], default='flu')
    add('--losses', action='store_true', help='take each rotor twice from the middle third')
    options = parser.parse_args(argv)
    try:
        run(options)
    except (OSError, ValueError) as error:
        print(f'recordings: {message(error)}', file=sys.stderr)
        return 1
    return 0


def run(options: argparse.Namespace) -> None:
    """Replay and print."""
    flights = []
    for i, file in enumerate(options.flights):
        flights.append(through_detector(
            file, options.vehicle, options.throttle, options.frame,
            partial(random_losses, seed=i) if options.losses else no_losses))
        print(flights[-1], flush=True)
    phases, flown = alarms(flights), sum(each.found.in_air for each in flights)
    print(f'{len(flights)} flights, {flown:.0f} s in the air; alarms: '
          f'{", ".join(f"{phase} {phases[phase]}" for phase in PHASES)}; '
          f'warnings of the lag: {sum(bool(each.fault) for each in flights)}, of another vehicle: '
          f'{sum(bool(each.other) for each in flights)}')
    if taken := [each for flight in flights for each in flight.taken]:
        after = np.array([each.after for each in taken])
        wrong = sum(bool(each.named) and not np.isfinite(each.after) for each in taken)
        print(f'losses named right {share(int(np.isfinite(after).sum()), len(taken))} %, '
              f'median {1e3 * np.median(after):.0f} ms, wrong {wrong}, within {WAIT:g} s')


if __name__ == '__main__':
    raise SystemExit(main())
