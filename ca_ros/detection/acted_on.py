"""Which of the named failures allocators are told to act on."""

from typing import NamedTuple

from ca_ros.allocation.reconfiguration import Arms
from ca_ros.arrays import Array
from ca_ros.detection.kernel_detector import Detector
from ca_ros.problem.audit import audit


class ActedOn(NamedTuple):
    """What allocators are told of the failures that a detector has named.

    - `health` (n,): the announced health, less the failures to act on
    - `arms`: the failed arms among these
    - `withheld`: the rotors, from 1, whose failures are named, but not to act on
    """

    health: Array
    arms: Arms
    withheld: tuple[int, ...]


def acted_on(detector: Detector) -> ActedOn:
    """Return which of the failures that a detector has named allocators are to act on.

    All but those after which the vehicle could not hover level any more (`Audit.keeps_level`).
    There no allocation saves the flight if the name is right, and the allocation loses it if the
    name is wrong.  Each name counts with those before it that are acted on; rotors that were named
    in the same test count together.
    """
    vehicle, found, order = detector.vehicle, detector.health, detector.order
    health, withheld = vehicle.health.copy(), list[int]()
    arms: Arms = ()
    names = sorted({*order} - {0})
    level = not names or audit(vehicle).keeps_level
    for name in names:
        rotors = [i for i, each in enumerate(order) if each == name]
        less = health.copy()
        less[rotors] = found[rotors]
        pairs = (*arms, *(pair for pair in detector.failed_arms if pair[0] - 1 in rotors))
        # While their health is estimated, the rotors of an arm may differ.
        alike = [(i, j) for i, j in pairs if less[i - 1] == less[j - 1]]
        after = audit(vehicle.with_health(less, alike)).keeps_level
        if after or not level:
            health, arms, level = less, pairs, after
        else:
            withheld += [i + 1 for i in rotors]
    return ActedOn(health, arms, tuple(sorted(withheld)))
