"""Linear functions of bounded variables, pushed to their goals one after the other."""

from __future__ import annotations

from collections.abc import Sequence

from ca_ros.arrays import Array

ZERO = 1e-8
"""Rate below which a variable does not depend on another; all are of the order of 1."""

SLACK = 1e-12
"""How far variables may be beyond their bounds because of rounding."""

ROUNDING = 1e-9
"""Rate below which a variable does not come to its bound."""

PIVOTS_PER_VARIABLE = 8
"""Limit of the pivots of one push, per variable; the tests have not seen more than one."""


class Simplex:
    """The simplex method for bounded variables, for goals in lexicographic order.

    The variables are x_1 ... x_n within -1 and 1, and the rows ``y = A x``, unbounded at first.
    The state is a dictionary: m basic variables as linear functions of the others.  All variables
    are within their bounds at all times, and `push` moves one of them as far towards its goal as
    the others allow.

    Parameters
    ----------
    matrix : (m, n) array
        A; the absolute values in each row add up to 1.

    Attributes
    ----------
    value : list of float
        The variables: n entries of x, m of y, and what `add_ray` adds.
    lower, upper : lists of float
        Their bounds.
    doubt : float
        How much further variables might have been pushed, but for `ZERO` and for rounding errors
        that pivots magnify.
    """

    def __init__(self, matrix: Array) -> None:
        m, n = matrix.shape
        self._rates: list[list[float]] = matrix.tolist()
        self._basic = list(range(n, n + m))
        self._nonbasic = list(range(n))
        self.value = [0.0] * (n + m)
        self.lower = [-1.0] * n + [-float('inf')] * m
        self.upper = [1.0] * n + [float('inf')] * m
        self.doubt = SLACK

    def copy(self) -> Simplex:
        """Return an independent copy."""
        other = Simplex.__new__(Simplex)
        other._rates = [row[:] for row in self._rates]
        other._basic, other._nonbasic = self._basic[:], self._nonbasic[:]
        other.value, other.lower, other.upper = self.value[:], self.lower[:], self.upper[:]
        other.doubt = self.doubt
        return other

    def push(self, v: int, goal: float) -> bool:
        """Move variable v as far towards a goal as the bounds of all others allow.

        From then on v is never further from the goal.

        Returns
        -------
        bool
            Whether v is at the goal.
        """
        reached = self.value[v] == goal or self._push(v, goal)
        self.lower[v], self.upper[v] = sorted((self.value[v], goal))
        return reached

    def _push(self, v: int, goal: float) -> bool:
        value, lower, upper = self.value, self.lower, self.upper
        if v in self._nonbasic:
            k = self._nonbasic.index(v)
            blocked, reached = self._move(k, goal - value[v], goal, -1)
            if reached:
                value[v] = goal
                return True
            self._pivot(blocked, k)
        r = self._basic.index(v)
        for pivot in range(PIVOTS_PER_VARIABLE * len(value)):
            left, best, k = goal - value[v], ZERO, -1
            for j, (rate, x) in enumerate(zip(self._rates[r], self._nonbasic)):  # noqa: B905
                if abs(rate) > best and (
                    value[x] < upper[x] if (rate > 0.0) == (left > 0.0) else value[x] > lower[x]
                ):
                    best, k = abs(rate), j
                    if pivot > len(value):
                        # The first that moves v, not the fastest: so the method cannot cycle.
                        break
            if k < 0:
                rates = zip(self._rates[r], self._nonbasic, strict=True)
                self.doubt += sum(
                    abs(rate)
                    * min((upper[x] - value[x] if rate * left > 0.0 else value[x] - lower[x]), 2.0)
                    for rate, x in rates
                    if abs(rate) <= ZERO
                )
                return False
            blocked, reached = self._move(k, left / self._rates[r][k], goal, v)
            if reached:
                value[v] = goal
                return True
            if blocked >= 0:
                self._pivot(blocked, k)
        return False

    def release(self, v: int) -> None:
        """Make variable v nonbasic, and keep it at its value."""
        self.lower[v] = self.upper[v] = self.value[v]
        if v in self._basic:
            r = self._basic.index(v)
            sizes = [
                abs(rate) if self.lower[x] < self.upper[x] else 0.0
                for rate, x in zip(self._rates[r], self._nonbasic, strict=True)
            ]
            self._pivot(r, sizes.index(max(sizes)))

    def add_ray(self, rows: Sequence[int], direction: Sequence[float]) -> int:
        """Add the length, from 0, of a way that nonbasic variables go together.

        Parameters
        ----------
        rows : sequence of int
            Nonbasic variables; from now on they move with the share alone.
        direction : sequence of float
            How far each of them goes in a unit of length; of the order of 1.

        Returns
        -------
        int
            The new variable.
        """
        places = [self._nonbasic.index(v) for v in rows]
        ways = list(zip(places, direction, strict=True))
        for rates in self._rates:
            rates.append(sum(way * rates[k] for k, way in ways))
        self._nonbasic.append(self._new(0.0, 0.0, float('inf')))
        self._drop([x not in rows for x in self._nonbasic])
        return len(self.value) - 1

    def add_lag(
        self, rows: Sequence[int], goals: Sequence[float], weights: Sequence[float]
    ) -> int:
        """Add the greatest distance of some variables to their goals, in units of their weights.

        Returns
        -------
        int
            The new variable; it is nonbasic, and 0 is its goal.
        """
        most = max(
            abs(goal - self.value[v]) / weight
            for v, goal, weight in zip(rows, goals, weights, strict=True)
        )
        for rates in self._rates:
            rates.append(0.0)
        lag = self._new(most, 0.0, most)
        self._nonbasic.append(lag)
        for v, goal, weight in zip(rows, goals, weights, strict=True):
            if v in self._basic:
                rates = self._rates[self._basic.index(v)]
            else:
                rates = [float(x == v) for x in self._nonbasic]
            for sign in (1.0, -1.0):
                # The variable with as much of the lag is at the goal or beyond, on either side.
                sides = (goal, float('inf')) if sign > 0.0 else (-float('inf'), goal)
                self._rates.append([*rates[:-1], sign * weight])
                self._basic.append(self._new(self.value[v] + sign * weight * most, *sides))
        return lag

    def _new(self, value: float, lower: float, upper: float) -> int:
        self.value.append(value)
        self.lower.append(lower)
        self.upper.append(upper)
        return len(self.value) - 1

    def _move(self, k: int, way: float, goal: float, target: int) -> tuple[int, bool]:
        """Move nonbasic variable k, up to the first bound in the way.

        Returns the row whose variable came to its bound, or -1, and whether the way was gone.
        """
        value, lower, upper = self.value, self.lower, self.upper
        x, sign = self._nonbasic[k], 1.0 if way > 0.0 else -1.0
        length, blocked, reached = abs(way), -1, True
        if target >= 0:
            own = upper[x] - value[x] if way > 0.0 else value[x] - lower[x]
            if own < length:
                length, reached = own, False
        # Bounds may be missed by rounding, so that of those in the way the fastest variable, which
        # makes the best pivot, is at its bound and not the first by rounding (Harris).
        coming, furthest = [], length
        for r, v in enumerate(self._basic):
            rate = sign * self._rates[r][k]
            if v == target or -ROUNDING < rate < ROUNDING:
                continue
            room = upper[v] - value[v] if rate > 0.0 else value[v] - lower[v]
            speed = abs(rate)
            if room < speed * furthest:
                coming.append((speed, room, r))
                furthest = min(furthest, (max(room, 0.0) + SLACK) / speed)
        fastest = 0.0
        for speed, room, r in coming:
            if speed > fastest and room <= speed * furthest < speed * length:
                fastest, blocked, reached = speed, r, False
                nearest = max(room, 0.0) / speed
        if blocked >= 0:
            length = min(nearest, length)
        step = sign * length
        value[x] += step
        for r, v in enumerate(self._basic):
            value[v] += step * self._rates[r][k]
        if blocked >= 0:
            v = self._basic[blocked]
            value[v] = upper[v] if sign * self._rates[blocked][k] > 0.0 else lower[v]
        elif not reached:
            value[x] = upper[x] if way > 0.0 else lower[x]
        return blocked, reached

    def _pivot(self, r: int, k: int) -> None:
        """Exchange the basic variable of row r and the nonbasic variable k."""
        row = self._rates[r]
        pivot = row[k]
        inverse = 1.0 / pivot
        self.doubt = max(self.doubt, SLACK * abs(inverse))
        fresh = [-rate * inverse for rate in row]
        fresh[k] = inverse
        self._rates[r] = fresh
        for i, other in enumerate(self._rates):
            factor = other[k]
            if i != r and factor:
                other[k] = 0.0
                self._rates[i] = [a + factor * b for a, b in zip(other, fresh)]  # noqa: B905
        self._basic[r], self._nonbasic[k] = self._nonbasic[k], self._basic[r]

    def _drop(self, kept: Sequence[bool]) -> None:
        """Leave out the nonbasic variables that are not kept: they do not move any more."""
        if all(kept):
            return
        self._nonbasic = [x for x, keep in zip(self._nonbasic, kept, strict=True) if keep]
        self._rates = [
            [rate for rate, keep in zip(row, kept, strict=True) if keep] for row in self._rates
        ]
