"""The detector of rotor failures in C, where it is built, and the choice between both."""

import re
from collections.abc import Mapping
from os import environ
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.failure_detector import (
    FailureDetector,
    described,
    model_of,
    settings_with_lag,
)
from ca_ros.kernel import extension
from ca_ros.vehicle.vehicle import Vehicle

EVIDENCE = ('', 'motion', 'rotor speed')  # the words for an enum ca_evidence


class KernelDetector:
    """`FailureDetector` in C (ca_ros/kernel/detector.c): the same to rounding, and faster.

    - `module`: ``ca_ros.kernel._detector``, or ``_detector_single`` for single precision
    - `model` (N,): as `packed` returns it
    - `vehicle` and `settings`: as of `FailureDetector`
    """

    def __init__(
        self, module: Any, model: Array, vehicle: Vehicle, settings: DetectorSettings
    ) -> None:
        self.vehicle, self.settings = vehicle, settings
        self._kernel = module.Detector(model)
        self.command = self._kernel.command
        self.measure = self._kernel.measure
        self.observe = self._kernel.observe
        self.reset = self._kernel.reset
        self.interrupt = self._kernel.interrupt

    def __repr__(self) -> str:
        """Return the vehicle, the lag of its motors and what was found, in one line."""
        return described(self)

    def __reduce__(self) -> str:
        """Refuse to be copied or pickled."""
        raise TypeError('a KernelDetector cannot be copied or pickled: a FailureDetector can')

    def announce(self, health: ArrayLike, stuck: Mapping[int, float] | None = None) -> None:
        """Take the announced health (n,), as `FailureDetector` does; no servo can stick."""
        self.vehicle = self.vehicle.with_health(health, stuck=stuck or {})
        self._kernel.announce(np.array(self.vehicle.health))

    @property
    def health(self) -> Array:
        """The announced health, less what was found, (n,)."""
        health = np.empty(self.vehicle.n)
        self._kernel.health(health)
        return health

    @property
    def failed_arms(self) -> tuple[tuple[int, int], ...]:
        """The named arms: rotors, from 1, of which one has failed, and which one is unknown."""
        partners = [partner for *_, partner in self._kernel.failures()]
        return tuple((i + 1, j + 1) for i, j in enumerate(partners) if j > i)

    @property
    def probabilities(self) -> Array:
        """Probabilities (n + 1,): that each rotor has failed, now or before; of a disturbance."""
        probabilities = np.empty(self.vehicle.n + 1)
        self._kernel.probabilities(probabilities)
        return probabilities

    @property
    def since(self) -> list[int | None]:
        """When each rotor was found to have failed [ns]."""
        return [time if order else None for time, order, *_ in self._kernel.failures()]

    @property
    def order(self) -> list[int]:
        """The number of the name of each rotor, from 1, in the order of naming; 0: not named.

        Rotors that are named in one test share a number.
        """
        return [order for _, order, *_ in self._kernel.failures()]

    @property
    def evidence(self) -> list[str]:
        """What each failure was found by."""
        return [EVIDENCE[evidence] for *_, evidence, _ in self._kernel.failures()]

    @property
    def suspect(self) -> int | None:
        """The rotor that may be failing now."""
        suspect: int = self._kernel.status()[0]
        return suspect if suspect >= 0 else None

    @property
    def standing(self) -> bool:
        """Whether the vehicle stands; then nothing is detected."""
        return bool(self._kernel.status()[1])

    @property
    def testing(self) -> bool:
        """Whether losses are tested: in the air, with the speeds of the motors known."""
        return bool(self._kernel.status()[2])


Detector = FailureDetector | KernelDetector


def packed(detector: FailureDetector, fields: dict[str, str]) -> Array | None:
    """Return the numbers of a detector's model, those of each field one after the other.

    None if one has no room.  `fields`: the dimensions of each field of `ca_detector_model`, such
    as '[6][32]'.
    """
    model, rows = model_of(detector), []
    for name, dimensions in fields.items():
        numbers = model[name]
        row = np.zeros([int(size) for size in re.findall(r'\d+', dimensions)])
        if any(size > room for size, room in zip(numbers.shape, row.shape, strict=True)):
            return None
        row[tuple(slice(size) for size in numbers.shape)] = numbers
        rows.append(row.ravel())
    return np.concatenate(rows)


def make_detector(
    vehicle: Vehicle, settings: DetectorSettings | None = None, /, **given: Any
) -> Detector:
    """Return a detector of rotor failures: a `FailureDetector`, or the same in C.

    It is in NumPy without the extension module, with `CA_ROS_KERNEL=numpy`, and for vehicles whose
    rotors tilt, or with more rotors, or segments of the thrust curve, than the module has room
    for.

    Parameters
    ----------
    vehicle : Vehicle
    settings : DetectorSettings, optional
    **given
        The same one by one, by keyword; see `FailureDetector`.

    Raises
    ------
    ParameterError
        If the vehicle has no inertia, or a setting is wrong.
    TypeError
        If there is no such setting.
    """
    detector = FailureDetector(vehicle, settings_with_lag(settings, given))
    fixed = not len(detector.vehicle.servos) and environ.get('CA_ROS_KERNEL') != 'numpy'
    module = extension('detector') if fixed else None
    model = None if module is None else packed(detector, module.FIELDS)
    if model is None:
        return detector
    return KernelDetector(module, model, detector.vehicle, detector.settings)
