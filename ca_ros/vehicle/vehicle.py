"""The vehicle: its mass and its rotors, validated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array, constant
from ca_ros.schema import ParameterError, check_given, complete
from ca_ros.vehicle.files import read
from ca_ros.vehicle.parameters import AXES, VEHICLE

HEALTH_MIN = 1e-9
"""A rotor whose health is below this counts as lost."""

ROUNDING = 1e-9
"""How far thrusts may be out of bounds, relative to the upper one or 1 N."""


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A multirotor with n rotors that are fixed to its body.

    The body frame is forward-left-up (REP 103).  Use `load` or `from_parameters`, which validate.

    Attributes
    ----------
    mass : float
        [kg]
    gravity : float
        [m/s^2]
    inertia : (3, 3) array
        About the centre of mass [kg m^2].
    arms : (n, 3) array
        Position of each rotor relative to the centre of mass [m].
    rotor_axes : (n, 3) array
        Direction of each rotor's thrust, unit vectors.
    spins : (n,) array
        Sign of each rotor's reaction torque about its axis: +1 if it turns clockwise seen from
        above, Eq. (2).
    thrust_coefficient, torque_coefficient : (n,) arrays
        k_f [kg m] and k_tau [kg m^2] of Eqs. (1)-(2), of a sound rotor.
    speed_min, speed_max : (n,) arrays
        Eq. (7) [rad/s].
    health : (n,) array
        Thrust delivered over thrust expected, in [0, 1]; below `HEALTH_MIN` the rotor is lost.
    axes : tuple of str
        The components of the wrench that are commanded, in the order of
        `ca_ros.vehicle.parameters.AXES`.
    lost_axes : 'refuse' or 'drop'
        What allocators do if the rotors cannot command every axis and hover: see
        `ca_ros.problem.audit.accept`.
    """

    mass: float
    gravity: float
    inertia: Array
    arms: Array
    rotor_axes: Array
    spins: Array
    thrust_coefficient: Array
    torque_coefficient: Array
    speed_min: Array
    speed_max: Array
    health: Array
    axes: tuple[str, ...]
    lost_axes: str = 'refuse'

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, constant(value))

    @classmethod
    def load(cls, vehicle: str | Path, node: str | None = None) -> Vehicle:
        """Read a vehicle from a parameter file.

        Only the vehicle's own parameters are checked; `ca_ros.nodes.parameters.load` checks the
        whole file.

        Parameters
        ----------
        vehicle : str or path
            A shipped vehicle's name, such as ``'hexarotor'``, or a path to a YAML file.
        node : str, optional
            Read what ROS would give this node, such as ``/uav1/allocator``; by default what it
            would give the allocator, or the only node that the file names.

        Raises
        ------
        ParameterError
            In one line that names the file, the key and the fault.
        """
        given = read(vehicle, node)
        try:
            return cls.from_parameters(given)
        except ParameterError as error:
            raise ParameterError(f'{vehicle}: {error}') from None

    @classmethod
    def from_parameters(cls, given: Mapping[str, Any]) -> Vehicle:
        """Build a vehicle from parameters by name, as in a parameter file.

        Unknown names are ignored, except in the groups ``vehicle`` and ``rotors``.

        Raises
        ------
        ParameterError
            In one line that names the key and the fault.
        """
        check_given({name: given[name] for name in given if _concerns_vehicle(name)}, VEHICLE)
        p: dict[str, Any] = complete(given, VEHICLE)
        positions = _rows('rotors.positions', p['rotors.positions'])
        n = len(positions)
        rotor_axes = _rows('rotors.axes', p['rotors.axes'])
        if len(rotor_axes) not in (1, n):
            raise ParameterError(
                f'rotors.axes: expected 3 or {3 * n} numbers for {n} rotors, got {rotor_axes.size}'
            )
        lengths = np.linalg.norm(rotor_axes, axis=1)
        if not np.all(lengths > 0.0):
            raise ParameterError('rotors.axes: an axis has length zero')
        if not isinstance(p['rotors.spins'], list) or len(p['rotors.spins']) != n:
            raise ParameterError(
                f'rotors.spins: expected {n} words, one per rotor, got {p["rotors.spins"]!r}'
            )
        speed_min, speed_max = (
            _per_rotor(p, f'rotors.speed_{bound}', n) for bound in ('min', 'max')
        )
        if np.any(speed_min > speed_max):
            i = int(np.argmax(speed_min > speed_max))
            raise ParameterError(
                f'rotors.speed_min: {speed_min[i]:g} rad/s of rotor {i + 1} is above its '
                f'rotors.speed_max, {speed_max[i]:g} rad/s'
            )
        return cls(
            mass=p['vehicle.mass'],
            gravity=p['vehicle.gravity'],
            inertia=_inertia(p['vehicle.inertia']),
            arms=positions - _vector('vehicle.center_of_mass', p['vehicle.center_of_mass']),
            rotor_axes=np.broadcast_to(rotor_axes / lengths[:, None], (n, 3)),
            spins=np.array([1.0 if spin == 'cw' else -1.0 for spin in p['rotors.spins']]),
            thrust_coefficient=_per_rotor(p, 'rotors.thrust_coefficient', n),
            torque_coefficient=_per_rotor(p, 'rotors.torque_coefficient', n),
            speed_min=speed_min,
            speed_max=speed_max,
            health=_per_rotor(p, 'rotors.health', n),
            axes=_axes(p['allocation.axes']),
            lost_axes=p['allocation.lost_axes'],
        )

    def with_health(self, health: ArrayLike) -> Vehicle:
        """Return the same vehicle with other rotor health, a scalar or (n,) in [0, 1]."""
        values = np.asarray(health, dtype=float)
        if values.shape not in ((), (self.n,)) or not np.all((values >= 0.0) & (values <= 1.0)):
            raise ParameterError(
                f'rotors.health: expected 1 or {self.n} numbers in [0, 1], got {health!r}'
            )
        return replace(self, health=np.broadcast_to(values, (self.n,)))

    @property
    def n(self) -> int:
        """Number of rotors."""
        return len(self.arms)

    @property
    def weight(self) -> float:
        """m g [N]."""
        return self.mass * self.gravity

    @cached_property
    def thrust_per_squared_speed(self) -> Array:
        """k_f of the rotors as they are, health included, (n,) [kg m]."""
        health = np.where(self.health < HEALTH_MIN, 0.0, self.health)
        return constant(health * self.thrust_coefficient)

    @property
    def powerless(self) -> bool:
        """Whether all rotors are lost."""
        return not self.thrust_max.any()

    @cached_property
    def thrust_min(self) -> Array:
        """f_min of Eq. (10), (n,) [N]; zero for a lost rotor."""
        return constant(self.thrust_per_squared_speed * self.speed_min**2)

    @cached_property
    def thrust_max(self) -> Array:
        """f_max of Eq. (10), (n,) [N]; zero for a lost rotor."""
        return constant(self.thrust_per_squared_speed * self.speed_max**2)

    def thrusts(self, speeds: ArrayLike) -> Array:
        """Return the thrusts (..., n) [N] at the given speeds (..., n) [rad/s], Eq. (1)."""
        return self.thrust_per_squared_speed * np.square(np.asarray(speeds, dtype=float))

    def speeds(self, thrusts: ArrayLike) -> Array:
        """Return the speeds (..., n) [rad/s] for thrusts (..., n) [N] in bounds, Eq. (11).

        They are within `speed_limits` to the last bit: what rounding takes beyond is put back.

        Raises
        ------
        ValueError
            If there is not one thrust a rotor, or one is out of bounds by more than rounding.
        """
        thrusts = np.asarray(thrusts, float)
        if thrusts.ndim == 1 and len(thrusts) == self.n:
            # Where caches are cold, as between two commands, this takes half as long as NumPy.
            speeds = []
            for f, (k, least, greatest, low, high) in zip(
                thrusts.tolist(), self._rotors, strict=True
            ):
                if not least <= f <= greatest:
                    break
                speed = sqrt(f / k) if f > 0.0 else low
                speeds.append(low if speed < low else high if speed > high else speed)
            else:
                return np.array(speeds)
        k, least, greatest, low, high = np.array(self._rotors).T
        if thrusts.shape[-1:] != (self.n,):
            raise ValueError(f'thrusts: expected shape (..., {self.n}), got {thrusts.shape}')
        sound = (thrusts >= least) & (thrusts <= greatest)
        if not sound.all():
            *_, i = place = tuple(np.argwhere(~sound)[0])
            raise ValueError(
                f'thrusts: {thrusts[place]:g} N of rotor {i + 1}, expected '
                f'{self.thrust_min[i]:g} to {self.thrust_max[i]:g} N'
            )
        return np.minimum(np.maximum(np.sqrt(np.maximum(thrusts, 0.0) / k), low), high)

    @cached_property
    def speed_limits(self) -> tuple[Array, Array]:
        """Least and greatest speeds of the rotors as they are, (n,) each; zero for a lost one."""
        turning = self.thrust_per_squared_speed > 0.0
        return constant(self.speed_min * turning), constant(self.speed_max * turning)

    @cached_property
    def _rotors(self) -> list[tuple[float, ...]]:
        """Of each rotor: k_f, least and greatest thrust with some rounding, and speed."""
        k_f = self.thrust_per_squared_speed
        rounding = ROUNDING * np.maximum(1.0, self.thrust_max)
        columns = (
            np.where(k_f > 0.0, k_f, 1.0),
            self.thrust_min - rounding,
            self.thrust_max + rounding,
            *self.speed_limits,
        )
        return [tuple(row) for row in np.column_stack(columns).tolist()]


