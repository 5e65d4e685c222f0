"""``ca_ros replay``: what the detector would have named in a recorded flight."""

import argparse
import sys
from functools import partial
from pathlib import Path

import numpy as np

from ca_ros.arguments import add_recording, command
from ca_ros.detection.detector_settings import DetectorSettings, no_lag
from ca_ros.detection.injected_loss import WAIT, without_rotor
from ca_ros.detection.recorded_motion import held, motion_of
from ca_ros.detection.replay import Replay, replay
from ca_ros.errors import message
from ca_ros.figures import FORMATS
from ca_ros.parameter_files import MonitorSettings, load_for
from ca_ros.settings import ParameterError
from ca_ros.vehicle.files import read as read_file
from ca_ros.vehicle.formats.recording import read_recording
from ca_ros.vehicle.plausibility import IN_AIR
from ca_ros.vehicle.vehicle import Vehicle


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add = parser.add_argument
    add('flight', type=Path, metavar='FLIGHT', help='CSV, npz, ULog, bag: see docs/identify.md')
    add('vehicle', help='a shipped vehicle or a parameter file, with the settings detector.*')
    add_recording(parser)
    add('--inject', action='append', default=[], metavar='ROTOR@T', help='take a rotor from the '
        'recorded motion at a time [s] since its beginning; may be given several times')
    add('--figure', type=Path, metavar='FILE', help='draw a minute about the first name, or rotor '
        'that is taken: png, svg or pdf')


def run(options: argparse.Namespace) -> None:
    """Replay and print."""
    # SciPy's signal processing takes a second to import.
    from ca_ros.vehicle.identification import speeds_of
    from ca_ros.vehicle.match import match

    if options.figure is not None:
        _check_figure(options.figure)
    vehicle = Vehicle.load(options.vehicle)
    settings = settings_of(options.vehicle)
    losses = [_loss(text, vehicle.n) for text in options.inject]
    recording = speeds_of(
        vehicle, read_recording(options.flight, vehicle.n, options.frame), options.throttle)
    motion = motion_of(vehicle, recording)
    end = motion.times[-1] - motion.times[0]
    for rotor, time in losses:
        if time >= end:
            raise ParameterError(
                f'--inject {rotor + 1}@{time:g}: expected a time before the end, {end:.2f} s')
    found = replay(vehicle, recording, settings, motion)
    for rotor, time in losses:
        i = int(np.searchsorted(found.times, time))
        if not found.tested[i:i + 1].all():
            later = found.times[i:][found.tested[i:]]
            begin = f', but from {later[0]:.2f} s on' if len(later) else ', nor later'
            raise ParameterError(
                f'--inject {rotor + 1}@{time:g}: nothing is tested then{begin}')
        command = held(recording, 'command', motion.times[:1] + time)
        share = vehicle.thrusts(command).sum() / vehicle.weight
        if share < IN_AIR:
            raise ParameterError(
                f'--inject {rotor + 1}@{time:g}: the commands carry {100.0 * share:.0f} % of the '
                'weight then: expected a time in flight')
    like = match(
        vehicle, recording, settings.motor_time_constant, settings.delay, found.carried)
    if like.fault:
        found.notes.append(
            f'{like.fault}: is it the file of this vehicle, with order and spins of its rotors?')
    print('\n'.join(report(recording.name, found)))
    if like.fault and losses:
        raise ParameterError(
            f'--inject: {like.fault}: expected the file of the vehicle that flew')
    taken = []
    for rotor, time in losses:
        lost = replay(
            vehicle, recording, settings,
            without_rotor(vehicle, recording, settings, motion, rotor, time))
        taken.append((rotor, time, lost))
        answer = _answer(rotor, time, lost)
        print(answer if like.shown else f'{answer}; the motion does not show that the file fits')
    if options.figure is not None:
        from ca_ros.studies.replay_figure import draw

        draw(found, taken, options.figure)
        print(f'written: {options.figure}')


def _check_figure(file: Path) -> None:
    """Raise a ParameterError if no figure can be written to a file."""
    if file.suffix[1:] not in FORMATS:
        raise ParameterError(f'--figure {file}: expected a name that ends with '
                             f'{", ".join(f".{form}" for form in FORMATS)}')
    try:
        new = not file.exists()
        file.open('ab').close()
    except OSError as error:
        raise ParameterError(f'--figure {message(error, file)}') from None
    if new:
        # Not a link that leads to it.
        file.resolve().unlink()


def settings_of(vehicle: str | Path) -> DetectorSettings:
    """Return the settings of the detector in the file of a vehicle, checked as the monitor does.

    Warns if there is no lag of the motors.
    """
    settings = load_for(MonitorSettings, vehicle).detector
    if text := no_lag(read_file(vehicle)):
        print(f'ca_ros replay: warning: {text}', file=sys.stderr)
    return settings


def _loss(text: str, rotors: int) -> tuple[int, float]:
    """Return the rotor, from 0, and the time of ROTOR@T."""
    rotor, _, time = text.partition('@')
    try:
        number, at = int(rotor), float(time)
    except ValueError:
        number, at = 0, 0.0
    if not (1 <= number <= rotors and 0.0 <= at < np.inf):
        raise ParameterError(
            f'--inject {text}: expected ROTOR@T, such as 1@20.5, with a rotor from 1 to {rotors}')
    return number - 1, at


def report(name: str, found: Replay) -> list[str]:
    """Return what was named, one a line, and how long losses were tested."""
    lines = [f'{name}: {found.times[-1]:.1f} s, {found.in_air:.1f} s in the air']
    lines += [f'    {note}' for note in found.notes]
    if not found.tested.any():
        return [*lines, 'nothing was tested, so nothing can be named']
    tested = f'losses were tested for {found.testing:.1f} s'
    if not found.named:
        return [*lines, f'{tested}: nothing is named']
    lines.append('time [s]  phase    rotors    health      margin over a disturbance')
    for each in found.named:
        health = ', '.join(f'{share:.2f}' for share in each.health)
        lines.append(
            f'{each.time:8.2f}  {each.phase:7s}  {each.words:8s}  {health:10s}  {each.margin:.1f}'
            + '  not acted on' * each.withheld)
    return [*lines, tested]


def _answer(rotor: int, time: float, found: Replay) -> str:
    """Return in words what is named of an injected loss."""
    after = [each for each in found.named if each.time >= time]
    left = min(WAIT, max(0.0, found.times[-1] - time))
    words = [f'not named within {left:.3g} s']
    if after:
        words = [f'rotor {after[0].words} named after {1e3 * (after[0].time - time):.0f} ms']
    elif left < WAIT - 0.05:
        words.append('then nothing is recorded')
    return f'rotor {rotor + 1} taken at {time:g} s: {"; ".join(words)}'


main = partial(command, 'replay', add_options, run)
