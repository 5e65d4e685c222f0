"""The firmware of one vehicle, as the machine that exports it computes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ca_ros.allocation.box_backend import kernel_for
from ca_ros.allocation.rates import PERIOD_MAX
from ca_ros.allocation.result import Status
from ca_ros.allocation.settings import AllocationSettings, full_names
from ca_ros.allocation.slew import reached
from ca_ros.arrays import Array
from ca_ros.firmware.faults import Fault
from ca_ros.kernel import INVALID, ROTORS_MAX, Kernel, load
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.settings import ParameterError
from ca_ros.vehicle.thrust_curve import ThrustCurve, root, rotor_speeds
from ca_ros.vehicle.validation import ABSURD

DTYPES: dict[str, type[np.floating]] = {'single': np.float32, 'double': np.float64}

Fields = Mapping[str, tuple[str, str, Any]]  # name to type, dimensions and numbers

LIMIT = {'single': 1e12, 'double': ABSURD}  # CA_ABSURD of the kernel: an invalid wrench is larger
UNBOUNDED = {'single': 1e36, 'double': 1e300}  # CA_UNBOUNDED, in place of infinity


@dataclass(frozen=True, eq=False)
class Firmware:
    """A vehicle's faults with a kernel for each, in one precision.

    - `faults`: the first is that there is none
    - `kernels`: one for each fault
    - `settings`: of the vehicle's file
    - `precision` ('single' or 'double')
    """

    template: ClassVar[str] = 'vehicle'
    """The name of the templates of header, code and README."""
    has_margin: ClassVar[bool] = True
    """Whether ``NAME_margin`` is exported."""

    faults: Sequence[Fault]
    kernels: Sequence[Kernel]
    settings: AllocationSettings
    precision: str

    @classmethod
    def make(
        cls, faults: Sequence[Fault], settings: AllocationSettings, precision: str
    ) -> Firmware:
        """Set the kernels up, with the settings of the method `exact`.

        Raises a ParameterError if the method is another, the vehicle is too large or the kernel is
        not built.
        """
        if settings.method != 'exact':
            raise ParameterError(
                f'allocation.method: firmware is made of the method exact, got {settings.method}')
        with full_names(settings):
            suited = [replace(fault, settings=settings.exact) for fault in faults]
            return cls._made(suited, settings, precision)

    @classmethod
    def _made(
        cls, faults: Sequence[Fault], settings: AllocationSettings, precision: str
    ) -> Firmware:
        n = faults[0].problem.n
        if n > ROTORS_MAX:
            raise ParameterError(f'the kernel is for up to {ROTORS_MAX} rotors, got {n}')
        kind = load(precision)
        if kind is None:
            raise ParameterError(
                f'the extension module ca_ros.kernel._{precision} is not built: install a C '
                'compiler, then ca_ros again'
            )
        made = [
            kernel_for(kind, fault.problem, fault.suited, DTYPES[precision]) for fault in faults
        ]
        return cls(faults, made, settings, precision)

    @property
    def problem(self) -> VehicleProblem:
        """The problem without a fault, with all axes of a wrench."""
        return self.faults[0].report.independent

    @property
    def columns(self) -> int:
        """``CA_N`` in C."""
        return self.problem.n

    @property
    def definitions(self) -> dict[str, int]:
        """The constants of ``configuration.h`` and their values."""
        # Priorities of vectors have problems of many sizes.
        fixed = self.columns == self.problem.n and all(
            fault.problem.axes == self.problem.axes for fault in self.faults)
        given = {'CA_N': self.columns, 'CA_M': len(self.problem.axes)}
        if fixed:
            given['CA_FIXED'] = 1
        if self.single:
            given['CA_FLOAT'] = 1
        return given

    @cached_property
    def constants(self) -> Sequence[Fields]:
        """For each fault, the fields of its problem in C."""
        return [kernel.fields() for kernel in self.kernels]

    @property
    def dtype(self) -> type[np.floating]:
        """The type of all numbers."""
        return DTYPES[self.precision]

    @property
    def single(self) -> bool:
        """Whether the numbers are of single precision."""
        return self.precision == 'single'

    @cached_property
    def rows(self) -> list[list[int]]:
        """For each fault, the components of the wrench that are commanded."""
        axes = self.problem.axes
        return [[axes.index(axis) for axis in fault.problem.axes] for fault in self.faults]

    @property
    def health(self) -> Array:
        """For each fault, the health of the rotors (N, n)."""
        found = [fault.report.vehicle.health for fault in self.faults]
        return np.array(found).astype(self.dtype)

    @property
    def level(self) -> list[bool]:
        """For each fault, whether the vehicle still hovers level, if it does without one."""
        found = [fault.report.keeps_level for fault in self.faults]
        return found if found[0] else [True] * len(found)

    def fault_of(self, health: Array) -> int:
        """Return the fault nearest to a health (n,) if it is to be acted on (`acted_on`).

        -1 if the vehicle does not hover level with it, or a rotor differs by 0.5 or more.
        """
        away = np.abs(health - self.health)
        nearest = int(np.argmin(np.sum(away * away, axis=1)))
        return nearest if self.level[nearest] and np.all(away[nearest] < 0.5) else -1

    @cached_property
    def rotors(self) -> list[tuple[Array, Array, Array, Array]]:
        """For each fault, k_f, k_f backwards, and the bounds of the speeds, (n,) each.

        With a thrust curve, k_f is relative to that of the curve.  The coefficients of a lost
        rotor are 1.
        """
        found = []
        unit = 1.0 if self.curve.square else self.curve.coefficient
        for fault in self.faults:
            vehicle = fault.problem.vehicle
            forwards, backwards = (
                np.where(k_f > 0.0, k_f / unit, 1.0).astype(self.dtype) for k_f in (
                    vehicle.thrust_per_squared_speed,
                    vehicle.reverse_thrust_per_squared_speed,
                )
            )
            least, greatest = (bound.astype(self.dtype) for bound in vehicle.speed_limits)
            found.append((forwards, backwards, least, greatest))
        return found

    @property
    def curve(self) -> ThrustCurve:
        """The thrust curve of the rotors."""
        return self.problem.vehicle.curve

    @cached_property
    def segments(self) -> tuple[Array, Array, Array]:
        """The starts and levels (K,) and segments (K, 3) of the curve, in this precision."""
        curve = self.curve
        starts, levels, segments = curve.starts, curve.levels, curve.segments
        return starts.astype(self.dtype), levels.astype(self.dtype), segments.astype(self.dtype)

    def drawn(
        self, fault: int, rng: np.random.Generator, size: int
    ) -> tuple[Array, Array, Array]:
        """Draw wrenches (size, m) inside and on the boundary, and return the centre (m,)."""
        problem, gamma = self.faults[fault].problem, self.problem.gamma
        inside = rng.uniform(problem.lower, problem.upper, (size, problem.n)) @ gamma.T
        return inside, _on_facets(problem, rng, size) @ gamma.T, gamma @ problem.middle

    def is_sound(self, fault: int, wrench: Array) -> bool:
        """Tell whether there is such a fault, and a wrench (m,) is finite and not absurd."""
        known = 0 <= fault < len(self.faults)
        return known and bool(np.all(np.abs(wrench) <= self.dtype(LIMIT[self.precision])))

    def margin(self, fault: int, wrench: Array) -> float:
        """Return the margin of a wrench (m,) of the firmware's precision, to the last bit."""
        if not self.is_sound(fault, wrench):
            return float(self.dtype(-UNBOUNDED[self.precision]))
        return self.kernels[fault].margin(np.ascontiguousarray(wrench[self.rows[fault]]))

    def allocate(self, fault: int, wrench: Array) -> tuple[int, Array]:
        """Return the status and the speeds (n,), to the last bit as the firmware does.

        `wrench` (m,): of the firmware's precision [N, N m].
        """
        if not self.is_sound(fault, wrench):
            row = fault if 0 <= fault < len(self.faults) else 0
            return INVALID, self._rest(*self.rotors[row][2:])
        return self._allocate(fault, wrench, *self.rotors[fault][2:])

    def _rest(self, low: Array, high: Array) -> Array:
        """Return the speeds (n,) nearest to zero."""
        return np.minimum(np.maximum(self.dtype(0), low), high)

    def _allocate(
        self, fault: int, wrench: Array, low: Array, high: Array, *bounds: Array
    ) -> tuple[int, Array]:
        """Return the status, and speeds (n,) within bounds of them and of the thrusts."""
        thrusts = np.empty(self.problem.n, self.dtype)
        u = np.ascontiguousarray(wrench[self.rows[fault]])
        answer = self.kernels[fault].allocate(u, u.copy(), thrusts, *bounds)
        status = 0 if answer is None else answer[0]
        if status in (INVALID, Status.REJECTED):
            return status, self._rest(low, high)
        k_f, reverse = self.rotors[fault][:2]
        return status, rotor_speeds(thrusts, k_f, reverse, low, high, self._inverse)

    @cached_property
    def rates(self) -> tuple[Array, Array] | None:
        """Greatest rates (n,) at which speeds grow and shrink [rad/s^2]; None without rates."""
        if (found := self.problem.rates) is None:
            return None
        return found[0].astype(self.dtype), found[1].astype(self.dtype)

    def allocate_within(
        self, fault: int, wrench: Array, time: float, last: Array
    ) -> tuple[int, Array]:
        """Return the status and the speeds (n,) within the rates, to the last bit.

        - `fault` and `wrench`: as in `allocate`
        - `time`: since the last command [s]
        - `last` (n,): the speeds of the last command, of the firmware's precision [rad/s]
        """
        assert self.rates is not None
        k_f, reverse, least, greatest = self.rotors[fault]
        elapsed = min(max(self.dtype(time), self.dtype(0)), self.dtype(PERIOD_MAX))
        low, high = reached(last, elapsed, *self.rates, least, greatest)
        bounds = (self.thrusts_at(speeds, k_f, reverse) for speeds in (low, high))
        return self._allocate(fault, wrench, low, high, *bounds)

    def thrusts_at(self, speeds: Array, k_f: Array, reverse: Array) -> Array:
        """Return the thrusts (n,) of speeds (n,)."""
        if self.curve.square:
            square = speeds * speeds
            return np.where(speeds < 0, -(reverse * square), k_f * square)
        starts, _, segments = self.segments
        a, b, c = segments[np.searchsorted(starts, speeds, 'right') - 1].T
        return np.asarray(k_f * ((a * speeds + b) * speeds + c))

    def _inverse(self, ratio: Array) -> Array:
        """Return the speeds (n,) for thrusts over k_f (n,)."""
        if self.curve.square:
            return np.sqrt(ratio)
        _, levels, segments = self.segments
        a, b, c = segments[np.searchsorted(levels, ratio, 'right') - 1].T
        return root(a, b, ratio - c)


def _on_facets(problem: AllocationProblem, rng: np.random.Generator, size: int) -> Array:
    """Return thrusts (size, n) of wrenches on random facets of the admissible set.

    On the facet that is parallel to the columns of m - 1 rotors, these have any thrusts, and the
    others are at the bound on its side.
    """
    turning = np.flatnonzero(problem.half_range)
    columns = ((problem.gamma * problem.half_range / problem.extent[:, None]).T)[turning]
    free = rng.permuted(np.tile(np.arange(len(turning)), (size, 1)), axis=1)
    free = free[:, : len(problem.axes) - 1]
    parallel = columns[free]
    # The eigenvector of the least eigenvalue is normal to all of them.
    normals = np.linalg.eigh(np.swapaxes(parallel, 1, 2) @ parallel)[1][:, :, 0]
    ways = rng.choice([-1.0, 1.0], (size, 1)) * np.sign(normals @ columns.T)
    np.put_along_axis(ways, free, rng.uniform(-1.0, 1.0, free.shape), axis=1)
    thrusts = np.tile(problem.middle, (size, 1))
    thrusts[:, turning] += problem.half_range[turning] * ways
    return thrusts
