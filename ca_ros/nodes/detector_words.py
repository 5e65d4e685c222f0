"""What a detector has found, for status and log: in words, and in values."""

from collections.abc import Sequence

import numpy as np

from ca_ros.detection.kernel_detector import Detector
from ca_ros.detection.rotor_beliefs import words_of

FOUND = 'failure found of rotor '
"""Name of the values of the diagnostics that say when a failure was found."""

WITHHELD = 'named, not acted on'
"""Name of the value of the diagnostics with the rotors that `acted_on` withholds."""


def failures_found(detector: Detector) -> list[str]:
    """Return which rotors have failed, when that was found, and by what."""
    lost = detector.vehicle.with_health(detector.health).lost
    found = [i + 1 for i, since in enumerate(detector.since) if since is not None]
    failed = []
    for rotor, words in words_of(found, detector.failed_arms).items():
        i, arm = rotor - 1, words != str(rotor)
        left = f'weak, {100.0 * detector.health[i]:.0f} % left,'
        what = 'failed' if arm else 'lost' if lost[i] else left
        seconds = (detector.since[i] or 0) / 1e9
        failed.append(f'rotor {words} {what} since {seconds:.2f} s ({detector.evidence[i]})')
    return failed


def not_acted_on(withheld: Sequence[int]) -> list[str]:
    """Return which names are not acted on, and why."""
    rotors = ', '.join(map(str, withheld))
    why = 'no allocation would hold the vehicle level; if it is sure, announce it'
    return [f'not acted on: rotor {rotors} ({why})'] if rotors else []


def values_of(detector: Detector, withheld: Sequence[int]) -> dict[str, object]:
    """Return the values of a status."""
    health, (*failures, disturbance) = (
        [f'{share:.3g}' for share in shares]
        for shares in (detector.health, detector.probabilities)
    )
    lost = detector.vehicle.with_health(detector.health).lost
    return {
        'health': ', '.join(health),
        'lost rotors': ', '.join(f'{i + 1}' for i in np.flatnonzero(lost)) or 'none',
        WITHHELD: ', '.join(map(str, withheld)) or 'none',
        'probability of a failure': ', '.join(failures),
        'probability of a disturbance': disturbance,
        **{f'{FOUND}{i + 1} [ns]': time for i, time in enumerate(detector.since)
           if time is not None},
    }
