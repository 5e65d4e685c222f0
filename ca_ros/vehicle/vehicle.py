"""The vehicle: its mass and where its rotors are, and what is left of them after failures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ca_ros.arrays import Array, constant, is_constant, same
from ca_ros.setting_names import check_given
from ca_ros.settings import MissingParameterError, ParameterError, read, table
from ca_ros.vehicle import files
from ca_ros.vehicle.coaxial import coaxial_partners
from ca_ros.vehicle.fields import fields_of
from ca_ros.vehicle.keywords import flat, parameters_of, ring_spins, with_rows
from ca_ros.vehicle.motors import Motors
from ca_ros.vehicle.saving import file_text
from ca_ros.vehicle.servos import Servos
from ca_ros.vehicle.settings import (
    AXES,
    AxesSettings,
    BodySettings,
    MovingVehicleSettings,
    RotorSettings,
    VehicleSettings,
)
from ca_ros.vehicle.validation import counts, health_of


@dataclass(frozen=True, eq=False, init=False, repr=False, kw_only=True)
class Vehicle(Motors):
    """A multirotor with n rotors, fixed to its body or tilting.

    The body frame is forward-left-up (REP 103).  `load` reads a file, `ring` places rotors on a
    circle, `from_parameters` takes parameters by name.

    Parameters
    ----------
    mass : float
        [kg]
    positions : (n, 3) array
        x, y, z of each rotor, forward-left-up [m].
    spins : sequence of 'cw' or 'ccw'
        Sense of rotation of each rotor, seen from above.
    yaw_torque_signs : sequence of 1 or -1, optional
        Instead of `spins`: 1 for a rotor whose drag turns the vehicle to the left (positive yaw).
    thrust_coefficient, torque_coefficient : float or (n,) array
        k_f [kg m] and k_tau [kg m^2] of Eqs. (1)-(2): thrust and torque over squared speed.
    speed_min, speed_max : float or (n,) array
        Bounds of the rotor speeds, Eq. (7) [rad/s]; below zero for rotors that reverse.
    inertia : (3,) or (3, 3) array, optional
        About the centre of mass [kg m^2]; an allocator does without.
    axes : sequence of str, optional
        The commanded components of the wrench; by default thrust, roll, pitch and yaw.
    rotor_axes : (3,) or (n, 3) array, optional
        Directions of the thrusts; by default upwards.
    **others
        Any other of the parameters ``vehicle.*``, ``rotors.*`` and `lost_axes`, by the last part
        of its name: ``gravity``, ``center_of_mass``, ``health``, ``tilt_axes``, ...

    Raises
    ------
    ParameterError
        If a value is missing, wrong, or has an unknown name.

    Examples
    --------
    >>> vehicle = Vehicle(
    ...     mass=1.0, positions=[(0.2, 0.2, 0), (-0.2, 0.2, 0), (-0.2, -0.2, 0), (0.2, -0.2, 0)],
    ...     spins=['cw', 'ccw', 'cw', 'ccw'], thrust_coefficient=2.5e-5,
    ...     torque_coefficient=5e-7, speed_min=40.0, speed_max=400.0)
    >>> vehicle
    Vehicle: 4 rotors, 1 kg, axes thrust, roll, pitch, yaw

    Notes
    -----
    Attributes:

    - `mass` [kg], `gravity` [m/s^2] and `buoyancy` [N]
    - `inertia` (3, 3): about the centre of mass [kg m^2]; None is enough for an allocator
    - `arms` (n, 3): position of each rotor relative to the centre of mass [m]
    - `rotor_axes` (n, 3): direction of each rotor's thrust, unit vectors
    - `spins` (n,): sign of each rotor's reaction torque about its axis: +1 if it turns clockwise
      seen from above, Eq. (2)
    - `thrust_coefficient` and `torque_coefficient` (n,): k_f [kg m] and k_tau [kg m^2] of Eqs.
      (1)-(2), of a sound rotor that turns forwards
    - `thrust_coefficient_reverse` (n,): k_f of a rotor that turns backwards [kg m]; its k_tau
      differs by the same factor
    - `speed_min` and `speed_max` (n,): Eq. (7) [rad/s].  A rotor with a negative lower bound can
      reverse: its thrust is k_f |omega| omega
    - `health` (n,): thrust delivered over thrust expected, in [0, 1]; below `HEALTH_MIN` the rotor
      is lost
    - `failed_arms`: see `with_health`
    - `axes`: the commanded components of the wrench, in the order of `AXES`
    - `lost_axes`: see `AxesSettings` and `ca_ros.problem.audit.accept`
    - `curve`: of all rotors, in the ratio of their k_f.  The reaction torque is k_tau / k_f times
      the thrust
    - `speed_max_per_volt` (n,) or 0: speed of full throttle per volt of the battery [rad/s/V]; 0:
      the voltage does not matter
    - `nominal_voltage`: of the battery [V].  Without `rotors.battery_voltage` it is the least one
      at which all rotors reach `speed_max`
    - `voltage`: of the battery, if `at_voltage` was told [V]
    - `rated`: the bounds (n,) of the speeds whatever the voltage is, if it is given [rad/s]
    - `servos`: of rotors that tilt; there are none if all are fixed to the body
    - `acceleration_max` and `deceleration_max` (n,): greatest rates at which the rotor speeds grow
      and shrink [rad/s^2]; None for no limit, or for a deceleration like the acceleration.  See
      `ca_ros.SlewLimited`
    """

    mass: float
    gravity: float
    buoyancy: float
    inertia: Array | None
    arms: Array
    rotor_axes: Array
    spins: Array
    torque_coefficient: Array
    axes: tuple[str, ...]
    servos: Servos
    failed_arms: tuple[tuple[int, int], ...] = ()
    lost_axes: str = 'refuse'

    def __init__(
        self, *unnamed: NoReturn, mass: float | None = None, positions: ArrayLike | None = None,
        spins: Any = None, thrust_coefficient: ArrayLike | None = None,
        torque_coefficient: ArrayLike | None = None, speed_min: ArrayLike | None = None,
        speed_max: ArrayLike | None = None, yaw_torque_signs: ArrayLike | None = None,
        inertia: ArrayLike | None = None, axes: Sequence[str] | None = None, **others: Any,
    ) -> None:
        if unnamed:
            raise TypeError(
                f'Vehicle takes keywords alone, such as Vehicle(mass=1.0, positions=..., '
                f'spins=..., ...); got {len(unnamed)} values without a name'
            )
        given = {
            'mass': mass, 'spins': spins, 'thrust_coefficient': thrust_coefficient,
            'torque_coefficient': torque_coefficient, 'speed_min': speed_min,
            'speed_max': speed_max, 'inertia': inertia, 'axes': axes, **others}
        if {'arms', 'servos'} <= others.keys():
            # The attributes themselves, as `dataclasses.replace` passes them on.
            self.__dict__.update(given)
            self._freeze()
            return
        if yaw_torque_signs is not None and spins is not None:
            raise ParameterError('yaw_torque_signs: given beside spins; expected one of them')
        given |= {'positions': positions, 'yaw_torque_signs': yaw_torque_signs}
        built = type(self).from_parameters(parameters_of(given))
        self.__dict__.update(vars(built))

    def _freeze(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray) and not is_constant(value):
                object.__setattr__(self, name, constant(value))

    @classmethod
    def ring(
        cls, *, count: int, radius: float, first_angle: float = 0.0, height: float = 0.0,
        spins: Sequence[str] | None = None, yaw_torque_signs: ArrayLike | None = None,
        **others: Any,
    ) -> Vehicle:
        """Return a vehicle with its rotors on a circle, symmetric to the last bit.

        The rotors are numbered counter-clockwise, seen from above; by default they turn clockwise
        and counter-clockwise in turn, the first one clockwise.  Raises what the class raises.

        - `count`: number of rotors
        - `radius` and `height`: of the circle [m]
        - `first_angle`: of the first rotor, from forward to the left [degrees]
        - `yaw_torque_signs`, `others`: keywords of the class

        >>> Vehicle.ring(
        ...     count=6, radius=0.4, mass=1.0, thrust_coefficient=2.5e-5, torque_coefficient=5e-7,
        ...     speed_min=40.0, speed_max=400.0)
        Vehicle: 6 rotors, 1 kg, axes thrust, roll, pitch, yaw
        """
        circle = {
            'count': count, 'radius': radius, 'first_angle': first_angle, 'height': height}
        if not counts(count):
            raise ParameterError(f'count: expected a number of rotors such as 6, got {count!r}')
        if yaw_torque_signs is None:
            spins = ring_spins(count, spins)
        return cls(spins=spins, yaw_torque_signs=yaw_torque_signs, ring=circle, **others)

    @classmethod
    def load(cls, vehicle: str | Path, node: str | None = None) -> Vehicle:
        """Read a vehicle from a parameter file.

        Only the vehicle's own parameters are checked; `ca_ros.parameter_files.load` checks the
        whole file.  Settings of methods, such as ``allocation.exact.policy``, are for nodes,
        studies and firmware: `make_allocator` takes them by keyword.  Raises a ParameterError that
        names the file, the key and the fault.

        `vehicle` and `node`: see `ca_ros.vehicle.files.read`.
        """
        given = files.read(vehicle, node)
        try:
            return cls.from_parameters(given)
        except ParameterError as error:
            raise ParameterError(f'{vehicle}: {error}') from None

    @classmethod
    def from_text(cls, text: str) -> Vehicle:
        """Build a vehicle from the text of a parameter file; see `load`."""
        if not isinstance(text, str):
            raise TypeError(f'expected the text of a parameter file, got {text!r}')
        return cls.from_parameters(files.parameters_in(files.read_yaml(text)))

    @classmethod
    def from_parameters(cls, given: Mapping[str, Any]) -> Vehicle:
        """Build a vehicle from parameters by name, as in a parameter file.

        The names are dotted, ``vehicle.mass``, or of mappings in mappings, also behind
        ``ros__parameters`` as a file has them.  Rotors have x, y, z in a list or (n, 3).  Unknown
        names are ignored, except in the groups ``vehicle`` and ``rotors``, and those that are
        similar to the vehicle's.  The inertia may be missing.  Raises a ParameterError that names
        the key and the fault.
        """
        if not isinstance(given, Mapping):
            raise TypeError(
                f'expected parameters by name, got {given!r}; Vehicle.load reads a file')
        if files.is_content(given):
            given = files.parameters_in(given)
        given = {name: with_rows(name, each) for group, value in given.items()
                 for name, each in flat(group, value)}
        groups = table(MovingVehicleSettings)
        check_given({name: given[name] for name in given if _concerns_vehicle(name)}, groups)
        moving = 'vehicle.inertia' in given
        settings = read(MovingVehicleSettings if moving else VehicleSettings, given)
        return cls.from_settings(settings.vehicle, settings.rotors, settings.allocation)

    @classmethod
    def from_settings(
        cls, body: BodySettings, rotors: RotorSettings, axes: AxesSettings | None = None
    ) -> Vehicle:
        """Build a vehicle from its settings; by default it commands the usual four axes.

        Raises a ParameterError if settings contradict each other.
        """
        vehicle = cls(**fields_of(body, rotors, AxesSettings() if axes is None else axes))
        vehicle = vehicle.with_stuck_servos(rotors.stuck_servos)
        return vehicle.at_voltage(rotors.battery_voltage) if rotors.battery_voltage else vehicle

    def with_health(
        self, health: ArrayLike, failed_arms: Iterable[tuple[int, int]] = (),
        stuck: Mapping[int, float] | None = None,
    ) -> Vehicle:
        """Return the same vehicle with other rotor health (n,) in [0, 1].

        `failed_arms` are coaxial pairs of rotors, counted from 1 on, of which one has failed, and
        which one is unknown.  Such an arm is one effector: both rotors have the same health, the
        share of its thrust that is left.  Their reaction torques count as zero, so that least
        norms give both the same thrust.  The true yaw torque of the arm differs from zero by at
        most the torque coefficient over the thrust coefficient times its thrust.

        `stuck` has by rotor, from 1, the angle at which its servo sticks [rad]; by default those
        stick that stick already.

        Raises a ParameterError if a health is out of bounds, an arm is not two coaxial rotors with
        the same health, or a servo cannot stick there.
        """
        shares = health_of('rotors.health', health, self.n)
        arms = tuple(failed_arms)
        for i, j in arms:
            arm = f'arm {i} {j}: expected two'
            if i == j or not (counts(i, self.n) and counts(j, self.n)):
                raise ParameterError(f'{arm} different rotors of 1 to {self.n}')
            if shares[i - 1] != shares[j - 1]:
                raise ParameterError(f'{arm} rotors with the same health')
            if self.partners[i - 1] != j - 1:
                raise ParameterError(f'{arm} rotors on the same axis')
        servos = self.servos if stuck is None else self.with_stuck_servos(stuck).servos
        return replace(self, health=shares, failed_arms=arms, servos=servos)

    @cached_property
    def partners(self) -> list[int | None]:
        """For each rotor the other one of its coaxial pair, from 0, or None."""
        return coaxial_partners(self.arms, self.rotor_axes, self.servos.sound)

    def with_stuck_servo(self, rotor: int, angle: float) -> Vehicle:
        """Return the same vehicle with the servo of a rotor (from 1) stuck at an angle [rad]."""
        return replace(self, servos=self.servos.stuck(rotor - 1, angle))

    def with_stuck_servos(self, pairs: ArrayLike | Mapping[int, float]) -> Vehicle:
        """Return the same vehicle with these servos stuck, and no others.

        `pairs` has by rotor, from 1, the angle [rad]; or it is (2 k,), or 0 for none: see
        `RotorSettings.stuck_servos`.
        """
        if isinstance(pairs, Mapping):
            pairs = [x for pair in pairs.items() for x in pair] or 0.0
        flat = np.ravel(np.asarray(pairs, dtype=float))
        stuck = self.servos.unstuck is not None
        sound = replace(self, servos=self.servos.sound) if stuck else self
        if flat.tolist() == [0.0]:
            return sound
        if len(flat) % 2 or (flat[::2] % 1.0).any():
            raise ParameterError(
                f'rotors.stuck_servos: expected pairs of a rotor and an angle, got {flat.tolist()}'
            )
        try:
            for rotor, angle in flat.reshape(-1, 2).tolist():
                sound = sound.with_stuck_servo(int(rotor), angle)
        except ParameterError as error:
            raise ParameterError(f'rotors.stuck_servos: {error}') from None
        return sound

    def fail(self, rotor: int, health: float = 0.0) -> Vehicle:
        """Return the same vehicle after the failure of a rotor, counted from 1 on.

        Raises a ParameterError if there is no such rotor, or the health is not in [0, 1].
        """
        if not counts(rotor, self.n):
            raise ParameterError(f'no rotor {rotor!r}: the vehicle has rotors 1 to {self.n}')
        return self.with_health(np.where(np.arange(self.n) == rotor - 1, health, self.health))

    @property
    def intact(self) -> Vehicle:
        """The same vehicle with the full health of all rotors; servos that stick, stick on."""
        return self.with_health(np.ones(self.n))

    @property
    def hover_speeds(self) -> Array:
        """Rotor speeds (n,) with the least thrusts that carry the weight without torque [rad/s].

        Raises a ValueError if the rotors cannot, or not within their bounds: `audit` says why.
        """
        gamma = self.wrenches[[AXES.index(axis) for axis in self.axes]] * ~self.lost
        hover = np.array([self.weight * (axis == 'thrust') for axis in self.axes])
        thrusts = np.linalg.pinv(gamma) @ hover
        within = (thrusts >= self.thrust_min) & (thrusts <= self.thrust_max)
        if not np.allclose(gamma @ thrusts, hover, atol=1e-9) or not (within | self.lost).all():
            raise ValueError('no least-norm hover within the bounds of the rotors: see audit')
        return self.speeds(np.where(self.lost, 0.0, thrusts))

    def save(self, path: str | Path) -> None:
        """Write a parameter file that `load` reads to the same vehicle.

        Positions are relative to the centre of mass.  Raises a ValueError for what only its own
        file describes: a thrust curve, the voltage of a battery, stuck servos.
        """
        Path(path).write_text(file_text(self), encoding='utf-8')

    def __eq__(self, other: object) -> bool:
        """Return whether all numbers are equal, to the last bit, and all names."""
        return same(self, other) if isinstance(other, Vehicle) else NotImplemented

    def __hash__(self) -> int:
        """Return a number that equal vehicles share."""
        return hash((self.mass, self.axes, self.n))

    def __repr__(self) -> str:
        """Return the vehicle in one line."""
        return f'Vehicle: {self.described}'

    @property
    def described(self) -> str:
        """The number of rotors, the mass, the axes and failures, in words."""
        lost = (np.flatnonzero(self.lost) + 1).tolist()
        weak = (np.flatnonzero((self.health < 1.0) & ~self.lost) + 1).tolist()
        parts = [f'{self.n} rotors', f'{self.mass:.4g} kg', f'axes {", ".join(self.axes)}']
        if len(self.servos):
            parts.insert(1, f'{len(self.servos)} servos')
        for what, rotors in (('lost', lost), ('weak', weak)):
            if rotors:
                parts.append(f'{what}: {", ".join(map(str, rotors))}')
        return ', '.join(parts)

    @property
    def idle_command(self) -> Array:
        """The idle speeds, and after them the tilt angles nearest to zero [rad/s, rad]."""
        return np.concatenate([self.idle_speeds, self.servos.resting])

    @property
    def weight(self) -> float:
        """What the rotors carry in hover: m g, less the buoyancy [N]."""
        return self.mass * self.gravity - self.buoyancy

    @cached_property
    def wrenches(self) -> Array:
        """Force and torque (6, n) of `rotor_wrenches`, servos at the angle zero."""
        return constant(self.thrust_wrenches(slice(None), self.rotor_axes))

    def thrust_wrenches(
        self, rotors: Sequence[int] | NDArray[np.intp] | slice, directions: Array
    ) -> Array:
        """Return as `wrenches` (6, k) for thrusts of rotors (k,) with directions (k, 3)."""
        ratio = self.torque_coefficient / self.thrust_coefficient
        ratio[[i - 1 for arm in self.failed_arms for i in arm]] = 0.0
        (x, y, z), (a, b, c) = self.arms[rotors].T, directions.T
        torques = (self.spins * ratio)[rotors, None] * directions
        # np.cross takes longer than all of the rest.
        for i, moment in enumerate((y * c - z * b, z * a - x * c, x * b - y * a)):
            torques[:, i] += moment
        return np.concatenate([directions.T, torques.T])


@lru_cache
def _concerns_vehicle(name: str) -> bool:
    """Return whether a parameter is the vehicle's, or a misspelling of one."""
    group, _, rest = name.partition('.')
    if group == 'allocation':
        return bool(get_close_matches(rest, table(AxesSettings), cutoff=0.6))
    return bool(get_close_matches(group, ('vehicle', 'rotors'), cutoff=0.8))


def inertia_of(
    vehicle: Vehicle, why: str = 'the controller and the simulation need it'
) -> Array:
    """Return the inertia (3, 3) of a vehicle [kg m^2]; raise a `ParameterError` if it has none."""
    if vehicle.inertia is None:
        raise MissingParameterError(f'vehicle.inertia: missing; {why}')
    return vehicle.inertia
