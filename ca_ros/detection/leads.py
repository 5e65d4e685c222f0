"""The lead that each rotor gathers in time over all else.

A weak rotor shows in time: windows that do not overlap are independent, so their evidence adds up.
In the window `GATHERED`, the lead of each rotor over all else is gathered, as its integral over
the length of the window, not below zero; `LASTING` of it names a rotor.  A loss changes the trim,
so while it is learnt again, no other rotor gathers.

A push may look like a loss later, when the controller has answered, or the vehicle has turned
under it.  So a rotor that a disturbance led by `DOUBT` owes `SMALL_DEBT`.  It owes `DEBT` if the
push, such as one down on the end of its arm, was more than it can lack.  No rotor owes anything
once a suspicion lasts for longer than a push.  No rotor comes to owe anything while a loss is
recent: the recent one may be one of two, or may have been named in place of its partner.
"""

from collections.abc import Sequence

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.losses import LIMIT
from ca_ros.detection.windows import WINDOWS

LASTING = 4.0  # lead that a weak rotor gathers, from which it is named
GATHERED = 2  # the window in which leads are gathered, of `WINDOWS`

DOUBT = 6.0  # lead of a disturbance from which a rotor owes a lead before it is named
SMALL_DEBT = 8.0  # what it owes
EXCESS, DEBT = 1.2, 30.0
"""A rotor that would lack more than `EXCESS` of its health, in the window in which a disturbance
is likeliest, owes `DEBT` instead: it gives no more than it has."""


def gathered(
    leads: Array, block: float, evidence: Array, servos: Array, disturbance: float,
    partners: Sequence[int | None], recent: Sequence[int] = (),
) -> Array:
    """Return what each rotor has gathered (n,) after a further time.

    - `leads` (n,): what each had gathered before; negative: what it owes
    - `block`: the further time [s]
    - `evidence` (n,) and `disturbance`: in the window `GATHERED`
    - `servos` (n,): the evidence for servos that stick
    - `partners` (n,): the other rotor of each one's coaxial pair, over which it need not lead
    - `recent`: rotors that have just failed; others gather nothing, but what they owe
    """
    n = len(leads)
    others = np.tile(np.maximum(evidence, servos), (n, 1))
    np.fill_diagonal(others, servos)
    for i, partner in enumerate(partners):
        if partner is not None:
            others[i, partner] = 0.0
    lead = np.minimum(evidence - np.maximum(others.max(axis=1), disturbance), LIMIT)
    most = [0.0 if {*recent} - {i, partner} else np.inf for i, partner in enumerate(partners)]
    return np.maximum(
        np.minimum(leads + block / WINDOWS[GATHERED] * lead, most), np.minimum(leads, 0.0))


def owed(
    leads: Array, shares: Array, health: Array, evidence: Array, disturbance: float
) -> Array:
    """Return what each rotor has gathered (n,), less what it owes.

    - `leads`, `health` and `evidence` (n,)
    - `shares` (n,): what each would have lost in the window in which a disturbance is likeliest
    - `disturbance`: the evidence for it
    """
    doubted = (evidence > LIMIT) & (disturbance - evidence > DOUBT)
    owes = np.where(shares > EXCESS * health, DEBT, SMALL_DEBT)
    return np.where(doubted, np.minimum(leads, -owes), leads)
