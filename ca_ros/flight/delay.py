"""A delay by a whole number of steps."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

from ca_ros.settings import ParameterError

T = TypeVar('T')

STEPS_MAX = 1_000_000  # greatest delay in steps; each step takes memory


class Delay(Generic[T]):
    """Returns what it was given some steps ago.

    `steps`: 0: no delay.  `first`: what is returned before that.
    """

    def __init__(self, steps: int, first: T) -> None:
        self._line = deque([first] * steps)

    def __call__(self, value: T) -> T:
        """Put a value in, and return the one of `steps` calls ago."""
        self._line.append(value)
        return self._line.popleft()


def delay_steps(name: str, delay: float, step: float) -> int:
    """Return a delay in steps [s]; raise a `ParameterError` if it is no whole number of steps.

    More than `STEPS_MAX` steps are an error, too.
    """
    steps = round(delay / step)
    if steps > STEPS_MAX:
        raise ParameterError(f'{name}: expected up to {STEPS_MAX * step:g} s, got {delay:g} s')
    if abs(steps * step - delay) > 1e-6 * step:
        raise ParameterError(
            f'{name}: expected a multiple of simulator.time_step / simulator.sub_steps, '
            f'{step:g} s, got {delay:g} s'
        )
    return steps
