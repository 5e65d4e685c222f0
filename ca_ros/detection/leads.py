"""The lead that each rotor gathers in time over all else.

What loses less than half of its thrust shows in time: windows that do not overlap are
independent, so their evidence adds up.  In the window `GATHERED`, the lead of each rotor over all
else is gathered, as its integral over the length of the window, not below zero; `LASTING` of it
names a rotor.  A loss changes the trim, so while it is learnt again, no other rotor gathers.

A push down on the end of an arm begins with more than a rotor can lack, and lets the rotor owe
`DEBT`: later, when the controller has answered, or the vehicle has turned under the push, the
same push may look like a loss.  So may one that looked like none before: where a disturbance leads
a rotor by `LIMIT`, the rotor owes `SMALL_DEBT`, and none owes more once a suspicion lasts for
longer than a push.
"""

from collections.abc import Sequence

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.losses import LIMIT
from ca_ros.detection.windows import WINDOWS

LASTING = 4.0  # lead that a weak rotor gathers, from which it is named
GATHERED = 2  # the window in which leads are gathered, of `WINDOWS`

EXCESS, DOUBT, DEBT = 1.2, 3.0, 30.0
"""A rotor that would lack so much of its health, in the window in which a disturbance is likeliest
and leads it by `DOUBT`, owes a lead of `DEBT` before it is named: it gives no more than it has."""

SMALL_DEBT = 8.0  # lead that a rotor owes which a disturbance led far


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
    doubt = np.where(evidence > LIMIT, disturbance - evidence, 0.0)
    excess = (doubt > DOUBT) & (shares > EXCESS * health)
    owes = np.where(excess, DEBT, np.where(doubt > LIMIT, SMALL_DEBT, -np.inf))
    return np.minimum(leads, -owes)