def _concerns_vehicle(name: str) -> bool:
    """Return whether the group of a parameter is the vehicle's, or a misspelling of one."""
    return bool(get_close_matches(name.partition('.')[0], ('vehicle', 'rotors'), cutoff=0.8))


def _per_rotor(parameters: Mapping[str, Any], name: str, n: int) -> Array:
    value = np.asarray(parameters[name], dtype=float)
    if value.size not in (1, n) or value.ndim > 1:
        raise ParameterError(f'{name}: expected 1 or {n} numbers, one per rotor, got {value.size}')
    return np.broadcast_to(value, (n,)).copy()


def _rows(name: str, numbers: Any) -> Array:
    array = np.asarray(numbers, dtype=float)
    if array.ndim != 1 or array.size == 0 or array.size % 3:
        raise ParameterError(f'{name}: expected x, y, z per rotor, got {array.size} numbers')
    return array.reshape(-1, 3)


def _vector(name: str, numbers: Any) -> Array:
    array = np.asarray(numbers, dtype=float)
    if array.shape != (3,):
        raise ParameterError(f'{name}: expected 3 numbers, got {array.size}')
    return array


def _inertia(numbers: Any) -> Array:
    array = np.asarray(numbers, dtype=float)
    if array.shape not in ((3,), (9,)):
        raise ParameterError(f'vehicle.inertia: expected 3 or 9 numbers, got {array.size}')
    inertia = np.diag(array) if array.size == 3 else array.reshape(3, 3)
    if not np.allclose(inertia, inertia.T, rtol=1e-9, atol=0.0):
        raise ParameterError('vehicle.inertia: the matrix is not symmetric')
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0.0:
        raise ParameterError(
            f'vehicle.inertia: must be positive definite, got a principal moment of '
            f'{moments[0]:g} kg m^2'
        )
    if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        raise ParameterError(
            f'vehicle.inertia: no body has the principal moments {moments}: '
            f'the greatest exceeds the sum of the others'
        )
    return inertia


def _axes(names: Any) -> tuple[str, ...]:
    if not isinstance(names, list) or len(set(names)) != len(names) or not names:
        raise ParameterError(f'allocation.axes: expected a list of different axes, got {names!r}')
    return tuple(axis for axis in AXES if axis in names)
