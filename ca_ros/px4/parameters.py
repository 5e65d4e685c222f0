"""``ca_ros px4-parameters``: a parameter file from PX4's parameters, and back.

PX4's body frame is forward-right-down, ours is forward-left-up: y and z change their signs.
PX4 models the rotor n (from 0 on) as

    thrust = CT u^2 along (AX, AY, AZ),    reaction torque = KM * thrust

where u is its output, and KM is positive for a rotor that turns counter-clockwise, seen from above
(module.yaml of PX4's control_allocator).  PX4 normalises the allocation matrix.  Therefore only
the ratios of CT matter there, and only the ratios of |KM|.  Airframes often leave both at
PX4's defaults, 6.5 and 0.05.  Measure the coefficients that ca_ros needs (docs/vehicle.md).

A rotor of the airframe "Multirotor with Tilt" points upwards at the angle zero.  At the angle a it
points by sin a towards the direction TD [degrees], clockwise seen from above: 0 is the front, 90
the right (the same module.yaml, at commit 00f285e).
"""

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher
from functools import partial
from math import atan2, degrees, radians
from pathlib import Path
from typing import Any

import numpy as np

from ca_ros.arguments import (
    add_order,
    add_rotor_numbers,
    command,
    finite,
    rotor_rows,
)
from ca_ros.arrays import Array
from ca_ros.input_files import read_text
from ca_ros.problem.diagnosis import UNITS, diagnose, likely_unit, others_within
from ca_ros.vehicle.formats.px4_lines import px4_lines
from ca_ros.vehicle.parameter_text import parameter_text
from ca_ros.vehicle.vehicle import Vehicle

ROTORS = 12  # the most rotors of PX4; 8 before version 1.14

KINDS = ('PX', 'PY', 'PZ', 'AX', 'AY', 'AZ', 'CT', 'KM')
DEFAULTS = dict(zip(KINDS, (0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 6.5, 0.05), strict=True))
SERVO_DEFAULTS = {'MINA': 0.0, 'MAXA': 90.0, 'TD': 0.0}
"""PX4's defaults of CA_ROTOR* and CA_SV_TL*."""

AIRFRAME, SERVOS = 8, 4  # CA_AIRFRAME of a multirotor with tilt, and its greatest CA_SV_TL_COUNT

ROUNDING = 1e-6

FLIP = np.array([1.0, -1.0, -1.0])

NAMES = [
    'CA_ROTOR_COUNT', 'CA_SV_TL_COUNT',
    *(f'CA_ROTOR{i}_{kind}' for i in range(ROTORS) for kind in (*KINDS, 'TILT')),
    *(f'CA_SV_TL{i}_{kind}' for i in range(SERVOS) for kind in ('CT', 'MAXA', 'MINA', 'TD')),
]
"""PX4's parameters of rotors and of the servos that tilt them."""

ROTOR_NAMES = [name for name in NAMES if name.startswith('CA_ROTOR')]
ALIKE = 0.75  # least likeness of a name to that of a rotor's parameter that it may be meant for
STATED = 2  # most rotors of a slip whose parameters are named
FAULTY = {
    'spin': ('KM',), 'axis': ('AZ',), 'thrust': ('CT',), 'torque': ('KM',),
    'position': ('PX', 'PY'), 'order': ('PX', 'PY', 'KM'), 'spins': ('KM',),
}
"""The parameters of a rotor in which each kind of slip is; see `Cause`."""

WHOLE = re.compile(r'CA_(ROTOR_COUNT|R_REV|AIRFRAME|SV_TL_COUNT|ROTOR\d+_TILT|SV_TL\d_(TD|CT))')

STYLES = {
    'shell': 'param set {name} {value:.9g}', 'airframe': 'param set-default {name} {value:.9g}',
    'params': '1\t1\t{name}\t{value:.9g}\t{kind}',
}


