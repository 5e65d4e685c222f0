"""Rotors whose measured speeds do not follow their commands."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.pairs import LEAST_LOSS
from ca_ros.detection.rotor_beliefs import IN_A_ROW

STALE = 60_000_000
"""Time after a command in which the next one comes [ns]; motors without commands may idle."""

LATE = 100_000_000
"""Lateness of a message on a busy machine [ns]."""

MOST = 2  # rotors that fail at once
KEPT = 100  # speeds of an interval that are kept


def oldest_measurement(settings: DetectorSettings) -> int:
    """Return how much older than the last command measured speeds may be [ns]."""
    return LATE + round(1e9 * (settings.motor_time_constant + settings.delay))


class SlowRotors:
    """Finds rotors that are much slower than their commands allow, and not approaching them.

    A busy machine may bring commands to the motors, or any message to this detector, a tenth of a
    second late.  So a rotor is compared with the least of its commands, and of the speeds that
    they should have given by the stamps of the states, in as long before as measured speeds may
    be old (`oldest_measurement`), or half as long again.  After a gap between commands it is
    compared with nothing for as long, as some may have been lost.  Older speeds are ignored.

    `n`: number of rotors.
    """

    def __init__(self, n: int, settings: DetectorSettings) -> None:
        self._share, self._n = (1.0 - LEAST_LOSS) ** 0.5, n
        self._oldest = oldest_measurement(settings)
        self._commanded: int | None = None
        self._interval = 0
        self._forget()
        self.reset()

    def reset(self) -> None:
        """Forget all measurements."""
        self._measured, self._slow = np.full(self._n, np.inf), np.zeros(self._n, int)

    def _forget(self) -> None:
        """Compare with zero until all of the last intervals are new."""
        self._expected = [[np.zeros(self._n)] for _ in range(3)]

    def command(self, time: int, speeds: Array) -> None:
        """Take commanded speeds (n,) [rad/s] with their stamp [ns]."""
        if self._commanded is None or time - self._commanded >= STALE:
            self._forget()
        self._commanded = time
        self._keep(speeds)

    def expect(self, time: int, speeds: Array) -> None:
        """Take the speeds (n,) [rad/s] that the commands should have given at a time [ns]."""
        # Speeds are kept of the present interval, and of the two before it.
        if (interval := time // (self._oldest // 2)) != self._interval:
            self._interval = interval
            self._expected = [[], *self._expected[:2]]
        self._keep(speeds)

    def _keep(self, speeds: Array) -> None:
        kept = self._expected[0]
        kept.append(speeds)
        if len(kept) > KEPT:
            kept[:] = [np.abs(kept).min(axis=0)]

    def measure(self, time: int, speeds: Array, sound: Array) -> list[tuple[int, float]] | None:
        """Return the rotors that have failed, each with the share of its thrust that it lost.

        None if more than two rotors are slow at once: then commands do not arrive.

        - `time`: [ns]
        - `speeds` (n,): measured [rad/s]
        - `sound` (n,): which rotors are not known to have failed
        """
        if self._commanded is not None and self._commanded - time > self._oldest:
            return []
        last = [each for interval in self._expected for each in interval]
        expected, measured = np.abs(last).min(axis=0), np.abs(speeds)
        fresh = self._commanded is not None and time - self._commanded < STALE
        slow = fresh & (measured < self._share * expected)
        slow &= measured <= self._measured + 0.01 * expected
        self._measured = measured
        if np.count_nonzero(slow & sound) > MOST:
            self._slow[:] = 0
            return None
        self._slow = np.where(slow, self._slow + 1, 0)
        failed = np.flatnonzero(self._slow == IN_A_ROW).tolist()
        return [(i, 1.0 - float(measured[i] / expected[i]) ** 2) for i in failed]
