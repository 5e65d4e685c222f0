"""Rates of servos and rotors: allocation within what they reach in one step."""

from dataclasses import replace
from math import acos, asin, cos, inf, pi, sin

import numpy as np
from numpy.typing import ArrayLike

from ca_ros.allocation.exact import Exact
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.result import Allocation, Status
from ca_ros.allocation.slew import reached
from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.vehicle_problem import VehicleProblem, joined
from ca_ros.settings import ParameterError
from ca_ros.solver.convex_sets import ConvexSet, Interval, Sector
from ca_ros.vehicle.servos import FIXED, Servos
from ca_ros.vehicle.validation import numbers
from ca_ros.vehicle.vehicle import Vehicle

REACHED_MIN = 1e-9  # range of a thrust, as a share of the greatest, below which it is held
AT_END = 1e-5  # distance of an angle [rad] or a thrust, as a share of the greatest, from its end


class TiltLimited:
    """`exact` for rotors that tilt, whose servos and rotors turn no faster than given rates.

    The set of each rotor is what servo and rotor reach from here in one step: a narrow sector
    about the present direction, from the least thrust to the greatest.  So the angles are
    continuous, also where the thrust passes through zero and its direction would jump.  A rotor
    without thrust turns towards the direction in which thrust would cost least.

    The thrusts that a rotor reaches are not convex below: its least one is taken along the middle
    of the sector.  The present command always is in the set.

    Parameters
    ----------
    vehicle : Vehicle
        With rotors that tilt.
    speed_rate : float or (n,) array
        Greatest rate at which the rotor speeds grow, positive [rad/s^2].
    tilt_rate : float or (k,) array
        Greatest rate of each servo, positive [rad/s].
    settings : ExactSettings, optional
    braking : float or (n,) array, optional
        Greatest rate at which the rotor speeds shrink; by default as `speed_rate`.

    Raises
    ------
    ParameterError
        If a rate is not positive.

    Examples
    --------
    >>> vehicle = Vehicle.load('tricopter')
    >>> last = Exact(vehicle).allocate([vehicle.weight, 0.0, 0.0, 0.0])
    >>> slow = TiltLimited(vehicle, speed_rate=2000.0, tilt_rate=3.0)
    >>> print(slow.allocate([vehicle.weight, 0.0, 0.0, 0.1], last.speeds, last.angles, 0.01))
    RATE_LIMITED: thrust 11.77, roll 0, pitch 0, yaw 0.0354 of 0.1
    """

    def __init__(
        self, vehicle: Vehicle, speed_rate: ArrayLike, tilt_rate: ArrayLike,
        settings: ExactSettings | None = None, braking: ArrayLike | None = None,
    ) -> None:
        self.vehicle, self._servos = vehicle, vehicle.servos
        self.settings = ExactSettings() if settings is None else settings
        self.speed_rate = numbers('speed_rate', speed_rate, vehicle.n)
        self.braking = self.speed_rate if braking is None else numbers(
            'braking', braking, vehicle.n)
        self.tilt_rate = numbers('tilt_rate', tilt_rate, len(self._servos.rotors))
        if not all((each > 0.0).all() for each in (self.speed_rate, self.braking, self.tilt_rate)):
            raise ParameterError('speed_rate, braking, tilt_rate: expected positive numbers')

    def __repr__(self) -> str:
        """Return the vehicle in one line, behind the name of the class."""
        return f'{type(self).__name__}: {self.vehicle.described}'

    def allocate(
        self, u: ArrayLike, speeds: ArrayLike, angles: ArrayLike, period: float
    ) -> Allocation:
        """Allocate one wrench.

        Parameters
        ----------
        u : (m,) array
            As in `Allocator.allocate`.
        speeds, angles : (n,) and (k,) arrays
            The last command [rad/s, rad]; beyond a limit it counts as the limit.
        period : float
            Time since then, 0 or more [s]; at 0 the command is held.

        Returns
        -------
        Allocation
            Its problem has the sets of this step.  It is RATE_LIMITED if a wrench out of reach
            is limited by the rate of a rotor or of a servo; the explanation names them.
        """
        if not 0.0 <= period < inf:
            raise ParameterError(f'period: expected 0 s or more, finite, got {period} s')
        last = numbers('speeds', speeds, self.vehicle.n)
        turned = numbers('angles', angles, len(self._servos.rotors))
        turned = self._servos.within(turned)
        reach = joined(self.vehicle, self._reachable(last, turned, period))
        problem = VehicleProblem(self.vehicle, reach, turned)
        if not problem.interior.has_volume:
            # The period is too short for any change.
            held = problem.clip(problem.middle)
            return Allocation(problem, problem.check(u), held, Status.INEXACT)
        answer = Exact(problem, self.settings).allocate(u)
        if answer.status in (Status.PRIORITIZED, Status.SCALED):
            by_rate = self._by_rate(answer, problem)
            if by_rate.any():
                return replace(answer, status=Status.RATE_LIMITED, by_rate=by_rate)
        return answer

    def allocate_after(self, u: ArrayLike, command: Array, period: float) -> Allocation:
        """Allocate one wrench a period [s] after a command of speeds and angles (n + k,)."""
        n = self.vehicle.n
        return self.allocate(u, command[:n], command[n:], period)

    def _by_rate(self, answer: Allocation, problem: VehicleProblem) -> BoolArray:
        """Return whose rates an answer on the boundary is at; see `Allocation.by_rate`."""
        vehicle, servos = self.vehicle, self._servos
        found = np.zeros(problem.n, dtype=bool)
        low, high = servos.limits
        ends = np.column_stack(problem.sets.length_limits).tolist()
        places = zip(problem.sets.sets, problem.sets.first, ends, strict=True)
        for i, (each, k, (lower, upper)) in enumerate(places):
            rows = problem.directions[k : k + each.size]
            vector = answer.thrusts[k : k + each.size]
            slack = AT_END * float(vehicle.thrust_max[i])
            above = upper < vehicle.thrust_max[i] - slack
            below = lower > vehicle.thrust_min[i] + slack
            length = float(np.linalg.norm(vector))
            if (above and length >= upper - slack) or (below and vector[0] <= lower + slack):
                found[k] = True
            mine = [s for s, rotor in enumerate(servos.rotors) if rotor == i]
            if not mine:
                continue
            if length <= slack:
                # Without the rate a full disc would give thrust.
                bound = bool(servos.endless[mine[0]])
            elif len(mine) == 2:
                off = _angle(float(vector @ rows @ servos.nominal[i]) / length)
                bound = off < servos.gimbal[i] - AT_END
            else:
                turned = float(answer.angles[mine[0]])
                bound = low[mine[0]] + AT_END < turned < high[mine[0]] - AT_END
            half = each.half_angle if isinstance(each, Sector) else 0.0
            side = half == 0.0 or length <= slack or (
                _angle(float(vector[0]) / length) >= half - AT_END)
            if bound and side:
                found[k + (each.size > 1)] = True
        return found

    def _reachable(
        self, speeds: Array, angles: Array, period: float
    ) -> list[tuple[ConvexSet, Array]]:
        """Return the set of each rotor for the next step, and its directions."""
        vehicle, servos = self.vehicle, self._servos
        low, high = vehicle.speed_limits
        last = np.minimum(np.maximum(speeds, low), high)
        ends = reached(last, period, self.speed_rate, self.braking, low, high)
        least, most = map(vehicle.thrusts, ends)
        present, directions = vehicle.thrusts(last), servos.directions(angles)
        found: list[tuple[ConvexSet, Array]] = []
        for i in range(vehicle.n):
            mine = [k for k, rotor in enumerate(servos.rotors) if rotor == i]
            here, thrusts = directions[i], (float(least[i]), float(most[i]))
            held = thrusts[1] - thrusts[0] <= REACHED_MIN * max(1.0, float(vehicle.thrust_max[i]))
            if held or not mine:
                found.append((Interval(*thrusts), here[None]))
                continue
            # The present thrust times the cosine of its angle to the middle is at least the
            # least thrust, if the middle is no further away than this.
            away = acos(min(1.0, thrusts[0] / present[i])) if present[i] > 0.0 else pi
            steps = self.tilt_rate[mine] * period
            if len(mine) == 1:
                middle, half = self._arc(i, float(angles[mine[0]]), float(steps[0]), away)
                first, across = servos.turned(np.full(vehicle.n, middle))
                rows = np.array([first[i], across[i]])
            else:
                rows, half = _cap(servos, i, here, float(angles[mine[1]]), steps, away)
            if half <= FIXED:
                found.append((Interval(*thrusts), here[None]))
            else:
                half = min(half, pi / 2)
                found.append((Sector(half, thrusts[1], len(rows), thrusts[0]), rows))
        return found

    def _arc(self, rotor: int, angle: float, step: float, away: float) -> tuple[float, float]:
        """Return the middle and the half range of the angles that a servo reaches."""
        low, high = angle - step, angle + step
        if not self._servos.endless[self._servos.rotors.index(rotor)]:
            low = max(low, float(self._servos.lower[rotor]))
            high = min(high, float(self._servos.upper[rotor]))
        return _centered(low, high, angle, away)


