"""Reconfiguration: what is believed of a vehicle, and what is made for it.

A fault-tolerant controller that learns of a failure replaces what it had made for the sound
vehicle.  The news comes from several sources at any time; one object takes it, so that nothing is
made for less than the newest of all of them.
"""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.arrays import Array
from ca_ros.problem.audit import Audit, accept, audit
from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import Settings
from ca_ros.vehicle.validation import health_of, repeated
from ca_ros.vehicle.vehicle import Vehicle

VOLTAGE_STEP = 0.005  # relative change of the voltage from which the bounds follow it

HEALTH = 'rotors.health'

Arms = tuple[tuple[int, int], ...]

Made = TypeVar('Made')


class Failures(NamedTuple):
    """What is said of failures: by one source, or by all of them together.

    - `health` (n,)
    - `arms`: the `failed_arms` of `Vehicle.with_health`
    - `stuck`: by rotor, from 1, the angle at which its servo sticks [rad]
    """

    health: Array
    arms: Arms
    stuck: Mapping[int, float]

    @property
    def key(self) -> Hashable:
        """What differs if something else is said."""
        return self.health.tobytes(), self.arms, frozenset(self.stuck.items())


@dataclass(frozen=True, eq=False)
class Configuration(Generic[Made]):
    """What was made, and what for; it is replaced as a whole.

    - `declared`: what the settings declare, without failures
    - `settings`, `failures`, `voltage` [V]: the belief; the voltage is None if it is unknown
    - `audit`: of the vehicle as it is believed to be
    - `built`: for that audit
    - `duration`: the time that audit and making took [s]
    """

    declared: Any
    settings: Any
    failures: Failures
    voltage: float | None
    audit: Audit
    built: Made
    duration: float


