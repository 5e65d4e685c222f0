"""Lexicographic linear programs over bounded variables."""

from __future__ import annotations

from collections.abc import Sequence

from ca_ros.arrays import Array

ZERO = 1e-8  # rate below which a variable does not depend on another; rates are of the order of 1
SLACK = 1e-12  # distance by which rounding may move a variable out of its bounds
RATE_MIN = 1e-9  # rate below which a variable does not block a move
MAGNIFIED = 1e-3  # share of `doubt` below which a rate may be magnified rounding errors

AT_BOUND = 0.1  # weight of the rate of a variable near its bound that is to enter without a move
NEAR = 1e-3  # distance from a bound that counts as near
SPREAD = 0.9  # greatest share of the way to a bound where a line begins, if it need not be nearer
PIVOTS_PER_VARIABLE = 3  # limit of one push; the tests need one at most


class Simplex:
    """The simplex method for bounded variables, for goals in lexicographic order.

    The variables are x_1 ... x_n, between -1 and 1, and the rows ``y = A x``, which have no bounds
    at first.  The state is a dictionary: m basic variables as linear functions of the nonbasic
    ones.  All variables always satisfy their bounds.  `push` moves one variable towards its goal,
    as far as the bounds of the others allow.

    `matrix` (m, n): A; the absolute values in each row add up to 1.

    - `value`: the variables: n entries of x, m of y, and what `add_ray` adds
    - `lower` and `upper`: their bounds
    - `doubt`: error estimate: a bound of the distance that pushes missed because of `ZERO` and of
      rounding errors, which pivots magnify
    - `proof`: if the last push has not reached its goal: by how much the variable would come
      nearer to it per unit of each nonbasic variable.  The bounds of these variables prove that it
      cannot
    """

    def __init__(self, matrix: Array) -> None:
        m, n = matrix.shape
        self._rates: list[list[float]] = matrix.tolist()
        self._thrusts = n
        self._basic = list(range(n, n + m))
        self._nonbasic = list(range(n))
        self.value = [0.0] * (n + m)
        self.lower = [-1.0] * n + [-float('inf')] * m
        self.upper = [1.0] * n + [float('inf')] * m
        self.doubt = SLACK
        self.proof: dict[int, float] = {}

    def copy(self) -> Simplex:
        """Return an independent copy."""
        other = Simplex.__new__(Simplex)
        other._rates = [row[:] for row in self._rates]
        other._basic, other._nonbasic = self._basic[:], self._nonbasic[:]
        other._thrusts = self._thrusts
        other.value, other.lower, other.upper = self.value[:], self.lower[:], self.upper[:]
        other.doubt, other.proof = self.doubt, {}
        return other

    def between(self, lower: Sequence[float], upper: Sequence[float]) -> Simplex:
        """Return a copy of the initial state with narrower bounds of x, at their middle."""
        other = self.copy()
        n = len(lower)
        other.lower[:n], other.upper[:n] = lower, upper
        other.value[:n] = [(low + high) / 2.0 for low, high in zip(lower, upper, strict=True)]
        other.value[n:] = [
            sum(rate * x for rate, x in zip(row, other.value, strict=False)) for row in self._rates
        ]
        return other

    def push(self, v: int, goal: float) -> bool:
        """Move variable v as far towards a goal as the bounds of all others allow.

        Later pushes never move v away from the goal again.

        The result: whether v has reached the goal.
        """
        reached = self.approach(v, goal)
        self.lower[v], self.upper[v] = sorted((self.value[v], goal))
        return reached

    def approach(self, v: int, goal: float) -> bool:
        """Like `push`, but later pushes may move v away."""
        self.proof = {}
        return self.value[v] == goal or self._push(v, goal)

    def confine(self, v: int, low: float, high: float) -> None:
        """Keep variable v between two values, or between these and the nearest possible one."""
        self.approach(v, min(max(self.value[v], low), high))
        self.lower[v], self.upper[v] = min(low, self.value[v]), max(high, self.value[v])

    def _push(self, v: int, goal: float) -> bool:
        value, lower, upper = self.value, self.lower, self.upper
        if v in self._nonbasic:
            if lower[v] == upper[v]:
                return False
            k = self._nonbasic.index(v)
            blocked, reached = self._move(k, goal - value[v], -1)
            if reached:
                value[v] = goal
                return True
            self._pivot(blocked, k)
        r = self._basic.index(v)
        for pivot in range(PIVOTS_PER_VARIABLE * len(value)):
            left, best, k = goal - value[v], self.above_noise(ZERO), -1
            for j, (rate, x) in enumerate(zip(self._rates[r], self._nonbasic)):  # noqa: B905
                if abs(rate) > best and (
                    value[x] < upper[x] if (rate > 0.0) == (left > 0.0) else value[x] > lower[x]
                ):
                    best, k = abs(rate), j
                    if pivot > len(value):
                        # Take the first that moves v, not the fastest, to prevent cycles.
                        break
            if k < 0:
                sign = 1.0 if left > 0.0 else -1.0
                row = zip(self._nonbasic, self._rates[r], strict=True)
                self.proof = {x: sign * rate for x, rate in row}
                for x, rate in self.proof.items():
                    if abs(rate) <= best:
                        room = upper[x] - value[x] if rate > 0.0 else value[x] - lower[x]
                        self.doubt += abs(rate) * min(room, 2.0)
                return False
            blocked, reached = self._move(k, left / self._rates[r][k], v)
            if reached:
                value[v] = goal
                return True
            if blocked >= 0:
                self._pivot(blocked, k)
        return False

    def above_noise(self, rate: float) -> float:
        """Return a threshold of rates, above the rounding errors that pivots have magnified."""
        return max(rate, MAGNIFIED * self.doubt)

    def spread(self, v: int, goal: float) -> None:
        """Move basic variable v towards a goal by all nonbasic ones, in proportion to their rates.

        Few thrusts end at their bounds: it goes at most `SPREAD` of the way to the first bound.
        """
        value, lower, upper = self.value, self.lower, self.upper
        row = self._rates[self._basic.index(v)]
        moves = [rate * (lower[x] < upper[x]) for rate, x in zip(row, self._nonbasic, strict=True)]
        square = sum(rate * rate for rate in moves)
        if not square > 0.0:
            return
        factor = (goal - value[v]) / square
        changes = {x: factor * rate for x, rate in zip(self._nonbasic, moves, strict=True)}
        for x, rates in zip(self._basic, self._rates, strict=True):
            ways = zip(changes.values(), rates, strict=False)
            changes[x] = sum(way * rate for way, rate in ways)
        share = 1.0
        for x, change in changes.items():
            room = upper[x] - value[x] if change > 0.0 else lower[x] - value[x]
            if share * abs(change) > SPREAD * abs(room):
                share = SPREAD * room / change
        for x, change in changes.items():
            value[x] += share * change
        if share == 1.0:
            value[v] = goal

    def release(self, v: int) -> None:
        """Fix variable v at its value, and make it nonbasic."""
        self.lower[v] = self.upper[v] = self.value[v]
        if v in self._basic:
            r = self._basic.index(v)
            # A thrust near its bound would soon block, however small its rate.  One whose bounds
            # have met is the last choice.
            sizes = [
                abs(rate) if self.lower[x] + NEAR < self.value[x] < self.upper[x] - NEAR
                else AT_BOUND * abs(rate) if self.lower[x] < self.upper[x]
                else 1e-6 * abs(rate) * (x < self._thrusts)
                for rate, x in zip(self._rates[r], self._nonbasic, strict=True)
            ]
            self._pivot(r, sizes.index(max(sizes)))

    def normalize(self, v: int) -> None:
        """Scale a basic variable so that its rates are of the order of 1, as those of the others.

        The lag of small weights has greater ones, and as much greater rounding errors.
        """
        if v in self._basic:
            r = self._basic.index(v)
            greatest = max(1.0, *map(abs, self._rates[r]))
            self._rates[r] = [rate / greatest for rate in self._rates[r]]
            for numbers in (self.value, self.lower, self.upper):
                numbers[v] /= greatest

    def hold(self, rows: Sequence[int], goals: Sequence[float]) -> None:
        """Push variables to their goals, one after the other, and release each there."""
        for v, goal in zip(rows, goals, strict=True):
            self.spread(v, goal)
            self.push(v, goal)
            self.release(v)

    def add_ray(self, rows: Sequence[int], direction: Sequence[float]) -> int:
        """Add a variable, the distance that nonbasic variables move together along a line.

        `rows`: nonbasic variables that are released; they move along such lines only, and their
        values are those where the lines begin.  `direction`: their changes per unit of the new
        variable; of the order of 1.

        The result: the new variable.
        """
        places = [self._nonbasic.index(v) for v in rows]
        ways = list(zip(places, direction, strict=True))
        for rates in self._rates:
            rates.append(sum(way * rates[k] for k, way in ways))
        self._nonbasic.append(self._new(0.0, 0.0, float('inf')))
        return len(self.value) - 1

    def add_lag(
        self, rows: Sequence[int], goals: Sequence[float], weights: Sequence[float]
    ) -> int:
        """Add a variable, the greatest weighted distance of some variables to their goals.

        The result: the new variable; it is nonbasic, and its goal is 0.
        """
        lagging = list(zip(rows, goals, weights, strict=True))
        most = max(abs(goal - self.value[v]) / weight for v, goal, weight in lagging)
        for rates in self._rates:
            rates.append(0.0)
        lag = self._new(most, 0.0, most)
        self._nonbasic.append(lag)
        for v, goal, weight in lagging:
            if v in self._basic:
                rates = self._rates[self._basic.index(v)]
            else:
                rates = [float(x == v) for x in self._nonbasic]
            for sign in (1.0, -1.0):
                # The variable plus its share of the lag is at the goal or beyond, on either side.
                sides = (goal, float('inf')) if sign > 0.0 else (-float('inf'), goal)
                self._rates.append([*rates[:-1], sign * weight])
                self._basic.append(self._new(self.value[v] + sign * weight * most, *sides))
        return lag

    def _new(self, value: float, lower: float, upper: float) -> int:
        self.value.append(value)
        self.lower.append(lower)
        self.upper.append(upper)
        return len(self.value) - 1

    def _move(self, k: int, way: float, target: int) -> tuple[int, bool]:
        """Move nonbasic variable k, at most to the first bound that blocks it.

        Return the row of the variable that blocks, or -1, and whether the move was completed.
        """
        value, lower, upper = self.value, self.lower, self.upper
        x, sign = self._nonbasic[k], 1.0 if way > 0.0 else -1.0
        length, blocked, reached = abs(way), -1, True
        if target >= 0:
            own = upper[x] - value[x] if way > 0.0 else value[x] - lower[x]
            if own < length:
                length, reached = own, False
        # Harris's ratio test: bounds may be exceeded by rounding errors, so that of the variables
        # that block almost together the fastest one, the best pivot, leaves the basis.
        least = self.above_noise(RATE_MIN)
        coming, furthest = [], length
        for r, v in enumerate(self._basic):
            rate = sign * self._rates[r][k]
            if v == target or -least < rate < least:
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