def _angle(cosine: float) -> float:
    return acos(max(-1.0, min(1.0, cosine)))


def _centered(low: float, high: float, angle: float, away: float) -> tuple[float, float]:
    """Return middle and half of a range, narrowed until the middle is at most `away`."""
    least, most = 2.0 * (angle - away) - high, 2.0 * (angle + away) - low
    low, high = max(low, least), min(high, most)
    return (low + high) / 2.0, (high - low) / 2.0


def _cap(
    servos: Servos, rotor: int, here: Array, beta: float, steps: Array, away: float
) -> tuple[Array, float]:
    """Return the frame and half angle of a cone that a gimbal reaches, inside of its limits."""
    nominal, limit = servos.nominal[rotor], float(servos.gimbal[rotor])
    # Within a cap of this size both angles change by at most their steps.
    size = min(float(steps[1]), asin(sin(min(float(steps[0]), pi / 2)) * cos(beta)))
    off = _angle(float(here @ nominal))
    side = here - (here @ nominal) * nominal
    length = float(np.linalg.norm(side))
    side = side / length if length > 1e-9 else np.cross(servos.axes[rotor], nominal)
    middle, half = _centered(max(off - size, -limit), min(off + size, limit), off, away)
    first = cos(middle) * nominal + sin(middle) * side
    across = cos(middle) * side - sin(middle) * nominal
    return np.array([first, across, np.cross(first, across)]), half
