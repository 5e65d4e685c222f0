"""What was cut of the demands of a node since its start, and what limited it."""

from collections.abc import Mapping

from ca_ros.allocation import Allocation
from ca_ros.problem.limits import shares

EXPLAINED_MAX = 10000  # choices of rotors up to which answers are explained, in time


def explained(answer: Allocation) -> bool:
    """Return whether an answer is explained while a node flies."""
    return answer.problem.program.facet_choices <= EXPLAINED_MAX


class Cuts:
    """The answer that served the least of each axis, with its stamp [ns].

    `add` is for the time in which a command waits: it notes an answer, and `update` does the rest.
    """

    def __init__(self) -> None:
        self._new: list[tuple[int, Allocation]] = []
        self._least: dict[str, tuple[float, int, Allocation]] = {}

    def add(self, time: int, answer: Allocation) -> None:
        """Note an answer to a demand with a stamp [ns] that it does not serve in full."""
        self._new.append((time, answer))

    def update(self) -> None:
        """Take what was noted."""
        new, self._new = self._new, []
        for time, answer in new:
            served = shares(answer.problem, answer.demand, answer.wrench).tolist()
            for axis, share in zip(answer.problem.axes, served, strict=True):
                if share < self._least.get(axis, (1.0,))[0]:
                    self._least[axis] = share, time, answer

    def values(self) -> Mapping[str, object]:
        """Return for each axis that was cut the least share, when, and why, for diagnostics."""
        self.update()
        found: dict[str, object] = {}
        for axis, (share, time, answer) in self._least.items():
            found[f'least {axis} served [%]'] = f'{100.0 * share:.1f}'
            found[f'least {axis} served at [ns]'] = time
            if explained(answer):
                found[f'least {axis} served limited by'] = answer.explanation.limits.get(axis, '')
        return found
