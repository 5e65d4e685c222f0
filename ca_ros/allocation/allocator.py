"""The interface that all allocation methods share, and the method without rotors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.result import Allocation, AllocationBatch, Status
from ca_ros.arrays import Array
from ca_ros.problem.audit import Audit, accepted, audit
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import vehicle_of
from ca_ros.settings import ParameterError, Settings, settings_of
from ca_ros.vehicle.validation import counts
from ca_ros.vehicle.vehicle import Vehicle

UNLIMITED = 1e9  # a rate that does not limit [rad/s^2, rad/s]


class Allocator(ABC):
    """Distributes a wrench among the rotors of a vehicle, or u among the effectors of a problem.

    A method is a subclass that implements `_allocate`, and `_set_up` for what all its answers
    share.  The result depends only on the wrench, not on earlier wrenches.  A method with settings
    declares them in a subclass of `Settings`, its `settings_type`.  In the file of a vehicle and
    on a node they are ``allocation.METHOD.NAME``, where METHOD is the name in `ALLOCATORS`, or
    ``Class`` for one's own ``module:Class``.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem
        A vehicle is audited (`ca_ros.problem.audit.accept`); a problem is not, unless effectors
        fail (`with_health`).
    settings : Settings, optional
        Of the class `settings_type`.
    **given
        The same one by one, by keyword: ``Exact(vehicle, policy='scale')``.

    Attributes
    ----------
    problem : AllocationProblem
    settings : Settings

    Raises
    ------
    ParameterError
        If the vehicle cannot control every axis or cannot hover, and its `lost_axes` is 'refuse',
        or a setting is wrong.
    TypeError
        If the method has no such setting.
    """

    settings_type: ClassVar[type[Settings]] = Settings
    """The class of the settings."""
    settings: Any
    solves: ClassVar[str] = ''
    """For the table in docs/parameters.md; if empty, it has the first line of the docstring."""
    guarantees: ClassVar[str] = 'the bounds'
    """What holds for every result, for the same table."""
    takes_vectors: ClassVar[bool] = False
    """Whether the effectors may be vectors in sets, see `AllocationProblem`."""
    keeps_tilt_rates: ClassVar[bool] = False
    """Whether the settings are those of `exact`, which `TiltLimited` takes."""
    engine: str = 'NumPy'
    """What works out the thrusts."""
    missed: Status = Status.INEXACT
    """The status of an answer that misses only axes that the method left out; see `Reduced`."""

    def __init__(
        self, problem: Vehicle | AllocationProblem, settings: Settings | None = None, /,
        **given: Any,
    ) -> None:
        if 'lost_axes' in given and not hasattr(self.settings_type, 'lost_axes'):
            raise TypeError('lost_axes: make_allocator takes it; with_health keeps all axes')
        self.problem = accepted(problem)
        self.settings = settings_of(type(self), self.settings_type, settings, given)
        if not self.takes_vectors:
            self.problem.program.refuse_vectors(
                type(self).__name__,
                'exact, pseudo_inverse, weighted_pseudo_inverse and weighted_least_squares take '
                'both')
        self._set_up()

    def __repr__(self) -> str:
        """Return method, problem, engine and the settings other than the defaults."""
        values = vars(self.settings) if isinstance(self.settings, Settings) else {}
        usual = vars(type(self.settings)()) if values else {}
        other = [f'{name}={value!r}' for name, value in values.items() if value != usual[name]]
        return ', '.join([
            f'{type(self).__name__}: {self.problem.described}', f'engine {self.engine}', *other])

    @classmethod
    def suited(cls, report: Audit, settings: Any) -> tuple[AllocationProblem, Any]:
        """Return the problem and the settings of the method for what an audit left of a vehicle.

        A method serves the axes that the rotors can still control independently.
        """
        return report.independent, settings

    @cached_property
    def audit(self) -> Audit:
        """The audit of the vehicle, or of the problem, as it is."""
        return audit(self.problem)

    @property
    def lost_axes(self) -> tuple[str, ...]:
        """The axes of the problem that are lost; see `ca_ros.audit`."""
        return self.audit.lost

    def with_health(
        self, health: ArrayLike, failed_arms: Iterable[tuple[int, int]] = (),
        stuck: Mapping[int, float] | None = None,
    ) -> Allocator:
        """Return an allocator of the same method and settings after failures of the effectors.

        The wrench keeps its axes, those of `problem`.  Axes that are lost with this health leave
        the demand before the policies 'scale' and 'reject' act, and are served last by
        'prioritize'; see `lost_axes`.  An answer is EXACT only if all axes are met.  Without any
        effector all answers are at rest and INEXACT.

        Parameters
        ----------
        health : array
            Share of its thrust that each rotor still gives, or of its effect that each effector of
            a problem still has, in [0, 1]; see `AllocationProblem.with_health`.  It replaces the
            health before: all ones give the allocator without failures again.
        failed_arms : pairs of int, optional
            Coaxial pairs of which one rotor has failed, and which one is unknown: see
            `Vehicle.with_health`.
        stuck : mapping of int to float, optional
            Effectors that stick, from 1 on, and the value at which each stays; of a vehicle the
            rotors whose servos stick, and the angles [rad].  By default those that stick already.

        Returns
        -------
        Allocator

        Raises
        ------
        ParameterError
            If the health is not one number for each effector in [0, 1], an arm is wrong, or an
            effector cannot stick there.

        Examples
        --------
        >>> allocator = Exact(Vehicle.load('hexarotor')).with_health([0, 1, 1, 1, 1, 1])
        >>> allocator.lost_axes
        ('yaw',)
        >>> print(allocator.allocate([9.81, 0.1, 0.0, 0.0]))
        PRIORITIZED: thrust 9.81, roll 0.1, pitch 0, yaw -0.0024 of 0
        """
        return self._for(self.problem.with_health(health, failed_arms, stuck))

    def fail(self, effector: int, health: float = 0.0) -> Allocator:
        """Return an allocator after one more failure, of an effector or rotor from 1 on.

        `health`: what it still gives, in [0, 1]; that of all others stays.  See `with_health`,
        which raises the errors.

        >>> Exact(Vehicle.load('hexarotor')).fail(1).lost_axes
        ('yaw',)
        """
        now = self.problem.health
        if not counts(effector, len(now)):
            kind = self.problem.effector_kind
            raise ParameterError(f'no {effector!r} of {kind}: they count from 1 to {len(now)}')
        return self.with_health(np.where(np.arange(len(now)) == effector - 1, health, now))

    def with_matrix(self, matrix: ArrayLike) -> Allocator:
        """Return an allocator of the same method and settings for another matrix B.

        It is for effectiveness that changes in operation, such as that of control surfaces with
        the airspeed.  Axes, bounds and failures stay.

        Parameters
        ----------
        matrix : (m, n) array
            See `AllocationProblem.with_matrix`.

        Returns
        -------
        Allocator

        Raises
        ------
        ValueError
            If the matrix has another shape, or does not suit the method.
        TypeError
            If the problem is that of a vehicle.

        Examples
        --------
        >>> slow = AllocationProblem([[1.0, -1.0], [0.5, 0.5]], -0.4, 0.4)
        >>> fast = Exact(slow).with_matrix(2.0 * slow.gamma)
        >>> fast.allocate([0.6, 0.2]).effectors
        array([ 0.25, -0.05])
        """
        return self._for(self.problem.with_matrix(matrix))

    def _for(self, problem: AllocationProblem) -> Allocator:
        """Return the same method for another state of the problem."""
        from ca_ros.allocation import after_failures

        return after_failures(type(self), problem, self.settings)

    def within_rates(
        self, rates: ArrayLike | None = None, braking: ArrayLike | None = None
    ) -> Any:
        """Return what allocates within what the effectors reach from the last command on.

        Its ``allocate(u, last, period)`` is pure; see `SlewLimited`.  For vehicles whose rotors
        tilt it is ``allocate(u, speeds, angles, period)`` of a `TiltLimited`, of `exact` alone;
        the servos turn at ``rotors.tilt_rate_max``.

        Parameters
        ----------
        rates, braking : float or (n,) array, optional
            Greatest rates at which effectors grow and shrink [rad/s^2 for rotor speeds]; by
            default those of the vehicle's file.

        Raises
        ------
        ValueError
            If there are no rates, or they are not positive.
        """
        from ca_ros.allocation import SlewLimited

        tilting = len(self.problem.turning_rates) > 0
        found = self.limited(rates, braking) if rates is None or tilting else None
        if found is None and tilting:
            raise ValueError('rates: the vehicle has no rotors.acceleration_max; give rates')
        return found or SlewLimited(self, rates, braking)

    def limited(self, rates: ArrayLike | None = None, braking: ArrayLike | None = None) -> Any:
        """Return what allocates within the rates of the effectors; None if there are none.

        Raises a ParameterError if rotors tilt, and the method does not keep their rates.

        `rates`, `braking`: of the rotors, instead of those of the vehicle.
        """
        from ca_ros.allocation import SlewLimited, TiltLimited

        pair: Any = self.problem.rates
        if rates is not None:
            pair = rates, rates if braking is None else braking
        turning = self.problem.turning_rates
        if pair is None and not turning.any():
            return None
        if not len(turning):
            return SlewLimited(self, *pair)
        if not self.keeps_tilt_rates:
            raise ParameterError(
                f'rotors.acceleration_max, rotors.tilt_rate_max: {type(self).__name__} does not '
                'keep the rates of rotors that tilt; exact does'
            )
        up, down = (UNLIMITED, UNLIMITED) if pair is None else pair
        turning = np.where(turning > 0.0, turning, UNLIMITED)
        return TiltLimited(vehicle_of(self.problem), up, turning, self.settings, down)

    def _set_up(self) -> None:  # noqa: B027 (most methods need it, not all)
        """Work out what all answers share, from `problem` and `settings`."""

    def allocate(self, u: ArrayLike) -> Allocation:
        """Allocate one wrench.

        Parameters
        ----------
        u : (m,) array
            Demanded wrench [N, N m]; for the usual four axes (thrust, tau_x, tau_y, tau_z).

        Returns
        -------
        Allocation
            If the wrench is not attainable, `status` says what the method did instead.

        Raises
        ------
        ValueError
            If `u` is not m finite numbers.
        """
        return self._allocate(self.problem.check(u))

    def allocate_within(self, u: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Allocation:
        """Allocate one wrench within narrower bounds, such as what the rotors reach in time.

        Parameters
        ----------
        u : (m,) array
            As in `allocate`.
        lower, upper : float or (n,) array
            Bounds of the effectors for this wrench [N]; those of the problem hold as well.

        Returns
        -------
        Allocation
            With its `bounds`.  If effectors that cannot move do not give u, it is INEXACT.

        Raises
        ------
        ValueError
            If u, or a bound, is not finite or has a wrong shape, or a bound is above the other.
        """
        problem = self.problem
        lower, upper = problem.check_bounds(lower, upper)
        moved = problem.bounded(lower, upper)
        if moved.interior.has_volume:
            answer = type(self)(moved, self.settings).allocate(u)
        else:
            demand, thrusts = moved.check(u), moved.clip(moved.middle)
            answer = Allocation(moved, demand, thrusts, self._status(demand, thrusts))
        return replace(answer, problem=problem, bounds=(lower, upper))

    def allocate_batch(self, wrenches: ArrayLike) -> AllocationBatch:
        """Allocate N wrenches (N, m) [N, N m]; the fields of the result have a leading N."""
        demands = self.problem.check(wrenches, batch=True)
        if demands.ndim != 2:
            m = len(self.problem.axes)
            one = '; allocate takes one' if demands.ndim == 1 else ''
            raise ValueError(f'wrenches: expected shape (N, {m}), got {demands.shape}{one}')
        return self._allocate_batch(demands)

    @abstractmethod
    def _allocate(self, u: Array) -> Allocation:
        """Allocate one checked wrench."""

    def _allocate_batch(self, demands: Array) -> AllocationBatch:
        answers = [self._allocate(u) for u in demands]
        thrusts = np.array([a.thrusts for a in answers]).reshape(len(demands), self.problem.n)
        status = np.array([Status(a.status) for a in answers], dtype=np.int8)
        level, violation = (
            np.array([getattr(a, name) for a in answers], dtype=float)
            for name in ('level', 'violation')
        )
        return AllocationBatch(self.problem, demands, thrusts, status, level, violation)

    def _status(self, u: Array, thrusts: Array) -> Status:
        return Status.EXACT if self.problem.is_exact(u, thrusts) else Status.INEXACT

    def _clipped(self, u: Array, wanted: Array) -> Allocation:
        """Return the allocation of thrusts (n,) that are clipped to their bounds, Eq. (13).

        If they are NaN, because there are none, the wrench is rejected.
        """
        thrusts = self.problem.sets.saturate(wanted)
        violation = float(np.abs(wanted - thrusts).max())
        if violation != violation:
            rest = self.problem.resting_thrusts.copy()
            return Allocation(self.problem, u, rest, Status.REJECTED, level=0.0)
        return Allocation(self.problem, u, thrusts, self._status(u, thrusts), violation=violation)


class AtRest(Allocator):
    """Leaves all effectors at rest for every wrench, with the status INEXACT."""

    takes_vectors = True

    def limited(self, rates: ArrayLike | None = None, braking: ArrayLike | None = None) -> None:
        """Return None: effectors at rest have no rates."""

    def _allocate(self, u: Array) -> Allocation:
        thrusts = self.problem.resting_thrusts.copy()
        return Allocation(self.problem, u, thrusts, Status.INEXACT, level=0.0)
