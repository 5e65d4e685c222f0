"""The firmware of a vehicle whose rotors tilt: rotor speeds, and the angles of the servos."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ca_ros.allocation.sets_backend import SetsNumpy
from ca_ros.allocation.settings import AllocationSettings
from ca_ros.arrays import Array
from ca_ros.firmware.faults import Fault
from ca_ros.firmware.firmware import Fields, Firmware
from ca_ros.kernel import extension
from ca_ros.kernel.vectored import padded, structure
from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import ParameterError
from ca_ros.vehicle.vehicle import Vehicle

MODULES = {'single': 'vectored_single', 'double': 'vectored'}


class TiltingFirmware(Firmware):
    """`Firmware` with a command of rotor speeds, and behind them servo angles."""

    template = 'tilting'
    has_margin = False

    @classmethod
    def _made(
        cls, faults: Sequence[Fault], settings: AllocationSettings, precision: str
    ) -> TiltingFirmware:
        problem = faults[0].problem
        if not problem.vehicle.curve.square:
            raise ParameterError('rotors.thrust_curve: not for the firmware of rotors that tilt')
        if limited := rated(problem.vehicle):
            raise ParameterError(
                f'{limited}: the firmware of rotors that tilt does not limit rates: leave it out '
                'of the file, and limit the rates behind the allocator'
            )
        module = extension(MODULES[precision])
        if module is None or components(problem, settings) > module.N:
            raise ParameterError(
                f'the extension module ca_ros.kernel._vectored is not built, or the vectors of '
                f'the rotors have more than 32 components: {components(problem, settings)}, with '
                f'those of the axes for the policy prioritize'
            )
        fields = (SetsNumpy(each.problem, each.suited).fields for each in faults)
        return cls(faults, [structure(module, each) for each in fields], settings, precision)

    @cached_property
    def constants(self) -> Sequence[Fields]:
        """For each fault, the fields of its problem in C."""
        module = extension(MODULES[self.precision])
        return [padded(module, SetsNumpy(each.problem, each.suited).fields)
                for each in self.faults]

    def drawn(
        self, fault: int, rng: np.random.Generator, size: int
    ) -> tuple[Array, Array, Array]:
        """Draw wrenches (size, m) inside and on the boundary; return the centre of lines (m,)."""
        problem, m = self.faults[fault].problem, len(self.problem.axes)
        inside = problem.clip(rng.uniform(problem.lower, problem.upper, (size, problem.n)))
        ways = rng.normal(size=(size, len(problem.axes))) @ problem.gamma
        # The columns of a fault are others than without it.
        found = np.zeros((2, size, m))
        found[..., self.rows[fault]] = (
            np.array([inside, problem.sets.farthest(ways)]) @ problem.gamma.T)
        return found[0], found[1], np.zeros(m)

    @property
    def columns(self) -> int:
        """``CA_N`` in C."""
        return components(self.problem, self.settings)

    @property
    def rates(self) -> None:
        """There are none: the function has no state."""
        return None

    @cached_property
    def servos(self) -> list[tuple[Array, ...]]:
        """For each fault, the arguments of ``ca_vectored_command`` between vectors and results.

        Least and greatest thrust (n,), number of servos (n,), and for each servo the middle, the
        least and the greatest angle (k,).
        """
        found = []
        for fault in self.faults:
            vehicle, servos = fault.problem.vehicle, fault.problem.vehicle.servos
            counts = np.bincount(servos.rotors, minlength=vehicle.n).astype(np.int32)
            low, high = servos.limits
            numbers = vehicle.thrust_min, vehicle.thrust_max, (low + high) / 2.0, low, high
            least, most, *angles = (each.astype(self.dtype) for each in numbers)
            found.append((least, most, counts, *angles))
        return found

    def allocate(self, fault: int, wrench: Array) -> tuple[int, Array]:
        """Return the status, and speeds and angles (n + k,), to the last bit as the firmware."""
        row = fault if 0 <= fault < len(self.faults) else 0
        k_f, _, least, greatest = self.rotors[row]
        kernel: Any = self.kernels[row]
        vectors = np.empty(self.faults[row].problem.n, self.dtype)
        demand = np.full(len(self.rows[row]), np.nan, self.dtype)
        if self.is_sound(fault, wrench):
            demand = np.ascontiguousarray(wrench[self.rows[row]])
        answer = kernel.allocate(demand, demand.copy(), vectors)
        thrusts = np.empty(self.problem.vehicle.n, self.dtype)
        angles = np.empty(len(self.problem.vehicle.servos), self.dtype)
        kernel.command(vectors, *self.servos[row], thrusts, angles)
        speeds = np.minimum(np.maximum(np.sqrt(thrusts / k_f), least), greatest)
        return 0 if answer is None else answer[0], np.concatenate([speeds, angles])


FIRMWARES = {'exact': Firmware, 'vectored': TiltingFirmware}
"""By the name of the kernel that allocates."""


def firmware_of(
    faults: Sequence[Fault], settings: AllocationSettings, precision: str
) -> Firmware:
    """Return the firmware of a vehicle, whether its rotors tilt or not; see `Firmware.make`."""
    return FIRMWARES[faults[0].problem.program.kernel].make(faults, settings, precision)


def components(problem: AllocationProblem, settings: AllocationSettings) -> int:
    """Return the number of components that the kernel needs: the priorities add one an axis."""
    return problem.n + len(problem.axes) * (settings.exact.policy == 'prioritize')


def rated(vehicle: Vehicle) -> str:
    """Return the setting that limits a rate of a vehicle whose rotors tilt; empty without one."""
    if vehicle.acceleration_max is not None:
        return 'rotors.acceleration_max'
    return 'rotors.tilt_rate_max' if vehicle.servos.rate_max.any() else ''
