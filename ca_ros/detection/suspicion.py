"""What is suspected: of whom, for how long, and what tests in a row have named."""

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.hypothesis_test import Finding
from ca_ros.detection.losses import LIMIT

CONFIRMATIONS = 3  # tests of a suspicion that name the same rotors, and no others

SUSPICION, PATIENCE = 6.0, 0.995
"""Evidence from which the noise is not learnt, and for how long at most [s]."""

NOBODY = np.zeros(())


class Suspicion:
    """A suspicion that the motion raises.

    - `waited`: for how long it has lasted [s]; 0: there is none
    - `leads` (n,): what each rotor has gathered; see `ca_ros.detection.leads`
    - `probabilities` (n + 1,): that each rotor has failed, and of a disturbance, in the last test;
      () without a suspicion
    - `suspect`: see `FailureDetector`; `margin`: see `margin_of`
    """

    def __init__(self, n: int) -> None:
        self._n, self.margin = n, 0.0
        self.clear()

    def clear(self) -> None:
        """Suspect nothing."""
        self.waited, self._count = 0.0, 0
        self._named: tuple[tuple[int, ...], tuple[tuple[int, int], ...]] = (), ()
        self.leads: Array = np.zeros(self._n)
        self.probabilities: Array = NOBODY
        self.suspect: int | None = None

    @property
    def lately(self) -> bool:
        """Whether it has not yet lasted for `PATIENCE`."""
        return 0.0 < self.waited < PATIENCE

    @property
    def patient_leads(self) -> Array:
        """What each rotor has gathered (n,): none owes anything once a push would be over."""
        return np.maximum(self.leads, 0.0) if self.waited >= PATIENCE else self.leads

    def go_on(self, found: Finding, block: float, suspected: bool) -> None:
        """Take what a test finds, after a further time [s]."""
        self.waited = self.waited + block if suspected else 0.0
        self.margin = found.margin
        self.suspect = found.rotor if found.evidence[found.rotor] > LIMIT else None
        self.probabilities = found.probabilities

    def confirms(self, found: Finding) -> bool:
        """Return whether the same rotors, and no others, are named in enough tests."""
        if not found.named:
            return False
        named = found.named, found.arms
        self._count = self._count + 1 if named == self._named else 1
        self._named = named
        if self._count < CONFIRMATIONS:
            return False
        self._count = 0
        return True

    def drop(self, rotor: int) -> None:
        """Suspect a rotor no more."""
        self.probabilities = np.where(np.arange(self._n + 1) == rotor, 0.0, self.probabilities)