def read(text: str) -> dict[str, float]:
    """Return the parameters CA_* in an airframe or in a file of QGroundControl.

    Raises a ValueError if they do not describe a multirotor, or have names that PX4 does not know.
    """
    given = {}
    lines = px4_lines(text)
    names = [name for name, _, _ in lines]
    for name, word, number in lines:
        if hint := _misspelt(name, names):
            raise ValueError(f'line {number}: PX4 has no parameter {name}{hint}')
        if not name.startswith('CA_'):
            continue
        try:
            given[name] = finite(word)
        except (ValueError, argparse.ArgumentTypeError):
            raise ValueError(f'line {number}: {name}: {word!r} is not a number') from None
    if 'CA_ROTOR_COUNT' not in given:
        raise ValueError(
            "no CA_ROTOR_COUNT: expected an airframe ('param set-default CA_ROTOR_COUNT 4') or a "
            "parameter file of QGroundControl ('1 1 CA_ROTOR_COUNT 4 6', with tabs)"
        )
    if given.get('CA_AIRFRAME', 0.0) not in (0.0, 7.0, AIRFRAME):
        raise ValueError(
            f'CA_AIRFRAME is {given["CA_AIRFRAME"]:g}: expected 0 (multirotor), 7 (motors, 6DOF) '
            f'or {AIRFRAME} (multirotor with tilt)'
        )
    count = int(given['CA_ROTOR_COUNT'])
    for i in range(count if 1 < count <= ROTORS else 0):
        if not any(f'CA_ROTOR{i}_{kind}' in given for kind in KINDS):
            raise ValueError(
                f'CA_ROTOR_COUNT is {count}, but no parameter describes rotor {i}, CA_ROTOR{i}_*'
            )
    for i in range(max(count, 0), ROTORS):
        placed = [f'CA_ROTOR{i}_{kind}' for kind in ('PX', 'PY')]
        if any(given.get(name, 0.0) for name in placed):
            raise ValueError(
                f'CA_ROTOR_COUNT is {count}, but {" and ".join(placed)} place a rotor {i}: '
                f'expected a count of {i + 1}, or no position'
            )
    return given


def _misspelt(name: str, names: Sequence[str]) -> str:
    """Return what is said of a misspelt name of a rotor or its servo; empty: it is none.

    `names`: all names of the file; of names that are equally near one that it lacks, of a rotor
    that has others, is meant.
    """
    if name in NAMES:
        return ''
    # The letter O in place of the digit.
    likely = re.sub(r'O(?=_[A-Z]+$)', '0', name.upper())
    known = NAMES if likely.startswith('CA_SV_TL') else ROTOR_NAMES
    strange = not likely.startswith(('CA_ROTOR', 'CA_SV_TL')) and likely not in NAMES
    if strange and not re.search(rf'_({"|".join((*KINDS, "TILT", "COUNT"))})$', likely):
        return ''
    match = SequenceMatcher(b=likely)
    ranks = []
    for each in known:
        match.set_seq1(each)
        beside = each.rpartition('_')[0] + '_'
        alone = not any(other.startswith(beside) for other in names)
        ranks.append((match.ratio(), each not in names, not alone, each))
    likeness, *_, nearest = max(ranks)
    if strange and likeness < ALIKE:
        return ''
    return f'; did you mean {nearest}?'


def _check_size(places: Array, mass: float) -> None:
    """Raise a ValueError if one of the places (n, 3) is too far away [m] for the mass [kg]."""
    sizes = np.abs(places).max(axis=1)
    farthest = float(sizes.max())
    if not (unit := likely_unit(farthest, mass)):
        return
    scaled, i = farthest * UNITS[unit], int(sizes.argmax())
    if rest := others_within(sizes, mass):
        raise ValueError(
            f'CA_ROTOR{i} (rotor {i + 1}) is {farthest:g} m from the centre of mass, the others '
            f'within {rest:g} m: its CA_ROTOR{i}_PX or _PY looks like {unit} ({scaled:g} m)'
        )
    raise ValueError(
        f'a rotor is {farthest:g} m from the centre of mass of {mass:g} kg: positions look '
        f'like {unit}; --length {UNITS[unit]:g} takes them for such: {scaled:g} m'
    )


def _check_reverse(reverse: int, every: int, least: float) -> None:
    """Raise a ValueError if the motors that reverse contradict the least speed [rad/s]."""
    if reverse and least >= 0.0:
        raise ValueError('CA_R_REV: motors reverse, so expected a --speed-min below 0')
    if least < 0.0 and reverse != every:
        raise ValueError(
            f'CA_R_REV is {reverse}: one --speed-min below 0 expects {every}, all motors'
        )


