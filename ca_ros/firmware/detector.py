"""The detector of rotor failures of an exported vehicle: its constants and a golden flight."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ca_ros import kernel
from ca_ros.arrays import Array
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.detection.kernel_detector import KernelDetector, packed
from ca_ros.detection.motor_model import settling_of
from ca_ros.firmware.firmware import DTYPES
from ca_ros.setting_names import check_given
from ca_ros.settings import ParameterError, read, table
from ca_ros.vehicle.effectiveness import rotor_wrenches
from ca_ros.vehicle.vehicle import Vehicle, inertia_of

STEP = 0.01  # between two states of the golden flight [s]
FORCE_NOISE = 0.1  # of the accelerometer [m/s^2]
STATES, FAILURE = 230, 210
"""States of the golden flight once the motors have settled, and the first one of these after the
failure of rotor 1.  From 2 s on pairs are tested, too."""


def detector_of(vehicle: Vehicle, given: Mapping[str, Any]) -> FailureDetector:
    """Return the detector of a vehicle's file.

    Raises a ParameterError if a setting is wrong, or rotors tilt.
    """
    vehicle.servos.refuse('detector in C')
    ours = {name: value for name, value in given.items() if name.startswith('detector.')}
    check_given(ours, table(DetectorSettings, 'detector.'))
    return FailureDetector(vehicle, read(DetectorSettings, ours, 'detector.'))


def golden_flight(detector: FailureDetector, precision: str) -> list[tuple[Array, ...]]:
    """Return a flight in which rotor 1 fails: states, commands, and the answers.

    The rotors have constant speeds: that of hover, if one speed is enough.  The vehicle stands
    until the motors have settled, and then moves at 1 m/s.
    """
    module = kernel.extension('detector_single' if precision == 'single' else 'detector')
    if module is None:
        raise ParameterError('the extension modules of the detector are not built')
    vehicle, dtype = detector.vehicle, DTYPES[precision]
    if (model := packed(detector, module.FIELDS)) is None:
        raise ParameterError(
            f'--detector: expected up to {module.N} rotors and {module.SEGMENTS} segments of '
            'rotors.thrust_curve'
        )
    answers = KernelDetector(module, model, vehicle, detector.settings)
    rng = np.random.default_rng(0)
    wrenches, sound = rotor_wrenches(vehicle), vehicle.intact
    up = max(float(wrenches[2].sum()), 1e-9)
    hover = np.clip(vehicle.weight / up, sound.thrust_min, sound.thrust_max)
    speeds = sound.speeds(hover)
    thrusts = sound.thrusts(speeds)
    lost = np.concatenate([
        wrenches[:3, 0] / vehicle.mass, np.linalg.inv(inertia_of(vehicle)) @ wrenches[3:, 0]
    ]) * thrusts[0]
    noise = np.repeat([0.01, 0.005], 3)
    motion, settled = np.zeros(6), -(-settling_of(detector.settings) // round(1e9 * STEP))
    at_rest = np.array([0.0, 0.0, vehicle.gravity])
    flight: list[tuple[Array, ...]] = []
    for i in range(settled + STATES):
        motion[0] += i == settled
        failed = i >= settled + FAILURE
        motion = motion - failed * STEP * lost
        force = at_rest - failed * lost[:3] + FORCE_NOISE * rng.standard_normal(3)
        state = np.concatenate(
            [[0.0, 0.0, 0.0, 1.0], motion + noise * rng.standard_normal(6), force])
        state, command = state.astype(dtype), speeds.astype(dtype)
        time = i * round(1e9 * STEP)
        answers.observe(time, *np.split(state.astype(float), [4, 7, 10]))
        answers.command(time, command.astype(float))
        flight.append((state, command, answers.health, answers.probabilities))
    return flight