class Reconfiguration(Generic[Made]):
    """Owns what is believed of a vehicle; makes what is made for it anew when that changes.

    The newest news of each source counts: the settings, with the health and the stuck servos of
    their group `rotors`, the health and the stuck servos that other sources report, and the
    voltage.  The health of a rotor is the least over the sources, and a servo sticks if a source
    says so.  An arm of which one rotor has failed is one effector as long as its rotors have the
    same health.

    Parameters
    ----------
    settings : Settings
        With the groups `vehicle`, `rotors` and `allocation`.
    make : callable
        Takes the settings, the audit and what was made before (None at first); returns what is
        made, such as an allocator.  What has to survive a change is taken from what was before.
        It must not change anything else.
    made : optional
        What is made for the settings already.

    Attributes
    ----------
    in_force : Configuration
    fault : str
        Why the belief is not in force; empty if it is.
    voltage : float or None
        The newest voltage [V].
    reported : dict of Failures
        The newest by source.

    Raises
    ------
    ParameterError
        If the vehicle is refused (`ca_ros.problem.audit.accept`); later changes of the belief
        only drop axes.
    """

    effector: ClassVar[str] = 'rotor'

    def __init__(
        self, settings: Any, make: Callable[[Any, Audit, Made | None], Made],
        made: Made | None = None,
    ) -> None:
        self._make = make
        self._declared = self._declare(settings)
        self.reported: dict[str, Failures] = {}
        self.voltage: float | None = None
        self.fault = ''
        self._failed: object = None
        begun = perf_counter()
        report = self._accept(self._declared)
        found = make(settings, report, None) if made is None else made
        self.in_force: Configuration[Made] = Configuration(
            self._declared, settings, self.own(settings), None, report, found,
            perf_counter() - begun)

    def _declare(self, settings: Any) -> Any:
        """Return what the settings declare."""
        return Vehicle.from_settings(settings.vehicle, settings.rotors, settings.allocation)

    def _accept(self, declared: Any) -> Audit:
        return accept(declared)

    def report(
        self, source: str, health: ArrayLike, stuck: Mapping[int, float] | None = None,
        arms: Arms = (),
    ) -> bool:
        """Take the health (n,) that a source reports; return whether something new is in force.

        `stuck` are the servos that it reports to stick: by rotor, from 1, the angle [rad].  `arms`
        are the `failed_arms` of `Vehicle.with_health`.  Raises what `check` raises.
        """
        shares = self.check(health, stuck, arms)
        self.reported[source] = Failures(shares, arms, stuck or {})
        return self._follow()

    def check(
        self, health: ArrayLike, stuck: Mapping[int, float] | None = None, arms: Arms = ()
    ) -> Array:
        """Return the health (n,) of a report; see `report`.

        Raises a ParameterError if it is not n numbers in [0, 1], a servo cannot stick there, or an
        arm is not of two rotors.
        """
        n = len(self._declared.health)
        shares = health_of(f'{self.effector} health', health, n, self.effector)
        self._declared.with_health(np.ones(n), arms, stuck or {})
        return shares

    def measure(self, voltage: float) -> bool:
        """Take the voltage of the battery [V]; return whether something new is in force.

        A voltage within `VOLTAGE_STEP` of that in force changes nothing.  Raises a ParameterError
        if it is not one that the battery can have.
        """
        self._declared.at_voltage(voltage)
        self.voltage = voltage
        return self._follow()

    def prepare(self, settings: Any) -> Configuration[Made]:
        """Make what the newest of all sources asks for, with these settings; apply nothing.

        What is in force is returned, with the settings, if they change nothing of it.  Raises what
        making it raises, a ValueError if the settings are wrong.
        """
        now, declared = self.in_force, self._declared
        failures, voltage = self._failures(settings), self._voltage()
        same = declared is now.declared and (failures.key, voltage) == (
            now.failures.key, now.voltage)
        if same and settings is now.settings:
            return now
        if same and _built_from(settings) == _built_from(now.settings):
            return replace(now, settings=settings)
        begun = perf_counter()
        failed = declared.with_health(*failures)
        report = accept(failed if voltage is None else failed.at_voltage(voltage), 'drop')
        made = self._make(settings, report, now.built)
        return Configuration(
            declared, settings, failures, voltage, report, made, perf_counter() - begun)

    def apply(self, configuration: Configuration[Made]) -> None:
        """Put in force what was prepared last."""
        self.in_force, self.fault, self._failed = configuration, '', None

    def change(self, settings: Any) -> bool:
        """Prepare and apply; return whether something new was made.

        Raises what `prepare` raises.
        """
        before = self.in_force.audit
        self.apply(self.prepare(settings))
        return self.in_force.audit is not before

    def _follow(self) -> bool:
        """Put the newest belief in force; if it cannot be made, say so in `fault`."""
        settings = self.in_force.settings
        belief = self._declared, self._failures(settings).key, self._voltage()
        if belief == self._failed:
            return False
        try:
            return self.change(settings)
        except Exception as error:
            # A method may be anybody's, and news must not end a flight.
            kind = '' if isinstance(error, ValueError) else f'{type(error).__name__}: '
            self.fault, self._failed = f'{kind}{error}', belief
            return False

    def _failures(self, settings: Any) -> Failures:
        """Return what all sources say: the least health, and what sticks by any of them.

        Of the arms those whose rotors have the same health.  Raises a ParameterError if there are
        no servos such as those that stick by the settings.
        """
        health, _, stuck = self.own(settings)
        for each in self.reported.values():
            health, stuck = np.minimum(health, each.health), {**stuck, **each.stuck}
        arms = [arm for each in self.reported.values() for arm in each.arms]
        alike = dict.fromkeys((i, j) for i, j in arms if health[i - 1] == health[j - 1])
        return Failures(health, tuple(alike), stuck)

    def own(self, settings: Any) -> Failures:
        """Return what the settings say of failures."""
        health = repeated(HEALTH, settings.rotors.health, self._declared.n)
        numbers = np.ravel(np.asarray(settings.rotors.stuck_servos, dtype=float))
        if numbers.tolist() == [0.0]:
            return Failures(health, (), {})
        self._declared.with_stuck_servos(numbers)
        return Failures(health, (), dict(numbers.reshape(-1, 2).tolist()))

    def _voltage(self) -> float | None:
        newest, held = self.voltage, self.in_force.voltage
        if newest is None or held is None:
            return newest
        return newest if abs(newest - held) > VOLTAGE_STEP * held else held


def _built_from(settings: Any) -> dict[str, Any]:
    """Return the groups of settings; those outside of a group, and the health, are no part."""
    return {
        name: {**vars(each), 'health': None} for name, each in vars(settings).items()
        if isinstance(each, Settings)}


class ProblemReconfiguration(Reconfiguration[Made]):
    """What is believed of a problem without a vehicle, in the file that the settings name.

    Its matrix may change.  Only other sources report the health of effectors, and those that are
    stuck: by effector, from 1, the value.
    """

    effector = 'effector'

    def _declare(self, settings: Any) -> AllocationProblem:
        return AllocationProblem.load(settings.problem)

    def _accept(self, declared: Any) -> Audit:
        return audit(declared)

    def change_matrix(self, matrix: ArrayLike) -> bool:
        """Take another matrix (m, n); return whether something new is in force.

        Raises a ValueError if its shape or a number is wrong, or the effectors, none of them
        failed, cannot control every axis with it.
        """
        declared = self._declared.with_matrix(matrix)
        if np.array_equal(declared.gamma, self._declared.gamma):
            return False
        declared.check_volume()
        self._declared = declared
        return self._follow()

    def own(self, settings: Any) -> Failures:
        """Return what the settings say: that nothing has failed."""
        return Failures(np.ones_like(self._declared.health), (), {})
