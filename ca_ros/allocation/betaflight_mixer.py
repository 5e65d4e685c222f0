"""A mixer like Betaflight's."""

from dataclasses import dataclass

import numpy as np

from ca_ros.allocation.allocator import Allocator
from ca_ros.allocation.named_axes import mixer
from ca_ros.allocation.result import Allocation
from ca_ros.arrays import Array
from ca_ros.settings import Settings, setting

WEAK = 1e-9  # relative share of thrust below which a rotor does not limit the throttle


@dataclass(frozen=True, kw_only=True)
class BetaflightMixerSettings(Settings):
    """The settings of `BetaflightMixer`."""

    airmode: bool = setting(
        True, 'false: below half throttle the torques are scaled down', mutable=True)


class BetaflightMixer(Allocator):
    """A mixer like Betaflight's (its mixer type LEGACY, the default) [1]_.

    The torques give each rotor a difference from the collective thrust.  If the differences span
    more than the range of the rotors, all are scaled down to fit.  Then the throttle is shifted,
    up or down, until each rotor is within its bounds.  So thrust gives way first, and all torques
    are reduced by the same share.  Without airmode, the differences are also scaled by 0.5 at zero
    throttle, growing to 1 at half throttle.

    Differences from Betaflight: the output is a thrust, in place of a motor signal; the columns
    of the pseudo-inverse of Gamma replace the mixer table; and throttle is the demanded thrust as
    a share of the thrust at full throttle.  For regular frames with equal rotors the columns
    are Betaflight's tables, except for the scale of roll, pitch and yaw.  For other vehicles the
    throttle moves the rotors in proportion to their share of thrust, so that the torques stay.
    Forces along x and y are scaled like torques.  The problem needs the axis thrust, and no axes
    but those of a multirotor.

    Parameters
    ----------
    problem : Vehicle or AllocationProblem
    airmode : bool, default True
        False: below half throttle the torques are scaled down.

    References
    ----------
    .. [1] Betaflight, applyMixerAdjustment in src/main/flight/mixer.c, as of 2026:
       https://github.com/betaflight/betaflight
    """

    solves = (
        'f = Gamma^+ u with the torques scaled to fit and the thrust shifted (as in Betaflight)'
    )
    guarantees = 'the bounds, and the direction of the torques with equal, parallel rotors'

    settings_type = BetaflightMixerSettings
    settings: BetaflightMixerSettings

    def _set_up(self) -> None:
        self.airmode = self.settings.airmode
        problem = self.problem
        columns, self._base, self._offset = mixer('betaflight_mixer', problem)
        self._thrust = problem.axes.index('thrust')
        self._collective = columns.pop('thrust')
        self._differences = np.column_stack([*columns.values(), np.zeros((problem.n, 0))])
        share = self._collective
        self._counts = np.abs(share) > WEAK * np.abs(share).max()
        ends = np.array([problem.lower, problem.upper])[:, self._counts] / share[self._counts]
        # The thrust at which each rotor reaches its bounds, if there are no torques.
        self._ends = np.sort(ends, axis=0)

    def _allocate(self, u: Array) -> Allocation:
        share = self._collective[self._counts]
        u_own = u - self._offset
        difference = self._differences @ np.delete(u_own, self._thrust)
        throttle = float(u_own[self._thrust])
        spread = difference[self._counts] / share
        scale = self._authority(throttle) * self._fitting(spread)
        low, high = self._throttles(scale * spread)
        throttle = min(max(throttle, low), high)
        wanted = self._base + throttle * self._collective + scale * difference
        return self._clipped(u, wanted)

    def _throttles(self, spread: Array) -> tuple[float, float]:
        """Return the least and the greatest thrust at which no rotor is beyond its bounds [N]."""
        low, high = self._ends - spread
        return float(low.max(initial=-np.inf)), float(high.min(initial=np.inf))

    def _fitting(self, spread: Array) -> float:
        """Return the greatest share of the differences, up to 1, that fits between the bounds."""
        low, high = self._ends
        # Rotor i at its lower bound and rotor j at its upper bound limit their difference.
        between = np.subtract.outer(spread, spread).T
        room = np.maximum(high[None, :] - low[:, None], 0.0)
        limiting = between > room
        return float((room[limiting] / between[limiting]).min(initial=1.0))

    def _authority(self, throttle: float) -> float:
        """Return the share of the torques that the throttle allows."""
        if self.airmode:
            return 1.0
        low, high = self._throttles(np.zeros(len(self._ends[0])))
        share = (throttle - low) / (high - low) if high > low else 1.0
        return min(max(0.5 + share, 0.5), 1.0)
