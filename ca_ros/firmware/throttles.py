"""Throttles and pulse widths of exported firmware."""

from __future__ import annotations

from pathlib import Path
from string import Template

import numpy as np

from ca_ros.arrays import Array
from ca_ros.firmware import literals
from ca_ros.firmware.firmware import Firmware
from ca_ros.vehicle.thrust_curve import ThrustCurve, root

SIZE = 50  # golden vectors

MEASURED = """\
        const ca_real speed = w * full[i];
        int k = $count - 1;
        while (k > 0 && speed < points[k][0])
            k--;
        const ca_real found = points[k][1] + points[k][2] * (speed - points[k][0]);"""
MODELLED = """\
        const ca_real share = ca_min($thrust / full[i], 1), b = $linear;
        const ca_real bottom = b + ca_sqrt(b * b + 4 * $expo * share);
        const ca_real found = bottom > 0 ? 2 * share / bottom : 0;"""


def has_throttles(curve: ThrustCurve) -> bool:
    """Tell whether a vehicle's file says more of throttles than that they are shares of thrust."""
    default = ThrustCurve()
    plain = curve.square and not len(curve.throttles) and curve.expo == default.expo
    return not plain or curve.pwm != default.pwm


def tables(firmware: Firmware) -> tuple[Array, Array]:
    """Return the points (L, 3) of measured throttles, and a number for each rotor (n,).

    The points are speeds [rad/s], throttles, and slopes from there on; L is 0 without them.  The
    number is the factor from a rotor's speed to that of the points, or without these its thrust
    at full throttle (without a curve: its squared speed).
    """
    vehicle, curve = firmware.problem.vehicle, firmware.curve
    full = vehicle.full_speeds
    w, t = curve.throttle_speeds, curve.throttles
    if not len(w):
        top = vehicle.speed_max if full is None else full
        numbers = top**2 if curve.square else curve.thrust(top)
        return np.zeros((0, 3), firmware.dtype), numbers.astype(firmware.dtype)
    scale = np.ones(vehicle.n) if full is None else w[-1] / full
    if w[0] > 0.0:
        w, t = np.insert(w, 0, 0.0), np.insert(t, 0, t[0])
    points = np.column_stack([w, t, np.append(np.diff(t) / np.diff(w), 0.0)])
    return points.astype(firmware.dtype), scale.astype(firmware.dtype)


def throttles(firmware: Firmware, speeds: Array) -> tuple[Array, Array]:
    """Return throttles and pulses [us] (n,) of speeds (n,) [rad/s], to the last bit as in C."""
    (points, full), curve, real = tables(firmware), firmware.curve, firmware.dtype
    w = np.abs(speeds)
    if len(points):
        speed = w * full
        start, throttle, slope = points[np.searchsorted(points[:, 0], speed, 'right') - 1].T
        found = throttle + slope * (speed - start)
    else:
        one = np.ones(len(w), real)
        share = np.minimum(firmware.thrusts_at(w, one, one) / full, real(1))
        found = root(np.full(1, curve.expo, real), np.full(1, 1.0 - curve.expo, real), share)
    signed = np.where(speeds < 0, -found, found)
    low, high = curve.pwm
    half = real(0.5)
    turn = np.where(firmware.rotors[0][2] < 0, half + half * signed, signed)
    return signed, real(low) + real(high - low) * turn


def filled(firmware: Firmware, name: str) -> dict[str, str]:
    """Return the function, its header and its golden vectors; nothing without throttles."""
    if not has_throttles(firmware.curve):
        return {'throttles': '', 'throttles_header': '', 'throttles_golden': ''}
    points, full = tables(firmware)
    curve, precision = firmware.curve, firmware.precision
    low, high = curve.pwm
    rows = '\n'.join(literals.indented(f'{literals.braced(row, precision)},', 1) for row in points)
    numbers = f'static const ca_real full[CA_N] = {literals.braced(full, precision)};'
    if len(points):
        numbers += (
            '\n\n/* Measured speeds, throttles, and slopes from there on. */\n'
            f'static const ca_real points[{len(points)}][3] = {{\n{rows}\n}};\n'
        )
    else:
        numbers += '\n'
    thrust = 'w * w' if curve.square else f'ca_curve({len(curve.starts)}, segments, w)'

    def real(value: float) -> str:
        return literals.real(float(firmware.dtype(value)), precision)

    body = Template(MEASURED if len(points) else MODELLED).substitute(
        count=len(points), thrust=thrust, expo=real(curve.expo), linear=real(1.0 - curve.expo),
    )
    _, _, least, greatest = firmware.rotors[0]
    shares = np.random.default_rng(2).uniform(0.0, 1.0, (SIZE, len(least)))
    drawn = (least + shares * (greatest - least)).astype(firmware.dtype)
    outputs = []
    for speeds in np.vstack([0 * least, least, greatest, drawn]):
        row = (speeds, *throttles(firmware, speeds))
        outputs.append(', '.join(literals.braced(each, precision) for each in row))
    fields = {
        'name': name, 'NAME': name.upper(), 'points': numbers, 'body': body,
        'low': real(low), 'range': real(high - low), 'half': real(0.5),
        'outputs': '\n'.join(literals.indented(f'{{{line}}},', 1) for line in outputs),
    }
    found = {}
    for key, file in (('', '.c'), ('_header', '.h'), ('_golden', '_golden.h')):
        path = Path(__file__).with_name('templates') / f'throttles{file}'
        found[f'throttles{key}'] = Template(path.read_text(encoding='utf-8')).substitute(fields)
    return found
