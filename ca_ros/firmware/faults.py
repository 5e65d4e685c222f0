"""The faults that can be announced to the firmware: the health of the rotors."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from ca_ros.allocation.exact import Exact
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.problem.audit import VehicleAudit, accept, audit
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.settings import ParameterError
from ca_ros.vehicle.failure_words import in_words, read_failures, with_failures
from ca_ros.vehicle.motors import HEALTH_MIN
from ca_ros.vehicle.vehicle import Vehicle

CHOICES = 'none', 'single', 'pairs'
"""Names of sets of faults: no fault; the loss of each single rotor, and of one of each arm's; the
loss of each two rotors after which an axis is left."""


@dataclass(frozen=True, eq=False)
class Fault:
    """A known health of the rotors; entry 0 of a list of faults means no fault.

    - `constant`: the name of its constant in C, without the name of the vehicle
    - `report`: what the rotors can still command
    - `settings`: of the method, for the vehicle without a fault
    """

    constant: str
    meaning: str
    report: VehicleAudit
    settings: ExactSettings = field(default_factory=ExactSettings)

    def __post_init__(self) -> None:
        if self.report.vehicle.powerless or not self.problem.interior.has_volume:
            raise ParameterError(f'{self.meaning}: no axis is left that the rotors can control')

    @property
    def problem(self) -> VehicleProblem:
        """The problem that the method solves; see `Exact.suited`."""
        problem: VehicleProblem = self._suited[0]
        return problem

    @property
    def suited(self) -> ExactSettings:
        """The settings of the method for this fault."""
        return self._suited[1]

    @cached_property
    def _suited(self) -> tuple[Any, ExactSettings]:
        return Exact.suited(self.report, self.settings)


def faults_of(vehicle: Vehicle, words: Sequence[str]) -> list[Fault]:
    """Return the vehicle as it is, and its faults.

    As in the nodes, a vehicle that cannot control every axis and hover at the start is refused
    unless its `lost_axes` is 'drop', and a fault is always accepted without the lost axes. Raises
    a ParameterError if the vehicle is refused, a word is wrong, or a fault leaves no axis.

    `words`: 'none', 'single', 'pairs', or failures as in `read_failures`, such as ``1,3=0.4``.
    """
    report = accept(vehicle)
    found = [Fault('NO_FAULT', 'the rotors are as in the file', report)]

    def after(failures: dict[str, float]) -> VehicleAudit:
        # Axes that are lost already stay so.
        return audit(with_failures(report.independent.vehicle, failures))

    rotors = [i + 1 for i in np.flatnonzero(vehicle.health >= HEALTH_MIN).tolist()]
    for word in dict.fromkeys(words):
        if word == 'single':
            for i in rotors:
                name = f'ROTOR_{i}_LOST'
                found.append(Fault(name, f'rotor {i} is lost', after({str(i): 0.0})))
            for i, j in arms_of(vehicle):
                health = vehicle.health.copy()
                health[[i - 1, j - 1]] /= 2.0
                left = audit(report.independent.vehicle.with_health(health, [(i, j)]))
                found.append(Fault(f'ARM_{i}_{j}', f'one of rotors {i} and {j} is lost', left))
        elif word == 'pairs':
            for i, j in combinations(rotors, 2):
                with suppress(ParameterError):
                    found.append(Fault(
                        f'ROTORS_{i}_{j}_LOST', f'rotors {i} and {j} are lost',
                        after({str(i): 0.0, str(j): 0.0}),
                    ))
        elif word != 'none':
            try:
                failures = read_failures(word)
                left = after(failures)
            except ParameterError as error:
                raise ParameterError(f'--faults: {error}; or {" or ".join(CHOICES)}') from None
            found.append(Fault(f'FAULT_{len(found)}', in_words(failures), left))
    return found


def arms_of(vehicle: Vehicle) -> list[tuple[int, int]]:
    """Return the coaxial pairs of rotors, from 1, of which a detector may not tell who has failed.

    Both must have thrust, and the same health.
    """
    health = vehicle.health
    return [
        (i + 1, j + 1) for i, j in enumerate(vehicle.partners)
        if j is not None and i < j and health[i] == health[j] >= HEALTH_MIN
    ]
