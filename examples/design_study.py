"""Rank vehicles with rotors on a circle by what they can do in hover, also after a failure."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ca_ros import Vehicle, audit
from ca_ros.vehicle.geometry import ring
from ca_ros.vehicle.settings import RingSettings

Row = dict[str, Any]
COUNTED = 'hovers', 'keeps_hovering'
RANKS: dict[str, Callable[[Row], Any]] = {
    'Greatest hover margin': lambda row: row['hover margin'][0],
    'Most failures with hover on all axes': lambda row: (row['hovers'], row['tilting'][1]),
    'Greatest roll and pitch authority after the worst failure': lambda row: row['tilting'][1],
}


class Design(NamedTuple):
    """The rotors at equal angles, the first in front, the others counter-clockwise.

    The arm is their distance from the centre [m], the tilt their angle about their arms [deg]; if
    it is positive, the thrust adds to the reaction torque.  The spin has a letter for each rotor:
    P if it turns clockwise seen from above, N otherwise.
    """

    arm: float
    tilt: float
    spin: str

    def vehicle(self, base: Vehicle) -> Vehicle:
        """Return `base` with this geometry."""
        circle = ring(RingSettings(count=len(self.spin), radius=1.0))
        spins = np.array([1.0 if letter == 'P' else -1.0 for letter in self.spin])
        aside, up = spins * np.sin(np.radians(self.tilt)), np.cos(np.radians(self.tilt))
        x, y, z = circle.T
        axes = np.column_stack([-y * aside, x * aside, z + up])
        return replace(base, arms=self.arm * circle, rotor_axes=axes, spins=spins)


def spin_orders(n: int) -> list[str]:
    """Return the orders of n rotors with as many P as N, one more of either if n is odd.

    One stands for those that become each other by rotation, reflection or reversal.
    """
    orders = set()
    for chosen in combinations(range(n), n // 2):
        order = ''.join('P' if i in chosen else 'N' for i in range(n))
        pair = order, order.translate(str.maketrans('PN', 'NP'))
        turned = [one[i:] + one[:i] for one in pair for i in range(n)]
        orders.add(max(turned + [one[::-1] for one in turned]))
    return sorted(orders)


def draw(given: argparse.Namespace, k: int, spins: list[str]) -> Design:
    """Return random design k, which depends on the seed and on k alone."""
    rng = np.random.default_rng([given.seed, k])
    arm, tilt = rng.uniform(*given.arm), rng.uniform(*given.tilt)
    return Design(arm, tilt, spins[rng.integers(len(spins))])


def examine(design: Design, base: Vehicle) -> Row:
    """Return hover margin and authority of a design: without a failure, after the worst one.

    Authority is what an axis can do about hover in its weaker direction, 0 if it is lost; `hovers`
    and `keeps_hovering` count the failures after which all axes, or the rest, allow hover.
    """
    sound = design.vehicle(base)
    cases = [sound, *(sound.with_health(sound.health * row) for row in 1.0 - np.eye(sound.n))]
    audits = [audit(vehicle) for vehicle in cases]
    values = {'hover margin': [each.hover_margin for each in audits]}
    for axis in sound.axes:
        ends = [each.authority.get(axis, (0.0, 0.0)) for each in audits]
        values[axis] = [max(0.0, min(-low, high)) for low, high in ends]
    values['tilting'] = list(np.minimum(values['roll'], values['pitch']))
    row: Row = {name: (whole, min(failed)) for name, (whole, *failed) in values.items()}
    counted = {name: sum(getattr(each, name) for each in audits[1:]) for name in COUNTED}
    return row | counted


def main(argv: list[str] | None = None) -> None:
    """Print the best designs as tables in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add('--vehicle', default='hexarotor', help='gives mass and rotors')
    add('--designs', type=int, default=1000, metavar='N', help='number of random designs')
    add('--arm', type=float, nargs=2, default=[0.2, 0.6], metavar='METRE', help='from and to')
    add('--tilt', type=float, nargs=2, default=[0.0, 30.0], metavar='DEGREE', help='from and to')
    add('--spin', nargs='+', metavar='ORDER', help='such as PNPNPN (default: all as balanced)')
    add('--seed', type=int, default=0)
    add('--best', type=int, default=3, metavar='N', help='length of the tables')
    given = parser.parse_args(argv)
    base = Vehicle.load(given.vehicle)
    if not given.spin and base.n > 16:
        parser.error(f'--spin: there are too many orders of {base.n} rotors, name some')
    spins = given.spin or spin_orders(base.n)
    for spin in spins:
        if len(spin) != base.n or set(spin) - set('PN'):
            parser.error(f'--spin {spin}: expected {base.n} letters, P or N')
    shown = 'hover margin', *base.axes
    drawn = (draw(given, k, spins) for k in range(given.designs))
    rows = [(design, examine(design, base)) for design in drawn]
    for title, key in RANKS.items():
        print(f'\n### {title}\n\n| spin | arm [m] | tilt [°] | {" | ".join(shown)} | hovers |')
        print('| --- |' + ' ---: |' * (len(shown) + 3))
        for design, row in sorted(rows, key=lambda each: key(each[1]), reverse=True)[: given.best]:
            cells = [design.spin, f'{design.arm:.3g}', f'{design.tilt:.1f}']
            cells += [f'{row[name][0]:.3g} / {row[name][1]:.3g}' for name in shown]
            cells.append(f'{row["hovers"]} / {row["keeps_hovering"]} of {base.n}')
            print(f'| {" | ".join(cells)} |')


if __name__ == '__main__':
    main()
