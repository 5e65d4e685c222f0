"""The result of an allocation, and its status."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum
from functools import cached_property
from typing import Any, Generic, overload

import numpy as np

from ca_ros.allocation.certificate import Certificate, Number, certify
from ca_ros.allocation.explanation import Explanation, explain
from ca_ros.arrays import Array, BoolArray, IntArray
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.programs import lengths
from ca_ros.problem.vehicle_problem import vehicle_problem


class Status(IntEnum):
    """How the thrusts relate to the demanded wrench.

    ``status.name`` is its name.  A comparison with text is a TypeError, since it would be false.
    """

    EXACT = 0
    """The thrusts produce the wrench, to rounding."""
    PRIORITIZED = 1
    """The wrench is not attainable; the axes are served in the order of their priority."""
    SCALED = 2
    """The wrench is not attainable; a share of it is produced, in the same direction."""
    INEXACT = 3
    """The thrusts produce an approximation of the wrench."""
    REJECTED = 4
    """The wrench is not attainable; nothing is allocated: the thrusts are nearest to zero."""
    RATE_LIMITED = 6
    """PRIORITIZED or SCALED, within bounds of this answer: rates of the rotors limit it."""

    def __str__(self) -> str:
        """Return the name; an IntEnum would be its number in some versions of Python."""
        return self.name

    __format__ = Enum.__format__

    def __eq__(self, other: object) -> bool:
        """Return whether the other is the status or its number."""
        if isinstance(other, str):
            raise TypeError(
                f'a status is a number with a name: compare status.name with {other!r}, or the '
                'status with Status.EXACT')
        return self is other or int.__eq__(self, other)  # type: ignore[arg-type]

    def __ne__(self, other: object) -> bool:
        """Return the opposite of equality."""
        return not self == other if isinstance(other, str) else int.__ne__(self, other)  # type: ignore[arg-type]

    __hash__ = int.__hash__

    @classmethod
    def _missing_(cls, value: object) -> Status | None:
        """Return the status of a name, for ``Status('EXACT')``."""
        return cls.__members__.get(str(value))


class Answer(Generic[Number]):
    """What `Allocation` and `AllocationBatch` have in common; see there."""

    problem: AllocationProblem
    demand: Array
    thrusts: Array
    preference: tuple[Array, Array] | None
    bounds: tuple[Array, Array] | None = None
    part: Any = None
    """The answer of the method, if that has only some of the axes: its certificate counts, with
    the residual of all axes."""
    maker: Any = None
    """The allocator that made this answer of its `part`."""

    @property
    def effectors(self) -> Array:
        """The thrusts, where the effectors of a problem are not rotors."""
        return self.thrusts

    @property
    def speeds(self) -> Array:
        """Rotor speeds (n,), within their bounds to the last bit [rad/s], Eq. (11).

        Raises a TypeError if the problem has no vehicle.
        """
        problem = vehicle_problem(self.problem)
        return problem.vehicle.speeds(problem.sets.sizes(self.thrusts))

    @property
    def angles(self) -> Array:
        """Servo angles (k,) of a vehicle, within their limits [rad]; empty without servos.

        Raises a TypeError if the problem has no vehicle.
        """
        return vehicle_problem(self.problem).angles(self.thrusts)

    @property
    def command(self) -> Array:
        """What a vehicle takes: the speeds, and the angles behind them (n + k,).

        Of a problem without a vehicle the effectors (n,), within their bounds.
        """
        return self.problem.command(self.thrusts)

    @property
    def wrench(self) -> Array:
        """The produced wrench Gamma f, (m,) [N, N m]."""
        return self.thrusts @ self.problem.gamma.T

    @property
    def residual(self) -> Array:
        """Demand minus wrench, (m,) [N, N m]."""
        return self.demand - self.wrench

    @property
    def saturation(self) -> IntArray:
        """Per rotor, (n,): -1 at its lower and +1 at its upper bound, to rounding; 0 between."""
        return self.problem.saturation(self.thrusts, self.bounds)

    @cached_property
    def certificate(self) -> Certificate[Number]:
        """The certificate, computed from the problem's data at the first access."""
        if self.part is not None:
            return replace(self.part.certificate, primal_residual=lengths(self.residual))
        return certify(self.problem, self.demand, self.thrusts, self.preference, self.bounds)


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Allocation(Answer[float]):
    """The thrusts for a demanded wrench.

    Attributes
    ----------
    problem : AllocationProblem
    demand : (m,) array
        The demanded wrench u [N, N m].
    thrusts : (n,) array
        Within their bounds to the last bit [N].
    status : Status
    level : float
        Share of the demand that was served, such as alpha of Eqs. (14)-(17); 1 if the method does
        not compute it.
    violation : float
        Greatest violation of the bounds by the method before its thrusts were clipped [N].
    preference : tuple of two (n,) arrays, or None
        Weights and preferred thrusts [1, N], if the method was given any.
    bounds : tuple of two (n,) arrays, or None
        The bounds of this answer [N], if they are narrower than those of the problem: see
        `Allocator.allocate_within`.
    by_rate : (n,) array, or None
        Of vectors in sets, whether rates limit their lengths and their tilts: first and second
        component.

    Examples
    --------
    >>> answer = Exact(Vehicle.load('hexarotor')).allocate([9.81, 3.0, 0.0, 0.0])
    >>> print(answer.explanation)
    roll 91 % served, limited by rotors 2, 3 at their maximum and rotors 5, 6 at their minimum
    """

    problem: AllocationProblem
    demand: Array
    thrusts: Array
    status: Status
    level: float = 1.0
    violation: float = 0.0
    preference: tuple[Array, Array] | None = None
    bounds: tuple[Array, Array] | None = None
    by_rate: BoolArray | None = None
    _explain: Callable[[Allocation], Explanation] | None = field(default=None, repr=False)

    def __init__(
        self, problem: AllocationProblem, demand: Array, thrusts: Array, status: Status,
        level: float = 1.0, violation: float = 0.0, preference: tuple[Array, Array] | None = None,
        bounds: tuple[Array, Array] | None = None, by_rate: BoolArray | None = None,
        _explain: Callable[[Allocation], Explanation] | None = None,
    ) -> None:
        # The __init__ of a frozen dataclass takes three times as long. Defaults are in the class.
        fields = self.__dict__
        fields['problem'] = problem
        fields['demand'] = demand
        fields['thrusts'] = thrusts
        fields['status'] = status
        if level != 1.0:
            fields['level'] = level
        if violation != 0.0:
            fields['violation'] = violation
        if preference is not None:
            fields['preference'] = preference
        if bounds is not None:
            fields['bounds'] = bounds
        if by_rate is not None:
            fields['by_rate'] = by_rate
        if _explain is not None:
            fields['_explain'] = _explain

    def __str__(self) -> str:
        """Return the status and the wrench by axis, with the demand where it differs."""
        ends = np.round([self.wrench, self.demand], 9) + 0.0
        parts = (
            f'{axis} {value:.4g}' + (f' of {demand:.4g}' if value != demand else '')
            for axis, value, demand in zip(self.problem.axes, *ends.tolist(), strict=True)
        )
        return f'{self.status.name}: {", ".join(parts)}'

    def __repr__(self) -> str:
        """Return status and wrench, with the thrusts."""
        size = np.array2string(self.thrusts, precision=4, separator=', ', max_line_width=10**6)
        return f'Allocation: {self}; {self.problem.effector_kind} at {size}{self.problem.unit}'

    @property
    def is_exact(self) -> bool:
        """Whether the status is EXACT: the thrusts produce the wrench, to rounding."""
        return self.status is Status.EXACT

    def is_close(self, tolerance: float) -> bool:
        """Tell whether each axis is met to a share of half of its range (`problem.extent`)."""
        return bool((np.abs(self.residual) <= tolerance * self.problem.extent).all())

    @cached_property
    def explanation(self) -> Explanation:
        """What was served of each axis, and what limits the rest; computed at the first access."""
        if self._explain is not None:
            return self._explain(self)
        problem = self.problem
        within = problem if self.bounds is None else problem.bounded(*self.bounds)
        exact = self.status is Status.EXACT
        return explain(problem, within, self.demand, self.thrusts, exact)