def from_px4(
    given: Mapping[str, float], mass: float, speeds: tuple[float, float],
    thrust_coefficient: float, moment_constant: float | None = None,
    inertia: Sequence[float] | None = None, name: str = 'multirotor',
    length: float | None = None,
) -> str:
    """Return the text of a parameter file.

    Raises a ValueError if a rotor has no axis, no thrust or no sense of rotation, if the positions
    are normalised and there is no length, or if another value is wrong.

    - `given`: as `read` returns it
    - `mass`: [kg]
    - `speeds`: bounds of the rotor speeds [rad/s]
    - `thrust_coefficient`: k_f of the rotor with the greatest CT [kg m]; the others have theirs in
      the ratio of CT
    - `moment_constant`: k_tau / k_f [m] of all rotors.  Default: the magnitude of KM
    - `inertia` (3,): Jx, Jy, Jz [kg m^2].  An allocator does without
    - `length`: what a position of 1 stands for [m].  Default: 1 m, unless the greatest is 1, as in
      the airframes of SIH and of many kits, where only the ratios are right
    """
    n = int(given['CA_ROTOR_COUNT'])
    if not 1 <= n <= ROTORS:
        raise ValueError(f'CA_ROTOR_COUNT is {n}: expected 1 to {ROTORS}')
    rotors = [
        {kind: given.get(f'CA_ROTOR{i}_{kind}', DEFAULTS[kind]) for kind in KINDS}
        for i in range(n)
    ]
    places, axes = (
        FLIP * np.array([[rotor[kind + axis] for axis in 'XYZ'] for rotor in rotors])
        for kind in 'PA'
    )
    farthest = np.abs(places[:, :2]).max()
    if length is None and farthest == 1.0:
        raise ValueError(
            'the greatest of CA_ROTORn_PX and _PY is 1, so the positions are normalised, not in '
            'metres: give --length, what 1 stands for (--length 1 if it is a metre)'
        )
    places *= 1.0 if length is None else length
    _check_size(places, mass)
    ct, km = (np.array([rotor[kind] for rotor in rotors]) for kind in ('CT', 'KM'))
    for i in range(n):
        named = f'CA_ROTOR{i} (rotor {i + 1})'
        if not axes[i].any() or ct[i] == 0.0:
            raise ValueError(f'{named} has no axis or no thrust: PX4 would ignore it')
        if ct[i] < 0.0:
            raise ValueError(
                f'{named}: CA_ROTOR{i}_CT is {ct[i]:g}: expected above 0; a rotor that pushes the '
                f'other way has the other axis, CA_ROTOR{i}_AX to _AZ'
            )
        if km[i] == 0.0 and (km.any() or moment_constant is not None):
            raise ValueError(
                f'{named}: CA_ROTOR{i}_KM is 0: expected its sign, the sense of rotation'
            )
    _check_reverse(int(given.get('CA_R_REV', 0)), 2**n - 1, speeds[0])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    thrust = thrust_coefficient * ct / ct.max()
    torque = thrust * (np.abs(km) if moment_constant is None else moment_constant)

    # Without a reaction torque senses mean nothing.
    senses = km if km.any() else (-1.0) ** np.arange(n)
    absent = [f'CA_ROTOR{i}_{kind}' for i in range(n) for kind in ('CT', 'KM')]
    absent = [name for name in absent if name not in given]
    note = f". PX4's defaults: {', '.join(absent)}" if absent else ''
    found = parameter_text({
        'vehicle': {'name': f"'{name}'", 'mass': mass, 'inertia': inertia},
        'rotors': {
            'positions': places, 'axes': axes,
            'spins': ['ccw' if each > 0.0 else 'cw' for each in senses],
            'thrust_coefficient': thrust,
            'torque_coefficient': torque, 'speed_min': speeds[0], 'speed_max': speeds[1],
        } | tilts_from(given, n),
    }, f"From PX4's parameters; the rotors are in its order{note}.")
    Vehicle.from_text(found)
    return found


