"""What is changed by a finding: what is believed of rotors, and what that explains."""

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from ca_ros.arrays import Array
from ca_ros.detection.hypothesis_test import TELLING, Finding, HypothesisTest
from ca_ros.detection.rotor_beliefs import CERTAIN, IN_A_ROW, REFINED, TOLD, RotorBeliefs
from ca_ros.detection.suspicion import Suspicion
from ca_ros.detection.windows import Windows

TOTAL = 0.8
"""Greatest loss of a rotor that is not lost when it is named: one that keeps less would be given
commands so low that its health cannot be estimated further."""


class BeliefChanges:
    """Changes what is believed, as if from the start of the windows on.

    - `beliefs`, `hypotheses` and `suspicion`
    - `windows`: they lack less by what a rotor is found to have lost
    """

    def __init__(
        self, beliefs: RotorBeliefs, hypotheses: HypothesisTest, suspicion: Suspicion,
        windows: Windows,
    ) -> None:
        self.beliefs, self._hypotheses, self._suspicion = beliefs, hypotheses, suspicion
        self.windows = windows

    def forget(self, before: int | None = None) -> None:
        """Forget the motion, or that before a window, and what rotors have gathered."""
        self.windows.forget(before)
        self._suspicion.leads = np.zeros(self.beliefs.vehicle.n)

    def refine(self, found: Finding, recent: list[int]) -> bool:
        """Estimate the health of rotors that have just failed; return whether it changes."""
        clear = np.abs(found.shares) > np.maximum(0.05, 3.0 * found.errors)
        rotors = [i for i in recent if clear[i] and self.beliefs.health[i] > 0.0]
        held = self.beliefs.held
        for rotor in rotors:
            share = float(found.shares[rotor])
            self._reduce(rotor, 0.5 * share if rotor in held else share)
        self.beliefs.close_arms()
        return bool(rotors)

    def name(self, time: int, found: Finding, planar: Sequence[int]) -> bool:
        """Let the rotors that a test names have failed; return whether the health changes."""
        beliefs, block = self.beliefs, self.windows.block
        self.forget(before=found.window)
        # The window may have begun a block before the failure.
        age = self.windows.ages[found.window]
        longer = age / max(age - block, block)
        before, probabilities = beliefs.health, found.probabilities
        if len(found.named) - len(found.arms) == 2:
            self._give_back_between(found)
        arms = [rotor for arm in found.arms for rotor in arm]
        for rotor in set(found.named) - set(arms):
            self._give_back_partner(rotor, found)
        order = beliefs.next_name
        for rotor, share in zip(found.named, found.lost.tolist(), strict=True):
            half = rotor in arms and rotor not in beliefs.held
            whole = beliefs.health[rotor] * (0.5 if half else 1.0)
            if share * longer >= TOTAL * whole:
                share = whole
            certainty = beliefs.found[rotor] or probabilities[rotor]
            beliefs.found[rotor] = 0.5 if rotor in arms else max(certainty, CERTAIN)
            if found.angle is None:
                self.fail(rotor, share, time, order, 'motion')
            else:
                self._stick(rotor, found.angle, time, order, planar)
        for arm in found.arms:
            beliefs.name_arm(*arm)
        beliefs.close_arms()
        return not np.array_equal(beliefs.health, before)

    def _give_back_between(self, found: Finding) -> None:
        """Give back the rotors whose failure has just explained what two others lack."""
        beliefs = self.beliefs
        for rotor in set(beliefs.failed(REFINED)) - {*found.named, *beliefs.held}:
            if beliefs.evidence[rotor] == 'motion':
                self._give_back(rotor)

    def _give_back_partner(self, rotor: int, found: Finding) -> None:
        """Give back the partner of a coaxial rotor: it may just have been named for this one.

        If both have failed, the motion names it again, and the arm gives nothing meanwhile, too.
        """
        beliefs, partner = self.beliefs, self._hypotheses.partners[rotor]
        if partner is None or partner in {*found.named, *beliefs.held}:
            return
        if partner in beliefs.failed(TOLD) and beliefs.evidence[partner] == 'motion':
            self._give_back(partner)

    def _give_back(self, rotor: int) -> None:
        """Let a rotor be sound, as if from the start of the windows on."""
        lost = self.beliefs.lost(rotor)
        self.beliefs.give_back(rotor)
        self._suspicion.drop(rotor)
        self._reduce(rotor, -lost)

    def fail(self, rotor: int, share: float, time: int, order: int, evidence: str) -> None:
        """Take a share of a rotor's health, which failed by some evidence."""
        self.beliefs.find(rotor, time, order, evidence)
        self.beliefs.refined[rotor] = 0.0
        self._reduce(rotor, share)

    def _reduce(self, rotor: int, share: float) -> None:
        """Take a share of a rotor's health, as if from the start of the windows on."""
        less = self.beliefs.reduce(rotor, share)
        given = self.windows.blocks[:, :, : self.beliefs.vehicle.n]
        signature = given + self._hypotheses.drags(given, self.windows.laterals)
        self.windows.explain(less * signature[:, :, rotor])

    def _stick(
        self, rotor: int, angle: float, time: int, order: int, planar: Sequence[int]
    ) -> None:
        """Let a rotor's servo stick."""
        self.beliefs.find(rotor, time, order, f'servo sticks at {angle:.2f} rad')
        # What it gives until it stops is known.
        n = self.beliefs.vehicle.n
        for column, share in (
            (rotor, 1.0), (n + planar.index(rotor), -cos(angle)),
            (n + len(planar) + planar.index(rotor), -sin(angle)),
        ):
            lost = share * self.beliefs.delivered[rotor]
            self.windows.explain(lost * self.windows.blocks[:, :, column])
        self.beliefs.stick(rotor, angle)

    def tell_arms(self, impulses: Array, variance: Array) -> bool:
        """Tell which rotors of new arms have failed, where it shows; return whether it does."""
        windows, arms, told = self.windows, self.beliefs.arms, []
        new = self.beliefs.new_arms
        if not new:
            return False
        evidences = self._hypotheses.of_arms(
            windows.lacked, impulses, windows.lateral, variance, list(arms),
            self.beliefs.lost_by_arms())
        for (pair, count), evidence in zip(arms.items(), evidences.tolist(), strict=True):
            if pair not in new:
                continue
            sign = int(evidence > TELLING) - int(evidence < -TELLING)
            arms[pair] = sign + count if sign * count > 0 else sign
            if abs(arms[pair]) >= IN_A_ROW:
                told.append(pair if sign > 0 else pair[::-1])
        for failed, sound in told:
            self.tell_arm(failed, sound)
        return bool(told)

    def tell_arm(self, failed: int, sound: int) -> None:
        """Let one rotor of a named arm have failed, and the other one be sound."""
        lost = self.beliefs.lost(failed)
        self.beliefs.tell_arm(failed, sound)
        self._reduce(failed, lost)
        self._give_back(sound)
