"""The control allocation problem: the data that every allocator and every check uses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from functools import cache, cached_property
from math import hypot
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, BoolArray, IntArray, constant, floats
from ca_ros.problem.failures import shares_of
from ca_ros.problem.files import read_problem
from ca_ros.problem.interior import Interior
from ca_ros.problem.programs import (
    EXACT_TOLERANCE,
    BoxProgram,
    SetsProgram,
    lengths,
    program_of,
    tolerance,
)
from ca_ros.problem.supported_set import SupportedSet
from ca_ros.settings import Numbers, ParameterError
from ca_ros.solver.convex_sets import Box, ConvexSet, ConvexSets
from ca_ros.solver.least_norm_qp import meets
from ca_ros.solver.zonotope import Zonotope
from ca_ros.vehicle.fields import EFFECTORS_MAX
from ca_ros.vehicle.files import shipped_problems
from ca_ros.vehicle.validation import ABSURD, different_names, numbers, ordered_bounds, repeated

UNITS_MIN = 1e-6  # least range of an axis, also over the greatest, to judge errors

INSTEAD = {
    **dict.fromkeys(('bounds', 'limits'), 'lower and upper'), 'min': 'lower', 'max': 'upper',
    **dict.fromkeys(('names', 'effectors'), 'effector_names'),
    **dict.fromkeys(('units', 'unit'), 'effector_unit and axis_units'), 'u0': 'reference',
}
"""By a keyword that somebody may guess, what to give instead."""

Part = TypeVar('Part', bound='AllocationProblem')


class AllocationProblem:
    """Find f with u = B f and each effector in its set (Problem 1, Eqs. (8) and (10)).

    B maps the n effectors to m axes.  For a multirotor the effectors are rotors, f are their
    thrusts, and u is the wrench: `ca_ros.problem.vehicle_problem.VehicleProblem` derives its B
    from the geometry.  Here B may come from anywhere, in any units: the effectors may be control
    surfaces, thrusters or wheels, and their bounds may have any sign.

    Without `sets`, each effector is a number f_i with ``lower <= f_i <= upper``.  With them, it is
    a vector in a convex set: a rotor that tilts about one axis is a vector in a sector, a rotor on
    a gimbal one in a cone, an azimuth thruster one in a disc, and a rotor that is fixed to the
    body is a number in an interval.  f are all components of these vectors, in the order of the
    columns of B.

    Parameters
    ----------
    matrix : (m, n) array
        B, the control effectiveness matrix; with sets one column for each component.  The first
        component of a sector is along its axis.
    lower, upper : float or (n,) array
        Bounds of the effectors, instead of sets.
    axes, effector_names : sequence of str, optional
        Names of the m axes and of the effectors, all different; by default ``axis_1``, ``axis_2``
        and so on, and numbers from 1.
    reference : (m,) array, optional
        The u from which demands are counted; by default zero.  The priorities of the axes, and
        the scaling of an unattainable u, begin there.
    effector_kind, effector_unit : str
        What the effectors are called in messages, and their unit in messages and plots.
    axis_units : str or sequence of str
        The unit of all axes, or of each, in plots.
    sets : sequence of Interval or Sector, optional
        The set of each effector, with n components together.

    Attributes
    ----------
    gamma : (m, n) array
        The control allocation matrix, B [N, N m per N for a vehicle].
    sets : Box or ConvexSets
        The product of the sets; `lower` and `upper` (n,) are the least box around it.
    effector_names, bound_names : tuples of str
        The name of each component, such as ``3.1`` for the first one of effector 3, and that of
        its effector.
    resting_thrusts : (n,) array
        Of each effector the value nearest to zero: what a rejected u gets [N].
    middle, half_range : (n,) arrays
        Middles and half lengths of the ranges of the effectors [N].
    center : (m,) array
        The u of the middles: the centre of the admissible set [N, N m].
    extent : (m,) array
        Half of the range of each component [N, N m].
    health : array
        Of each effector the share of its effect that it still has; see `with_health`.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite, a lower bound is above its upper bound, names
        are missing or repeated, or the range of an axis is below 1e-6, or 1e-6 of the greatest.

    Examples
    --------
    >>> wing = AllocationProblem(
    ...     [[-4.2, 4.2], [-1.3, -1.3]], -0.5, 0.5, axes=['roll', 'pitch'],
    ...     effector_names=['right elevon', 'left elevon'])
    >>> print(Exact(wing).allocate([1.0, 0.5]))
    EXACT: roll 1, pitch 0.5

    Notes
    -----
    EXACT means that |u - B f| is at most 1e-12 max(1, |u|), with all axes together, or the
    rounding error of the sum B f if large effectors cancel each other.

    A problem is not audited: axes that the effectors cannot control independently are an error
    only where the admissible set must have a volume.
    """

    unit = ''
    """The unit of the effectors in messages, after a space."""
    sets: Any
    axis_units: tuple[str, ...] = ()
    _sound: AllocationProblem | None = None
    _stuck: Mapping[int, float] = MappingProxyType({})
    lost_axes = 'refuse'
    """What becomes of axes that are lost, if it is audited; see `ca_ros.problem.audit.accept`."""
    advice = ''
    """What the error of a set without volume recommends."""
    left_out = ''
    """What the error of a wrong number of axes says of those that are left out."""
    kept_axes: tuple[str, ...] = ()
    """Axes that no audit gives up."""
    subject, aim = 'problem', 'the reference'
    """What it is called in messages, and what its reference is."""

    def __init__(
        self, matrix: ArrayLike, lower: ArrayLike | None = None, upper: ArrayLike | None = None,
        axes: Sequence[str] | None = None, effector_names: Sequence[str] | None = None,
        reference: ArrayLike | None = None, effector_kind: str = 'effectors',
        effector_unit: str = '', axis_units: str | Sequence[str] = '',
        sets: Sequence[ConvexSet] | None = None, **unknown: NoReturn,
    ) -> None:
        for name in unknown:
            hint = INSTEAD.get(name, '')
            raise TypeError(f'AllocationProblem has no {name}{hint and "; give "}{hint}')
        gamma = _matrix(matrix)
        m, n = gamma.shape
        numbered = [f'axis_{k + 1}' for k in range(m)]
        self.axes = different_names('axes', numbered if axes is None else axes, m)
        count = n if sets is None else len(sets)
        numbered = [str(i + 1) for i in range(count)]
        given = numbered if effector_names is None else effector_names
        names = different_names('effector_names', given, count)
        if not isinstance(effector_kind, str):
            raise ValueError(f'effector_kind: expected a word, got {effector_kind!r}')
        self.effector_kind = effector_kind
        self.unit = f' {effector_unit}' if effector_unit else ''
        alike = isinstance(axis_units, str)
        self.axis_units = (axis_units,) * m if alike else tuple(map(str, axis_units))
        if len(self.axis_units) != m:
            raise ValueError(f'axis_units: expected 1 or {m}, got {len(self.axis_units)}')
        if (lower is None, upper is None) != (sets is not None,) * 2:
            raise TypeError('expected lower and upper, or sets')
        product: Box | ConvexSets
        if lower is not None and upper is not None:
            low, high = numbers('lower', lower, n), numbers('upper', upper, n)
            quoted = [repr(name) for name in names]
            ordered_bounds('lower', 'upper bound', low, high, quoted)
            product = Box(low, high)
        else:
            product = ConvexSets(sets or ())
            if product.n != n:
                raise ValueError(f'sets: expected {n} components, got {product.n}')
        start = np.zeros(m) if reference is None else numbers('reference', reference)
        if start.shape != (m,):
            raise ValueError(f'reference: expected {m} numbers, got shape {start.shape}')
        self._fill(gamma, product, start)
        self._name(names)
        self.health: Array = constant(np.ones(count))
        self._check_units()

    def _check_units(self) -> None:
        """Raise a ValueError if errors of an axis cannot be judged in its unit."""
        least = UNITS_MIN * max(1.0, float(self.extent.max()))
        if small := [k for k in range(len(self.axes)) if 0.0 < self.extent[k] < least]:
            greatest = float(self.extent.max())
            beside = f' beside the greatest, {greatest:.3g}' if greatest > 1.0 else ''
            raise ValueError(
                f'matrix: half of the range of {self.axes[small[0]]} is '
                f'{self.extent[small[0]]:.3g}, too small{beside}: choose units in which it is at '
                f'least {least:.3g}'
            )

    @classmethod
    def load(cls, name: str | Path) -> AllocationProblem:
        """Read the allocation problem in a file, without the settings of the methods.

        Raises a ParameterError in one line that names the file, the entry and the fault.

        `name`: a shipped problem, such as ``'admire'``, or a path to a YAML file.
        """
        found = read_problem(name, cls)
        if found is None:
            raise ParameterError(
                f"{name}: no entry 'problem'; shipped problems are "
                f'{", ".join(shipped_problems())}, and Vehicle.load reads the files of vehicles'
            )
        return found[0]

    def _fill(self, gamma: Array, sets: Box | ConvexSets, reference: Array) -> None:
        """Set the numbers, which are sound, and what follows from them."""
        self.gamma, self.reference, self.sets = constant(gamma), constant(reference), sets
        self.lower, self.upper = constant(sets.lower), constant(sets.upper)
        self.middle, self.half_range = constant(sets.middle), constant(sets.half_range)
        self._shape = (len(gamma),)
        self.center, self.extent = map(constant, sets.image(self.gamma))

    def _name(self, names: Sequence[str]) -> None:
        """Name the components by the names of the effectors."""
        self.effector_names = self.bound_names = tuple(names)
        if self.sets.n > len(names):
            pairs = [(name, each.size) for name, each in zip(names, self.sets.sets, strict=True)]
            self.bound_names = tuple(name for name, size in pairs for _ in range(size))
            self.effector_names = tuple(
                name if size == 1 else f'{name}.{k + 1}'
                for name, size in pairs for k in range(size)
            )

    @cached_property
    def resting_thrusts(self) -> Array:
        """The components (n,) within the sets that are nearest to zero [N]."""
        return constant(self.sets.project(np.zeros(self.sets.n)))

    @cached_property
    def program(self) -> BoxProgram | SetsProgram:
        """The programs over the sets."""
        return program_of(self.gamma, self.sets, self.center, self.extent)

    @cached_property
    def interior(self) -> Interior:
        """The inside of the admissible set, with the reference."""
        return Interior(self.program, self.reference)

    @property
    def box(self) -> BoxProgram:
        """The programs over numbers within bounds; a TypeError if effectors are vectors."""
        return self.program.box

    def check_bounds(self, lower: ArrayLike, upper: ArrayLike) -> tuple[Array, Array]:
        """Return bounds (n,) within those of the problem [N].

        Raises a ValueError if a number is not finite, there is another number of them, a lower
        bound is above its upper bound, or effectors are vectors.
        """
        self.program.refuse_vectors('allocate_within', 'within_rates takes them')
        least, most = self.box.sets.lower, self.box.sets.upper
        low, high = (numbers(name, given, self.n) for name, given in (
            ('lower', lower), ('upper', upper)))
        kind = self.effector_kind.removesuffix('s')
        names = [f'{kind} {name}' for name in self.effector_names]
        ordered_bounds('lower', 'upper bound', low, high, names)
        return np.clip(low, least, most), np.clip(high, least, most)

    def bounded(self, lower: Array, upper: Array) -> AllocationProblem:
        """Return the problem with other bounds (n,) [N]; a TypeError if effectors are vectors."""
        other, _ = AllocationProblem.__new__(AllocationProblem), self.box
        for name in ('axes', 'effector_names', 'bound_names', 'effector_kind', 'unit',
                     'axis_units', 'health'):
            setattr(other, name, getattr(self, name))
        other._fill(self.gamma, Box(lower, upper), self.reference)
        return other

    def _copy(self: Part) -> Part:
        """Return a copy without what was worked out."""
        made = copy(self)
        kind: Any = type(self)
        for name in _worked_out(kind):
            vars(made).pop(name, None)
        return made

    def with_matrix(self, matrix: ArrayLike) -> AllocationProblem:
        """Return the problem with another matrix, for the same axes, effectors and bounds.

        Failures stay: see `with_health`.

        Parameters
        ----------
        matrix : (m, n) array
            B, the control effectiveness matrix.

        Raises
        ------
        ValueError
            If the shape is another one, a number is not finite, or the range of an axis is too
            small.
        TypeError
            If the matrix is that of a vehicle, which follows from its rotors.
        """
        gamma = numbers('matrix', matrix)
        if gamma.shape != self.gamma.shape:
            raise ValueError(
                f'matrix: expected shape {self.gamma.shape}, one row per axis and one column per '
                f'effector, got {gamma.shape}'
            )
        sound = self._sound or self
        made = sound._copy()
        made._fill(gamma, sound.sets, sound.reference)
        made._check_units()
        return made if self._sound is None else made.with_health(self.health, stuck=self._stuck)

    def with_health(
        self, health: ArrayLike, failed_arms: Iterable[tuple[int, int]] = (),
        stuck: Mapping[int, float] | None = None,
    ) -> AllocationProblem:
        """Return the problem after failures of its effectors, which replace those before.

        Parameters
        ----------
        health : array
            Share of its effect that each effector still has, in [0, 1]: its columns of B are
            multiplied by it.  Without health an effector rests: it stays at the value within its
            bounds that is nearest to zero.
        failed_arms : pairs of int, optional
            Of a vehicle alone; see `Vehicle.with_health`.
        stuck : mapping of int to float, optional
            Effectors that do not move any more, from 1 on, and the value at which each stays; by
            default those that are stuck already.

        Raises
        ------
        ParameterError
            If the health is not one number for each effector in [0, 1], or an effector cannot
            stick there.
        """
        sound = self._sound or self
        if tuple(failed_arms):
            raise ParameterError('failed_arms: only vehicles have coaxial pairs of rotors')
        shares = shares_of(health, len(sound.sets.first))
        stuck = self._stuck if stuck is None else stuck
        if (shares == 1.0).all() and not stuck:
            return sound
        sets = sound.program.sets_after(
            shares, stuck, sound.resting_thrusts, sound.effector_names)
        made = sound._copy()
        made._fill(sound.gamma * shares[sets.owners], sets, sound.reference)
        made._sound, made._stuck, made.health = sound, dict(stuck), constant(shares)
        return made

    def dropping(self: Part) -> Part:
        """Return the problem so that no allocator refuses it: itself, unless it has a vehicle."""
        return self

    def part(self: Part, axes: Sequence[str]) -> Part:
        """Return the problem of some of its axes, for the same effectors."""
        rows, made = [self.axes.index(axis) for axis in axes], self._copy()
        if self._sound is not None:
            made._sound = self._sound.part(axes)
        made.axes, made._shape = tuple(axes), (len(rows),)
        made.axis_units = tuple(self.axis_units[row] for row in rows)
        for name in 'gamma', 'reference', 'center', 'extent':
            setattr(made, name, constant(getattr(self, name)[rows]))
        return made

    def scaled(self, u: Array) -> Array:
        """Return wrenches (..., m) relative to the centre and half ranges of the axes."""
        return (u - self.center) / self.extent

    def reach(self, start: Array, direction: Array, limit: float = np.inf) -> float:
        """Return the greatest t <= limit for which ``start + t direction`` is attainable.

        `start` (m,) is in the admissible set; `direction` (m,) [N, N m].  Raises a ValueError if
        the set has no volume.
        """
        self.check_volume()
        return self.program.reach(start, direction, limit)

    @property
    def matrix(self) -> Array:
        """B (m, n), the same as `gamma`."""
        return self.gamma

    @property
    def n(self) -> int:
        """Number of effectors."""
        return len(self.lower)

    @property
    def failed(self) -> bool:
        """Whether an effector has failed."""
        return self._sound is not None

    @property
    def powerless(self) -> bool:
        """Whether no effector can give anything."""
        return not (self.gamma * self.half_range).any()

    @property
    def impaired(self) -> IntArray:
        """1 for each effector (n,) whose upper bound is lowered by its health, else 0."""
        return np.zeros(self.n, dtype=np.int32)

    @property
    def rates(self) -> tuple[Array, Array] | None:
        """The greatest rates (n,) at which commands grow and shrink in size; None without."""
        return None

    @property
    def turning_rates(self) -> Array:
        """The greatest rates (k,) of servos, zero where none is given [rad/s]."""
        return np.zeros(0)

    @property
    def command_limits(self) -> tuple[Array, Array]:
        """The least and greatest commands (n,): of effectors they are their values."""
        return self.lower, self.upper

    def command(self, thrusts: Array) -> Array:
        """Return the commands (..., n) that give effectors (..., n), within their bounds."""
        return self.clip(thrusts)

    def commanded(self, commands: Array) -> Array:
        """Return the effectors (..., n) that commands (..., n) give."""
        return commands

    @property
    def shared(self) -> Array:
        """Effectors (n,) that share the reference among them, whatever their bounds."""
        return np.array(np.linalg.pinv(self.gamma) @ self.reference)

    def margin(self, u: Array) -> float:
        """Return the signed distance of a wrench (m,) to the boundary of `attainable_set`.

        It is positive inside, and -inf if the set has no volume [N, N m].
        """
        return float(self.attainable_set.margin(u)) if self.interior.has_volume else -np.inf

    @property
    def attainable_set(self) -> Zonotope | SupportedSet:
        """The admissible set A of Eq. (23); a ValueError if it has no volume."""
        self.check_volume()
        return self.program.attainable_set

    @property
    def described(self) -> str:
        """The number of effectors and the axes, in words."""
        return f'{len(self.sets.first)} {self.effector_kind}, axes {", ".join(self.axes)}'

    def __repr__(self) -> str:
        """Return the problem in one line."""
        return f'{type(self).__name__}: {self.described}'

    def check_volume(self) -> None:
        """Raise a ValueError if the admissible set has no volume."""
        if not self.interior.has_volume:
            raise ValueError(
                f'the admissible set has no volume: the {self.effector_kind} cannot control '
                f'{", ".join(self.axes)} independently{self.advice}'
            )

    def check(self, u: ArrayLike, batch: bool = False, name: str = 'wrench') -> Array:
        """Return wrenches as an (m,) array of floats, or (..., m) if `batch`.

        Raises a ValueError if the shape is wrong or a component is not finite.
        """
        try:
            wrench = floats(u)
        except (TypeError, ValueError):
            given = ' '.join(repr(u).split())
            raise ValueError(
                f'{name}: expected {len(self.axes)} numbers ({", ".join(self.axes)}), got {given}'
            ) from None
        if wrench.shape == self._shape:
            # For a single wrench, math.hypot is faster than NumPy.
            if hypot(*wrench.tolist()) <= ABSURD:
                return wrench
        elif not (batch and wrench.shape[-1:] == self._shape):
            expected = f'(..., {len(self.axes)})' if batch else f'({len(self.axes)},)'
            many = '; allocate_batch takes many' if wrench.shape[1:] == self._shape else ''
            raise ValueError(
                f'{name}: expected shape {expected} ({", ".join(self.axes)}), got '
                f'{wrench.shape}{many}{self.left_out}'
            )
        sound = np.abs(wrench) <= ABSURD
        if not sound.all():
            bad = np.argwhere(~sound)[0]
            raise ValueError(
                f'{name}: {self.axes[bad[-1]]} is {wrench[tuple(bad)]}, expected finite numbers '
                f'up to {ABSURD:g}'
            )
        return wrench

    def spread(self, name: str, value: Numbers, along: bool = False) -> Array:
        """Return the numbers (n,) of a setting that has one for all effectors, or one for each.

        All components of a vector have the same, or only that `along` its axis.  Raises a
        ParameterError if there is another number of them.
        """
        each = repeated(name, value, len(self.sets.first))[self.sets.owners]
        return np.where(self.sets.leading, each, 0.0) if along else each

    def saturation(self, thrusts: Array, bounds: tuple[Array, Array] | None = None) -> IntArray:
        """Return (..., k) -1 at the least and +1 at the greatest size, to rounding; 0 between.

        `bounds`: those of an answer instead of those of the problem, (n,) each.
        """
        sets = self.sets if bounds is None else Box(*bounds)
        return sets.at_bounds(thrusts, EXACT_TOLERANCE)

    def clip(self, thrusts: Array) -> Array:
        """Return thrusts (..., n) within their bounds, Eq. (13), or the nearest of the sets."""
        return self.sets.project(thrusts)

    def residual(self, demands: Array, thrusts: Array) -> Array:
        """Return demands (..., m) minus the wrenches that thrusts (..., n) give [N, N m]."""
        # Unlike a matrix product, einsum gives the same digits for any number of wrenches.
        return demands - np.einsum('...j,kj->...k', thrusts, self.gamma)

    def violation(self, thrusts: Array) -> Array:
        """Return how far thrusts (..., n) are outside their bounds at most, (...) [N]."""
        return np.abs(thrusts - self.clip(thrusts)).max(axis=-1)

    def tolerance(self, u: Array) -> Array:
        """Return the residual (...) up to which wrenches (..., m) count as exact [N, N m].

        A residual within the rounding error of Gamma f counts as exact too: see `is_exact`.
        """
        return tolerance(u)

    def is_exact(self, u: Array, thrusts: Array, share: float = 1.0) -> BoolArray:
        """Tell (...) whether thrusts (..., n) produce wrenches (..., m) exactly.

        The residual is at most a `share` of ``1e-12 max(1, |u|)``, or of the rounding error of
        the sum Gamma f, which is greater where large thrusts cancel each other.
        """
        residual = lengths(u - thrusts @ self.gamma.T)
        return meets(residual, self.tolerance(u), self.gamma, thrusts, share)


@cache
def _worked_out(kind: type[AllocationProblem]) -> list[str]:
    """Return the names of the cached properties of a class."""
    return [name for name in dir(kind) if isinstance(getattr(kind, name), cached_property)]


def _matrix(matrix: ArrayLike) -> Array:
    """Return Gamma (m, n); raise a ValueError if it is no matrix or too large."""
    gamma = numbers('matrix', matrix)
    if gamma.ndim != 2 or 0 in gamma.shape:
        raise ValueError(
            f'matrix: expected m rows, one per axis, of n numbers, one per effector; '
            f'got shape {gamma.shape}'
        )
    if (n := gamma.shape[1]) > EFFECTORS_MAX:
        raise ValueError(f'matrix: expected up to {EFFECTORS_MAX} effectors, got {n}')
    return gamma