def to_px4(vehicle: Vehicle, order: Sequence[int] = ()) -> dict[str, float]:
    """Return a vehicle's geometry as PX4's parameters by name.

    Raises a ValueError if PX4 has not as many rotors, or `order` has not each rotor once.

    `order` (n,): for each of PX4's motors the rotor that it is, from 1 on; default: the same
    order.
    """
    if vehicle.n > ROTORS:
        raise ValueError(f'{vehicle.n} rotors, but PX4 has {ROTORS} at most')
    rows = rotor_rows(order, vehicle.n)
    full = vehicle.intact.thrusts(vehicle.speed_max)
    found: dict[str, float] = {'CA_ROTOR_COUNT': vehicle.n}
    for motor, i in enumerate(rows):
        ratio = vehicle.torque_coefficient[i] / vehicle.thrust_coefficient[i]
        values = (
            *FLIP * vehicle.arms[i], *FLIP * vehicle.rotor_axes[i],
            DEFAULTS['CT'] * full[i] / full.max(), -vehicle.spins[i] * ratio,
        )
        for name, value in zip(KINDS, values, strict=True):
            found[f'CA_ROTOR{motor}_{name}'] = float(value) + 0.0
    if reversing := sum(1 << motor for motor, i in enumerate(rows) if vehicle.speed_min[i] < 0.0):
        found['CA_R_REV'] = reversing
    return found | tilts_to(vehicle, rows)


def tilts_from(given: Mapping[str, float], n: int) -> dict[str, Any]:
    """Return the settings `rotors.*` of the tilts of n rotors by name; empty if none tilts.

    Raises a ValueError if PX4 would tilt none, or two rotors by one servo.
    """
    servos = [int(given.get(f'CA_ROTOR{i}_TILT', 0)) for i in range(n)]
    if not any(servos):
        return {}
    if given.get('CA_AIRFRAME') != AIRFRAME:
        raise ValueError(f'CA_AIRFRAME: expected {AIRFRAME} (multirotor with tilt) beside _TILT')
    count, lower, upper = int(given.get('CA_SV_TL_COUNT', 0)), [0.0] * n, [0.0] * n
    axes = np.zeros((n, 3))
    for i, servo in enumerate(servos):
        if not servo:
            continue
        if not 1 <= servo <= count:
            raise ValueError(f'CA_ROTOR{i}_TILT is {servo}: CA_SV_TL_COUNT is {count}')
        if servos.count(servo) > 1:
            raise ValueError(f'CA_ROTOR{i}_TILT is {servo}: expected a servo for each rotor')
        low, high, way = (
            radians(given.get(f'CA_SV_TL{servo - 1}_{kind}', value))
            for kind, value in SERVO_DEFAULTS.items()
        )
        axes[i] = np.sin(way), np.cos(way), 0.0
        lower[i], upper[i] = low, high
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    return {'axes': up, 'tilt_axes': axes, 'tilt_min': lower, 'tilt_max': upper}


def tilts_to(vehicle: Vehicle, rows: Sequence[int]) -> dict[str, float]:
    """Return the parameters of a vehicle's tilts by name; `rows` has the rotor of each motor.

    Raises a ValueError if PX4 has no such servos: more than four, gimbals, rotors that do not
    point upwards at the angle zero, directions that are no whole degrees.
    """
    servos, driven = vehicle.servos, vehicle.servos.driven
    if (servos.gimbal > 0.0).any() or driven.sum() > SERVOS:
        raise ValueError(f'PX4 tilts up to {SERVOS} rotors about one axis each')
    if (abs(servos.nominal - [0.0, 0.0, 1.0]) > ROUNDING)[driven].any():
        raise ValueError('PX4 tilts rotors that point upwards at the angle zero: rotors.axes')
    found: dict[str, float] = {}
    for servo, (motor, i) in enumerate((motor, i) for motor, i in enumerate(rows) if driven[i]):
        found |= {'CA_AIRFRAME': AIRFRAME, 'CA_SV_TL_COUNT': servo + 1}
        x, y, _ = servos.axes[i].tolist()
        way = degrees(atan2(x, y)) % 360.0
        if abs(way - round(way)) > 1e-3:
            raise ValueError(f'rotor {i + 1} tilts towards {way:g} degrees: PX4 has whole degrees')
        side = np.cross(servos.axes[i], servos.nominal[i])
        _, pitch, yaw = np.abs(np.cross(vehicle.arms[i], side)) > ROUNDING
        found |= {
            f'CA_ROTOR{motor}_TILT': servo + 1, f'CA_SV_TL{servo}_MINA': degrees(servos.lower[i]),
            f'CA_SV_TL{servo}_MAXA': degrees(servos.upper[i]),
            f'CA_SV_TL{servo}_TD': round(way) % 360,
            f'CA_SV_TL{servo}_CT': int(yaw) + 2 * int(pitch),
        }
    if np.abs([servos.lower, servos.upper]).max() > radians(90.0) + ROUNDING:
        raise ValueError('PX4 tilts rotors by up to 90 degrees: rotors.tilt_min, rotors.tilt_max')
    return found