@dataclass(frozen=True, eq=False, repr=False)
class AllocationBatch(Answer[Array]):
    """The thrusts for N demanded wrenches; attributes and properties have a leading N.

    Attributes
    ----------
    problem, preference
        Those of all answers; see `Allocation`.
    demand : (N, m) array
    thrusts : (N, n) array
    status : (N,) array of int8
        The values of `Status`; `to_frame` has the names.
    level, violation : (N,) arrays

    Examples
    --------
    >>> wrenches = [[9.81, 0.0, 0.0, 0.0], [9.81, 3.0, 0.0, 0.0]]
    >>> batch = Exact(Vehicle.load('hexarotor')).allocate_batch(wrenches)
    >>> print(batch)
    2 answers: 1 EXACT, 1 PRIORITIZED
    >>> [answer.status.name for answer in batch]
    ['EXACT', 'PRIORITIZED']
    """

    problem: AllocationProblem
    demand: Array
    thrusts: Array
    status: IntArray
    level: Array
    violation: Array
    preference: tuple[Array, Array] | None = None

    def __len__(self) -> int:
        """Return the number of wrenches."""
        return len(self.demand)

    def __iter__(self) -> Iterator[Allocation]:
        """Return the answers one after the other."""
        return (self[i] for i in range(len(self)))

    @overload
    def __getitem__(self, i: int) -> Allocation: ...
    @overload
    def __getitem__(self, i: slice | Sequence[int] | IntArray | BoolArray) -> AllocationBatch: ...

    def __getitem__(self, i: Any) -> Allocation | AllocationBatch:
        """Return the answer to wrench i, or a batch of those of a slice, numbers or a mask."""
        if self.part is not None:
            return self.maker.whole(self.part[i], self.demand[i])
        if isinstance(i, slice) or np.ndim(i):
            return replace(
                self, demand=self.demand[i], thrusts=self.thrusts[i], status=self.status[i],
                level=self.level[i], violation=self.violation[i])
        parts = self.demand[i], self.thrusts[i], Status(self.status[i])
        shares = float(self.level[i]), float(self.violation[i])
        return Allocation(self.problem, *parts, *shares, self.preference)

    @property
    def explanation(self) -> list[Explanation]:
        """The explanation of each answer."""
        return [answer.explanation for answer in self]

    @property
    def is_exact(self) -> BoolArray:
        """Which answers are EXACT, (N,)."""
        return np.asarray(self.status == Status.EXACT)

    def is_close(self, tolerance: float) -> BoolArray:
        """Tell (N,) whether each axis is met; see `Allocation.is_close`."""
        near = np.abs(self.residual) <= tolerance * self.problem.extent
        return np.asarray(near.all(axis=1))

    def to_frame(self) -> Any:
        """Return a pandas.DataFrame: status, demand and wrench of each axis, and the effectors."""
        import pandas as pd

        axes, names = self.problem.axes, self.problem.effector_names
        kind = self.problem.effector_kind.removesuffix('s')
        return pd.DataFrame({
            'status': [Status(each).name for each in self.status],
            **{f'demand_{axis}': self.demand[:, k] for k, axis in enumerate(axes)},
            **dict(zip(axes, self.wrench.T, strict=True)),
            **{f'{kind}_{name}': self.thrusts[:, i] for i, name in enumerate(names)}})

    def __repr__(self) -> str:
        """Return the counts of answers, with the problem."""
        return f'AllocationBatch: {self}; {self.problem.described}'

    def __str__(self) -> str:
        """Return how many answers there are, and of which status."""
        counts = (f'{(self.status == each).sum()} {each.name}' for each in Status)
        return f'{len(self)} answers: {", ".join(text for text in counts if text[0] != "0")}'
