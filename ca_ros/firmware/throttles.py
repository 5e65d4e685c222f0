"""Throttles and pulse widths of exported firmware."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.firmware.firmware import Firmware
from ca_ros.vehicle.thrust_curve import ThrustCurve, root

SIZE = 50  # golden vectors


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


def outputs(firmware: Firmware) -> list[tuple[Array, ...]]:
    """Return the golden vectors: speeds [rad/s], throttles and pulses [us], (n,) each."""
    _, _, least, greatest = firmware.rotors[0]
    shares = np.random.default_rng(2).uniform(0.0, 1.0, (SIZE, len(least)))
    drawn = (least + shares * (greatest - least)).astype(firmware.dtype)
    rows = np.vstack([0 * least, least, greatest, drawn])
    return [(speeds, *throttles(firmware, speeds)) for speeds in rows]
