"""Designs of multirotors with rotors on a circle, and what each can do after a failure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import Any, NamedTuple

import numpy as np

from ca_ros.problem.audit import audit
from ca_ros.vehicle.vehicle import Vehicle

ORDERS_MAX = 20_000
"""Spin orders are enumerated up to this number: up to 16 rotors."""


class Design(NamedTuple):
    """A design: rotors at equal angles, the first in front, the others counter-clockwise.

    Attributes
    ----------
    arm : float
        Distance of the rotors from the centre [m].
    tilt : float
        Angle of each rotor about its arm [deg].  If it is positive, the thrust adds to the
        reaction torque of the rotor.
    spin : str
        A letter for each rotor: P for a positive reaction torque (the rotor turns clockwise seen
        from above), N for a negative one.
    """

    arm: float
    tilt: float
    spin: str

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the rotors by name, as in a parameter file."""
        angles = 2.0 * np.pi * np.arange(len(self.spin)) / len(self.spin)
        cos, sin, zero = np.cos(angles), np.sin(angles), np.zeros(len(angles))
        signs = np.array([1.0 if letter == 'P' else -1.0 for letter in self.spin])
        aside, up = signs * np.sin(np.radians(self.tilt)), np.cos(np.radians(self.tilt))
        axes = np.stack([-sin * aside, cos * aside, zero + up], axis=1)
        return {
            'rotors.positions': (self.arm * np.stack([cos, sin, zero], axis=1)).ravel().tolist(),
            'rotors.axes': axes.ravel().tolist(),
            'rotors.spins': ['cw' if letter == 'P' else 'ccw' for letter in self.spin],
        }


def spin_orders(n: int) -> list[str]:
    """Return the spin orders of n rotors with as many P as N (one more of either if n is odd).

    Of those that become each other by rotation, reflection, or reversal of all rotors, which can
    do the same, there is one: the last in the alphabet.

    Raises
    ------
    ValueError
        If there are too many.
    """
    if comb(n, n // 2) > ORDERS_MAX:
        raise ValueError(f'--spin: too many orders of {n} rotors; name some')
    found = set()
    for chosen in combinations(range(n), n // 2):
        order = ''.join('P' if i in chosen else 'N' for i in range(n))
        found.add(max(_alike(order)))
    return sorted(found)


def _alike(order: str) -> Iterator[str]:
    for one in (order, order.translate(str.maketrans('PN', 'NP'))):
        for i in range(len(order)):
            turned = one[i:] + one[:i]
            yield from (turned, turned[::-1])


@dataclass(frozen=True)
class DesignSpace:
    """The designs of a study: all combinations of values, or random designs.

    Attributes
    ----------
    arm, tilt : tuples of float
        Values of `Design`; of random designs the least and the greatest.
    spin : tuple of str
    seed : int or None
        Of random designs; None: all combinations.
    """

    arm: tuple[float, ...]
    tilt: tuple[float, ...]
    spin: tuple[str, ...]
    seed: int | None

    @property
    def combinations(self) -> int:
        """Number of combinations."""
        return len(self.arm) * len(self.tilt) * len(self.spin)

    def __getitem__(self, k: int) -> Design:
        """Return design k, which depends on k alone."""
        if self.seed is None:
            i, j, m = np.unravel_index(k, (len(self.arm), len(self.tilt), len(self.spin)))
            return Design(self.arm[i], self.tilt[j], self.spin[m])
        rng = np.random.default_rng([self.seed, k])
        arm, tilt = (float(rng.uniform(ends[0], ends[-1])) for ends in (self.arm, self.tilt))
        return Design(arm, tilt, self.spin[rng.integers(len(self.spin))])


@dataclass(frozen=True)
class DesignChunks:
    """The chunks of a design study; the call with a number computes that chunk.

    Attributes
    ----------
    parameters : mapping
        Of the vehicle, which gives all but the rotors' positions, axes and spins.
    designs : DesignSpace
    count, size : int
        Number of designs of the study and of a chunk.
    """

    parameters: Mapping[str, Any]
    designs: DesignSpace
    count: int
    size: int

    def __call__(self, number: int) -> list[dict[str, Any]]:
        """Return the rows of the designs of a chunk."""
        first = number * self.size
        numbers = range(first, min(first + self.size, self.count))
        return [row for k in numbers for row in self._rows(k)]

    def _rows(self, k: int) -> Iterator[dict[str, Any]]:
        """Yield the rows of a design: without a failure, then without each rotor."""
        design = self.designs[k]
        vehicle = Vehicle.from_parameters({**self.parameters, **design.parameters()})
        for failed in range(vehicle.n + 1):
            working = np.arange(1, vehicle.n + 1) != failed
            found = audit(vehicle.with_health(vehicle.health * working))
            row = {
                'design': k,
                **design._asdict(),
                'failed': failed,
                'hovers': int(found.hovers),
                'keeps_hovering': int(found.keeps_hovering),
                'lost': ' '.join(found.lost),
                'hover_margin': found.hover_margin,
            }
            for axis in vehicle.axes:
                low, high = found.authority.get(axis, (0.0, 0.0))
                row |= {f'{axis}_low': low, f'{axis}_high': high}
            yield row
