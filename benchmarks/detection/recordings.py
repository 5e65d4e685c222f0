"""Recorded flights of one vehicle through the detector: one row of the table of docs/detection.md.

``python -m benchmarks.detection.recordings FLIGHT... VEHICLE.yaml``; files and options are those
of ``ca_ros replay``.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.detection.tables import share
from ca_ros.arrays import Array
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.kernel_detector import make_detector
from ca_ros.detection.lag_check import LagCheck
from ca_ros.detection.replay import WAIT, Motion, Replay, motion_of, replay, without_rotor
from ca_ros.settings import read
from ca_ros.vehicle.files import read as read_file
from ca_ros.vehicle.formats.recording import Recording, read_recording
from ca_ros.vehicle.identification import speeds_of
from ca_ros.vehicle.vehicle import Vehicle

PHASES = 'launch', 'flight', 'landing'
BUSY = 0.5  # least mean thrust of a rotor that is taken, over its share of the weight
ASKED = 0.2  # time over which this mean is taken [s]


def losses(
    vehicle: Vehicle, recording: Recording, found: Replay, rng: np.random.Generator
) -> Iterator[tuple[int, float]]:
    """Yield a rotor and a time [s] in the middle third, twice for each rotor.

    The vehicle is then in the air, and asks the rotor for half of its share of the weight.
    """
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
    flying: Array,
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


def main(argv: Sequence[str] | None = None) -> int:
    """Replay and print; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.detection.recordings', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add('flights', type=Path, nargs='+', metavar='FLIGHT')
    add('vehicle')
    add('--throttle', choices=['linear', 'quadratic', 'curve'])
    add('--frame', choices=['flu', 'frd'], default='flu')
    add('--losses', action='store_true', help='take each rotor twice from the middle third')
    options = parser.parse_args(argv)
    vehicle = Vehicle.load(options.vehicle)
    given = read_file(options.vehicle)
    ours = {name: value for name, value in given.items() if name.startswith('detector.')}
    settings, phases = read(DetectorSettings, ours, 'detector.'), Counter[str]()
    named, flown, faults = list[tuple[tuple[int, ...], float]](), 0.0, 0
    for i, file in enumerate(options.flights):
        recording = speeds_of(
            vehicle, read_recording(file, vehicle.n, options.frame), options.throttle)
        motion = motion_of(vehicle, recording)
        found = replay(vehicle, recording, settings, motion, make_detector)
        flown += found.in_air
        phases.update(each.phase for each in found.named)
        fault = lag_fault(vehicle, recording, settings, motion, found.flying)
        faults += bool(fault)
        names = ', '.join(
            f'{each.phase} {each.time:.2f} s {each.words}'
            for each in found.named)
        print(f'{file.stem}: {found.in_air:.1f} s in the air; {names or "nothing named"}; {fault}')
        if not options.losses:
            continue
        for rotor, at in losses(vehicle, recording, found, np.random.default_rng(i)):
            lost = without_rotor(vehicle, recording, settings, motion, rotor, at)
            after = [
                each for each in replay(
                    vehicle, recording, settings, lost, make_detector).named if each.time >= at]
            right = bool(after) and rotor in after[0].rotors
            named.append(
                (after[0].rotors if after else (), after[0].time - at if right else np.inf))
            if not right:
                print(f'    rotor {rotor + 1} at {at:.2f} s: '
                      f'{after[0].words if after else "not named"}')
    alarms = ', '.join(f'{phase} {phases[phase]}' for phase in PHASES)
    print(f'{len(options.flights)} flights, {flown:.0f} s in the air; alarms: {alarms}; '
          f'warnings of the lag: {faults}')
    if named:
        after_all = np.array([after for _, after in named])
        wrong = sum(bool(rotors) and not np.isfinite(after) for rotors, after in named)
        print(f'losses named right {share(int(np.isfinite(after_all).sum()), len(named))} %, '
              f'median {1e3 * np.median(after_all):.0f} ms, wrong {wrong}, '
              f'within {WAIT:g} s')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
