"""The audit: which axes effectors can control, and the refusal of a vehicle."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np

from ca_ros.arrays import Array
from ca_ros.problem import controllability
from ca_ros.problem.controllability import (
    INDEPENDENCE_MIN,
    STATED_CHOICES_MAX,
    lift,
    unit_rows,
)
from ca_ros.problem.diagnosis import Cause, diagnose
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem, problem_of, vehicle_of
from ca_ros.settings import ParameterError
from ca_ros.solver.zonotope import facet_normals
from ca_ros.vehicle.settings import AxesSettings
from ca_ros.vehicle.vehicle import Vehicle

ROUNDED = 1e-8, 2e-3
"""Angles between facets that are parallel except for three to eight digits of a file [rad].

With more digits `residual_slack` makes up for the difference.
"""


@dataclass(frozen=True, eq=False, repr=False)
class Audit:
    """The result of an `audit`.

    Hover stands for the reference of a problem that has no vehicle.

    Attributes
    ----------
    full : AllocationProblem
        Of all axes.
    independent : AllocationProblem
        Of the axes that the effectors can control independently.
    controllable : AllocationProblem
        Of the axes that are not lost.
    """

    full: AllocationProblem
    independent: AllocationProblem
    controllable: AllocationProblem

    @property
    def hovers(self) -> bool:
        """Whether hover is inside the admissible set of `full`."""
        return self.full.interior.has_reference

    @property
    def keeps_hovering(self) -> bool:
        """Whether hover is inside the admissible set of `controllable`."""
        return self.controllable.interior.has_reference

    @property
    def keeps_level(self) -> bool:
        """Whether hover is attainable without giving up roll or pitch."""
        return self.keeps_hovering and not {'roll', 'pitch'} & set(self.lost)

    @property
    def lost(self) -> tuple[str, ...]:
        """The axes that are not in `controllable`.

        Lost axes that are still in `independent` cannot be held at zero in hover; they are served
        last.
        """
        return tuple(axis for axis in self.full.axes if axis not in self.controllable.axes)

    @property
    def rank(self) -> int:
        """Rank of Gamma: number of axes that the effectors can control in theory."""
        return int((self._singular > 1e-9).sum())

    @cached_property
    def independence(self) -> dict[str, float]:
        """For each axis of `full`, how far it can be controlled independently of the others.

        It is the sine of the angle between its row of Gamma, with columns weighted by the ranges
        of the effectors, and the span of the other rows: 1 is best, 0 means that the effectors
        cannot control the axis.
        """
        distances = controllability.independence(unit_rows(self.full)).tolist()
        return dict(zip(self.full.axes, distances, strict=True))

    @property
    def condition(self) -> float:
        """Condition number of that Gamma with rows of unit length."""
        greatest, least = self._singular[[0, -1]].tolist()
        return greatest / least if least > 0.0 else np.inf

    @cached_property
    def _singular(self) -> Array:
        return np.array(np.linalg.svd(unit_rows(self.full), compute_uv=False), float)

    @cached_property
    def hover_margin(self) -> float:
        """Signed distance from hover to the boundary of the admissible set of `full` [N, N m].

        It is -inf if that set has no volume.
        """
        return self.full.margin(self.full.reference)

    @cached_property
    def controllable_hover_margin(self) -> float:
        """As `hover_margin`, for `controllable`."""
        return self.controllable.margin(self.controllable.reference)

    @cached_property
    def authority(self) -> dict[str, tuple[float, float]]:
        """For each axis of `controllable`, its range with the other axes at hover [N, N m].

        Empty if hover is not attainable.
        """
        return controllability.authority(self.controllable) if self.keeps_hovering else {}

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle of `independent`; its `lost_axes` is 'drop' if it is not sound.

        Raises a TypeError if the problem has none.
        """
        return vehicle_of(self.independent)

    @property
    def sound(self) -> bool:
        """Whether no axis is lost and hover is attainable."""
        return not self.lost and self.hovers

    def __str__(self) -> str:
        """Return the audit in one line."""
        return self.summary

    def __repr__(self) -> str:
        """Return the audit in one line, with the problem."""
        return f'{type(self).__name__}: {self.full.described}: {self}'

    @cached_property
    def summary(self) -> str:
        """What the effectors can control, in one line."""
        parts = [f'{", ".join(axes)} lost ({why})' for axes, why in self._losses() if axes]
        parts += self._remains()
        if not self.keeps_hovering:
            return '; '.join([*parts, self.why_no_hover(), *self._lacks()])
        if self.controllable.program.facet_choices <= STATED_CHOICES_MAX:
            parts.append(self._margin())
        ranges = (f'{axis} {self.ends(axis)} {self._unit(axis)}'.rstrip()
                  for axis in self.authority)
        return '; '.join([*parts, f'around {self.full.aim}: {", ".join(ranges)}'])

    def _margin(self) -> str:
        return f'margin of {self.full.aim} {self.controllable_hover_margin:.3g}'

    def _unit(self, axis: str) -> str:
        return self.full.axis_units[self.full.axes.index(axis)]

    def _remains(self) -> list[str]:
        """Return what is left of lost axes at hover, in words."""
        return []

    def _lacks(self) -> list[str]:
        """Return what hover lacks, in words."""
        return []

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is probably a slip in the file of a vehicle."""
        return ()

    def _losses(self) -> list[tuple[list[str], str]]:
        """Return the lost axes by cause."""
        kept, axes, dependent = self.independent.axes, len(self.full.axes), ''
        if len(kept) < axes:
            dependent = f'the allocation matrix has rank {self.rank} for {axes} axes'
            if self.rank == axes:
                least = min(self.independence.values())
                dependent = f'independence {least:.2g}, at least {INDEPENDENCE_MIN:g} is needed'
        return [
            ([axis for axis in self.lost if axis not in kept], dependent),
            ([axis for axis in self.lost if axis in kept], f'given up for {self.full.aim}'),
        ]

    def ends(self, axis: str) -> str:
        """Return the range of an axis around hover in words, without the unit."""
        low, high = self.authority[axis]
        return f'{low:+.3g} to {high:+.3g}'

    def why_no_hover(self) -> str:
        """Return why hover is not attainable, in words."""
        return f'the {self.full.effector_kind} cannot give {self.full.aim}'


@dataclass(frozen=True, eq=False, repr=False)
class VehicleAudit(Audit):
    """The result of an audit of a vehicle."""

    full: VehicleProblem
    independent: VehicleProblem
    controllable: VehicleProblem

    @cached_property
    def _hover_thrusts(self) -> Array:
        return self.controllable.program.thrusts(self.controllable.reference)

    @cached_property
    def spin_torque(self) -> float:
        """The yaw torque that remains in hover if yaw is lost, and spins the vehicle [N m]."""
        if not self.keeps_hovering:
            return 0.0
        kept = self.controllable.axes
        return controllability.spin_torque(self.full, kept, self._hover_thrusts)

    @cached_property
    def side_force(self) -> Array:
        """The force (2,) along x and y of the body that remains in hover, and pushes it [N].

        Zero if the force is controlled, or hover or its thrust is not.
        """
        if not self.keeps_hovering or 'thrust' not in self.controllable.axes:
            return np.zeros(2)
        return controllability.side_force(self.controllable, self._hover_thrusts)

    def _margin(self) -> str:
        return f'hover margin {self.controllable_hover_margin:.3g} [N, N m]'

    def _remains(self) -> list[str]:
        """Return the yaw torque and the side force that hover leaves, in words."""
        parts = []
        if self.spin_torque:
            parts.append(f'hover leaves a yaw torque of {self.spin_torque:+.2g} N m: it spins')
        if self.side_force.any():
            size = float(np.linalg.norm(self.side_force))
            parts.append(f'hover leaves a side force of {size:.2g} N: it drifts')
        return parts

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Slips in the vehicle's numbers that explain what is wrong; empty if none does."""
        return diagnose(self.full.vehicle)

    def __str__(self) -> str:
        """Return the audit in one line, with the slips."""
        causes = '; '.join(cause.text for cause in self.causes)
        return f'{self.summary}; probably wrong: {causes}' if causes else self.summary

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is probably a slip in the vehicle's file: `causes` and `remarks`, in words."""
        return (*(cause.text for cause in self.causes), *self.remarks)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What may be a slip, but is no reason to refuse the vehicle."""
        if not (angle := self._angle_of_facets()):
            return ()
        return (
            f'facets almost parallel, {angle:.1e} rad apart: near them small changes of the '
            'wrench change rotor speeds much; if the vehicle is symmetric, use rotors.ring, '
            'or write rotors.positions with nine digits',
        )

    def _angle_of_facets(self) -> float:
        """Return the greatest angle between facets that is in `ROUNDED` [rad]; 0 if none is."""
        problem = self.independent
        if not problem.interior.has_volume or problem.program.facet_choices > STATED_CHOICES_MAX:
            return 0.0
        normals = facet_normals(unit_rows(problem))
        products = np.triu(normals @ normals.T, 1)
        one, other = np.nonzero(np.abs(products) > np.cos(2.0 * ROUNDED[1]))
        signs = np.sign(products[one, other])[:, None]
        angles = np.linalg.norm(normals[one] - signs * normals[other], axis=1)
        return float(angles[(angles > ROUNDED[0]) & (angles < ROUNDED[1])].max(initial=0.0))

    def _lacks(self) -> list[str]:
        """Return what hover lacks: by how much k_f, speed or mass of sound rotors are wrong."""
        vehicle, (least, most) = self.vehicle, lift(self.vehicle)
        if not (vehicle.health == 1.0).all() or least < vehicle.mass < most:
            return []
        weak = vehicle.mass >= most
        mass, end = (most, 'most') if weak else (least, 'least')
        thrust = mass * vehicle.gravity - vehicle.buoyancy
        if thrust <= 0.0 or vehicle.weight <= 0.0:
            return []
        ratio = max(vehicle.weight / thrust, thrust / vehicle.weight)
        speed = 'speed_max' if weak else 'speed_min'
        return [
            f'hover needs {vehicle.weight:.4g} N, the rotors give at {end} {thrust:.4g} N: '
            f'thrust_coefficient or {speed} too {"small" if weak else "large"} '
            f'(by the factor {ratio:.3g} or {ratio**0.5:.3g}), or mass too '
            f'{"large" if weak else "small"}'
        ]

    def why_no_hover(self) -> str:
        """Return why the vehicle cannot hover: its mass and the masses that the rotors lift."""
        least, most = lift(self.vehicle)
        mass = f'{self.vehicle.mass:.4g} kg'
        if self.vehicle.mass >= most:
            return f'cannot hover: {mass} on rotors that lift {most:.4g} kg'
        if self.vehicle.mass <= least:
            return f'cannot hover: {mass} on rotors that lift at least {least:.4g} kg'
        return f'cannot hover: rotors that lift {most:.4g} kg cannot hold {mass} level'


@overload
def audit(subject: Vehicle) -> VehicleAudit: ...
@overload
def audit(subject: Vehicle | AllocationProblem) -> Audit: ...


def audit(subject: Vehicle | AllocationProblem) -> Audit:
    """Audit which axes the rotors of a vehicle, or the effectors of a problem, can control.

    Axes are given up until the remaining ones are independent, and then until hover, or the
    reference of the problem, is inside their admissible set: axes with other names than those of a
    vehicle from the last one on, then yaw before pitch and roll.  Of several dependent axes those
    go, and no axis that is independent of all others.  A vehicle never gives up thrust.  The
    health of rotors and effectors counts.

    Parameters
    ----------
    subject : Vehicle or AllocationProblem

    Returns
    -------
    Audit
        Of a vehicle with what hover leaves, too, and with what is probably wrong in its numbers:
        `spin_torque`, `side_force`, `causes`, `warnings`.

    Examples
    --------
    >>> report = audit(Vehicle.load('hexarotor').fail(1))
    >>> report.lost, report.sound
    (('yaw',), False)
    >>> print(f"roll {report.ends('roll')} N m")
    roll -2.34 to +2.34 N m
    """
    full = problem_of(subject)
    independent = controllability.independent_part(full)
    holding = controllability.holding_part(independent)
    if len(holding.axes) < len(full.axes) or not full.interior.has_reference:
        # The caller accepts or refuses the vehicle by this audit; allocators must not refuse it.
        independent = independent.dropping()
    kind: type[Audit] = VehicleAudit if isinstance(full, VehicleProblem) else Audit
    return kind(full, independent, holding)


@overload
def accept(subject: Vehicle, lost_axes: str | None = None) -> VehicleAudit: ...
@overload
def accept(subject: Vehicle | AllocationProblem, lost_axes: str | None = None) -> Audit: ...


def accept(subject: Vehicle | AllocationProblem, lost_axes: str | None = None) -> Audit:
    """Audit a vehicle, and refuse it unless its rotors can control every axis and it can hover.

    Raises a ParameterError if the vehicle, or the problem, is refused; the message says why, and
    what 'drop' would do.

    `lost_axes` ('refuse' or 'drop'): 'drop' refuses none: lost axes are given up.  The default for
    a vehicle is its `lost_axes`, the parameter ``allocation.lost_axes`` of its file.
    """
    choice: Any = subject.lost_axes if lost_axes is None else lost_axes
    AxesSettings(lost_axes=choice)
    report = audit(subject)
    if choice == 'refuse' and not report.sound:
        without = f'without {", ".join(report.lost)}' if report.lost else 'as it is'
        flies = '' if report.keeps_hovering else f', although {report.full.aim} is not attainable'
        made = ', or fail and with_health of an allocator made before' * report.full.failed
        raise ParameterError(
            f'allocation.lost_axes: this {report.full.subject} is refused: {report} '
            f"('drop' accepts it {without}{flies}; in Python lost_axes='drop' of make_allocator"
            f'{made})'
        )
    return report


def accepted(subject: Vehicle | AllocationProblem) -> AllocationProblem:
    """Return what an allocator solves: a problem as it is, of a vehicle the `independent` axes.

    Raises what `accept` raises, or a TypeError if the subject is neither.
    """
    return accept(subject).independent if isinstance(subject, Vehicle) else problem_of(subject)
