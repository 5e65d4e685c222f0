"""Sequential desaturation, as in PX4."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.named_axes import mixer
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.controllability import unit_rows
from ca_ros.problem.problem import AllocationProblem
from ca_ros.settings import Settings, setting

WEAK = 0.2  # rotors with a smaller normalised entry of a mixer column do not decide its use
YAW_MARGIN = 0.15  # how far a rotor may exceed its range before yaw is reduced, as a share
INDEPENDENCE_MIN = 1e-2  # least squared sine of an axis to the span of more important ones
PRIORITY = ('thrust', 'roll', 'pitch', 'force_x', 'force_y', 'yaw')
FOLD_MIN = 1e-3  # least relief of the worst saturation for early yaw, as a share of the range


@dataclass(frozen=True, kw_only=True)
class SequentialDesaturationSettings(Settings):
    """The settings of `SequentialDesaturation`."""

    airmode: Literal['disabled', 'roll_pitch', 'roll_pitch_yaw'] = setting(
        'disabled', 'for which axes thrust may be raised. disabled: none', mutable=True)
    dependent_axes: Literal['drop', 'keep'] = setting(
        'drop', 'whether axes that depend on others are left out', python_only=True)


class SequentialDesaturation(Allocator):
    """The pseudo-inverse, desaturated along one axis after the other, as in PX4 [1]_.

    The thrusts of the pseudo-inverse are moved along the column of one axis, as far as reduces the
    greatest saturations on both sides most.  What saturation remains is clipped.  The airmode
    decides which axes are used:

    - 'disabled': thrust is reduced, not raised; then roll and pitch are changed.  Yaw is added
      last and reduced, with a margin beyond the upper bounds; thrust is reduced for the margin.
    - 'roll_pitch': thrust is raised or reduced, and roll and pitch are kept.  Yaw is added last as
      above, or at once if it relieves the worst saturation.
    - 'roll_pitch_yaw': thrust is raised or reduced for roll, pitch and yaw; then yaw is reduced.

    Where yaw is added last, the earlier steps are not taken back.  Then even wrenches that the
    pseudo-inverse attains may be missed.

    An axis that depends on more important ones is left out, as in PX4 since September 2026 [2]_:
    its row of Gamma, per range of the rotors, makes an angle of less than 5.7 degrees with the
    span of theirs.  The order is thrust, roll, pitch, force_x, force_y, yaw.

    Differences from PX4: here u is a wrench, and the airmode is one of PX4's former parameter
    MC_AIRMODE, without the limit MC_AIRMODE_LIM between them.  Forces along x and y are mixed
    like roll and pitch, and never reduced.  Steps for axes that a vehicle has lost are left out.
    The problem needs the axis thrust, and no axes but those of a multirotor.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem
    airmode : {'disabled', 'roll_pitch', 'roll_pitch_yaw'}, default 'disabled'
        For which axes thrust may be raised.
    dependent_axes : {'drop', 'keep'}, default 'drop'
        Whether axes that depend on others are left out.  'keep': as in the releases of PX4 before,
        which invert them.

    References
    ----------
    .. [1] PX4 Autopilot, ControlAllocationSequentialDesaturation, as of 2026:
       https://github.com/PX4/PX4-Autopilot/tree/main/src/lib/control_allocation
    .. [2] "Drop control axes that are not independently achievable":
       https://github.com/PX4/PX4-Autopilot/pull/28589
    """

    solves = (
        'f = Gamma^+ u, moved along thrust, roll, pitch and yaw until it is within the '
        'bounds, by the airmode (as in PX4)'
    )

    settings_type = SequentialDesaturationSettings
    settings: SequentialDesaturationSettings

    def _set_up(self) -> None:
        self.airmode, problem = self.settings.airmode, self.problem
        dropped = _dependent if self.settings.dependent_axes == 'drop' else None
        self._columns, self._base, self._offset = mixer(
            'sequential_desaturation', problem, dropped)
        self._strong = _strong(self._columns)
        self._yaw = problem.axes.index('yaw') if 'yaw' in problem.axes else None
        self._least_relief = FOLD_MIN * 2.0 * problem.half_range.max(initial=0.0)

    def _allocate(self, u: Array) -> Allocation:
        return self._clipped(u, self._desaturated(u - self._offset))

    def _desaturated(self, u: Array) -> Array:
        """Return the thrusts (n,) before clipping."""
        columns, yaw = self._columns, self._yaw
        thrusts = self._base.copy()
        for row, axis in enumerate(columns):
            if row != yaw:
                thrusts += columns[axis] * u[row]
        twist = 0.0 if yaw is None else float(u[yaw])
        early = self.airmode == 'roll_pitch_yaw' or (
            self.airmode == 'roll_pitch' and self._relieves(thrusts, twist)
        )
        if early and yaw is not None:
            thrusts += columns['yaw'] * twist
        thrusts = self._along('thrust', thrusts, raised=self.airmode != 'disabled')
        if early:
            return self._along('yaw', thrusts, limits=sorted((-twist, 0.0)))
        if self.airmode == 'disabled':
            thrusts = self._along('pitch', self._along('roll', thrusts))
        if yaw is None:
            return thrusts
        thrusts += columns['yaw'] * twist
        thrusts = self._along('yaw', thrusts, margin=YAW_MARGIN)
        return self._along('thrust', thrusts, raised=False)

    def _along(
        self, axis: str, thrusts: Array, raised: bool = True, limits: list[float] | None = None,
        margin: float = 0.0,
    ) -> Array:
        """Return thrusts moved along the column of an axis, twice, the second time half as far."""
        if axis not in self._columns:
            return thrusts
        low, high = limits or (-np.inf, np.inf)
        moved = 0.0
        for share in (1.0, 0.5):
            needed = self._needed(axis, thrusts, margin)
            # The step balances the greatest saturations of both signs.
            gain = share * float(needed.min(initial=0.0) + needed.max(initial=0.0))
            if gain > 0.0 and not raised and share == 1.0:
                return thrusts
            gain = min(max(gain, low - moved), high - moved)
            moved += gain
            thrusts = thrusts + gain * self._columns[axis]
        return thrusts

    def _needed(self, axis: str, thrusts: Array, margin: float = 0.0) -> Array:
        """Return for each rotor that counts the step along an axis that ends its saturation."""
        strong, problem = self._strong[axis], self.problem
        low, high = problem.lower[strong], problem.upper[strong]
        high = high + margin * (high - low)
        found = thrusts[strong]
        lacking = np.minimum(np.maximum(found, low), high) - found
        steps: Array = lacking / self._columns[axis][strong]
        return steps

    def _relieves(self, thrusts: Array, twist: float) -> bool:
        """Tell whether yaw reduces the worst saturation, as seen along thrust."""
        if self._yaw is None:
            return False
        scale = np.abs(self._columns['thrust']).mean()
        with_yaw = thrusts + self._columns['yaw'] * twist
        worst, relieved = (
            float(np.abs(self._needed('thrust', found)).max(initial=0.0)) * scale
            for found in (thrusts, with_yaw)
        )
        return relieved < worst - self._least_relief


def _dependent(problem: AllocationProblem) -> list[int]:
    """Return the numbers of the axes that depend on more important ones."""
    rows = dict(zip(problem.axes, unit_rows(problem), strict=True))
    dropped, span = [], np.zeros((0, problem.n))
    for axis in (axis for axis in PRIORITY if axis in rows):
        # Twice, for the digits of what is left.
        rest = rows[axis] - span.T @ (span @ rows[axis])
        rest -= span.T @ (span @ rest)
        size = float(np.linalg.norm(rest))
        if size**2 < INDEPENDENCE_MIN:
            dropped.append(problem.axes.index(axis))
        else:
            span = np.vstack([span, rest / size])
    return dropped


def _strong(columns: dict[str, Array]) -> dict[str, BoolArray]:
    """Return by axis which rotors count, after PX4's normalisation of the columns."""
    sizes = {axis: np.abs(column) for axis, column in columns.items()}
    counts = {axis: max(np.count_nonzero(size), 1) for axis, size in sizes.items()}
    scales = {axis: size.max() for axis, size in sizes.items()}
    scales['thrust'] = sizes['thrust'].sum() / counts['thrust']
    tilt = [axis for axis in ('roll', 'pitch') if axis in columns]
    for axis in tilt:
        scales[axis] = max(np.sqrt(2.0 * (sizes[a] ** 2).sum() / counts[a]) for a in tilt)
    return {axis: (size >= WEAK * scales[axis]) & (size > 0.0) for axis, size in sizes.items()}