def text(found: Mapping[str, float], style: str) -> str:
    """Return parameters as commands of PX4's shell, as an airframe or as a file (`STYLES`)."""
    lines = ['# Vehicle-Id Component-Id Name Value Type'] if style == 'params' else []
    for name, value in found.items():
        # MAV_PARAM_TYPE of MAVLink: INT32 or REAL32.
        kind = 6 if WHOLE.fullmatch(name) else 9
        lines.append(STYLES[style].format(name=name, value=value, kind=kind))
    return '\n'.join(lines)


def warnings(text: str, vehicle: Vehicle) -> list[str]:
    """Return what is probably wrong in a file of PX4, with its parameters and lines.

    `vehicle`: the file's, as `from_px4` returns it.
    """
    lines = {name: number for name, _, number in px4_lines(text)}
    lost = [i for i in range(vehicle.n) if not {f'CA_ROTOR{i}_PX', f'CA_ROTOR{i}_PY'} & {*lines}]
    found = [
        f'CA_ROTOR{i} (rotor {i + 1}) is at the centre of mass: there is neither CA_ROTOR{i}_PX '
        f'nor CA_ROTOR{i}_PY' for i in lost if len(lost) < vehicle.n
    ]
    for cause in diagnose(vehicle):
        kinds, places = FAULTY.get(cause.kind, ()), []
        for name in (f'CA_ROTOR{i - 1}_{kind}' for i in cause.rotors for kind in kinds):
            places.append(f'{name}, line {lines[name]}' if name in lines else f'no {name}')
        if len(cause.rotors) > STATED:
            places = ['rotor 1 is CA_ROTOR0']
        found.append(f'{cause.text} ({"; ".join(places)})' if places else cause.text)
    return found


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    ways = parser.add_subparsers(dest='way', required=True)
    one = ways.add_parser('from-px4', help='print a parameter file of ca_ros')
    one.add_argument('file', type=Path, help='an airframe, or a file of QGroundControl (.params)')
    add_rotor_numbers(one, 'k_f, of the strongest [kg m]')
    one.add_argument('--moment-constant', type=finite,
        help='k_tau / k_f [m] (default: the magnitude of KM)')
    one.add_argument('--mass', type=finite, required=True, help='[kg]')
    one.add_argument('--length', type=finite,
        help='what a position of 1 stands for [m] (default: 1, unless the greatest is 1)')
    one.add_argument('--inertia', type=finite, nargs=3, metavar='J',
        help='Jx Jy Jz [kg m^2] (default: none)')
    other = ways.add_parser('to-px4', help="print PX4's parameters")
    other.add_argument('vehicle', help='a shipped vehicle or a parameter file')
    other.add_argument('--style', choices=STYLES, default='shell', help='(default: %(default)s)')
    add_order(other, "the rotor that each of PX4's motors is")


def run(options: argparse.Namespace) -> None:
    """Convert, and print the result."""
    if options.way == 'from-px4':
        content = read_text(options.file)
        given = read(content)
        speeds = options.speed_min, options.speed_max
        name = re.sub(r'\W', '_', options.file.stem)
        found = from_px4(
            given, options.mass, speeds, options.thrust_coefficient, options.moment_constant,
            options.inertia, name, options.length,
        )
        print(found, end='')
        for warning in warnings(content, Vehicle.from_text(found)):
            print(f'ca_ros px4-parameters: warning: {warning}', file=sys.stderr)
        return
    written = to_px4(Vehicle.load(options.vehicle), options.order)
    print(text(written, options.style))


main = partial(command, 'px4-parameters', add_options, run)
