"""Draw docs/allocation.png, README's first picture: `exact` and a clipped pseudo-inverse."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from ca_ros import AdmissibleSet, Exact, PseudoInverse, Vehicle

DOCS = Path(__file__).resolve().parent.parent
DEMAND = np.array([9.81, 3.0, 0.0, 0.0])  # README's example
COLORS = {'demand': '#444444', 'clipped pseudo-inverse': '#d1495b', 'exact': '#00798c'}
AXES = ('thrust {:g} N', 'roll {:g} N m', 'pitch {:g}', 'yaw {:g} N m')
SECOND = np.array([9.81, 1.5, 0.0, 0.15])


def section(ax: Axes, vehicle: Vehicle) -> None:
    """Draw what the rotors can produce in the plane of roll and thrust, and the answers."""
    admissible = AdmissibleSet(vehicle)
    middle = admissible.problem.center
    angles = np.linspace(0.0, 2.0 * np.pi, 721)
    ways = np.zeros((len(angles), 4))
    ways[:, 0], ways[:, 1] = 8.0 * np.sin(angles), 2.0 * np.cos(angles)
    ends = np.array([admissible.problem.reach(middle, way) for way in ways])
    edge = middle + ends[:, None] * ways
    ax.fill(edge[:, 1], edge[:, 0], color='#cfe3e6', zorder=0)
    ax.plot(edge[:, 1], edge[:, 0], color='#00798c', linewidth=1.2, zorder=1)
    ax.text(1.72, 12.6, 'what the rotors\ncan produce', color='#00596b', fontsize=9)
    clipped = PseudoInverse(vehicle).allocate(DEMAND).wrench
    exact = Exact(vehicle).allocate(DEMAND).wrench
    texts = {
        'demand': (DEMAND, (3.08, 8.6), 'demand: hover and\nroll 3 N m, too much'),
        'clipped pseudo-inverse': (
            clipped, (2.82, 12.2), f'clipped pseudo-inverse:\nroll {clipped[1]:.2f} N m, and it\n'
            f'climbs ({clipped[0] - DEMAND[0]:+.2f} N)'),
        'exact': (exact, (1.72, 9.4), f'exact: roll {exact[1]:.2f} N m,\nthrust as demanded')}
    for name, (wrench, place, text) in texts.items():
        marker = {'demand': 'o', 'exact': 'D'}.get(name, 's')
        ax.plot(wrench[1], wrench[0], marker, color=COLORS[name], markersize=8, zorder=3,
                markerfacecolor='none' if name == 'demand' else COLORS[name], markeredgewidth=2)
        ax.annotate(
            text, wrench[[1, 0]], place, color=COLORS[name], fontsize=9,
            arrowprops={'arrowstyle': '-', 'color': COLORS[name], 'linewidth': 0.8})
    ax.set(xlabel='roll torque [N m]', ylabel='thrust [N]', xlim=(1.65, 3.7), ylim=(7.6, 13.9))
    ax.set_title('One demand beyond the limits', fontsize=10, loc='left')


def bars(ax: Axes, vehicle: Vehicle) -> None:
    """Draw what a second demand gets of each axis, as shares of the range of the axis."""
    extent = AdmissibleSet(vehicle).problem.extent
    answers = {
        'clipped pseudo-inverse': PseudoInverse(vehicle).allocate(SECOND).wrench,
        'exact': Exact(vehicle).allocate(SECOND).wrench}
    rows = np.arange(4)[::-1]
    for shift, (name, wrench) in zip((0.18, -0.18), answers.items(), strict=True):
        errors = (wrench - SECOND) / extent * 100.0
        ax.barh(rows + shift, errors, 0.32, color=COLORS[name], label=name)
        for row, error, value in zip(rows + shift, errors, wrench, strict=True):
            if abs(error) > 0.05:
                ax.text(error + np.sign(error) * 0.6, row, f'{value:.2f}', va='center', fontsize=8,
                        ha='left' if error > 0.0 else 'right', color=COLORS[name])
    ax.axvline(0.0, color='#444444', linewidth=1.0)
    names = [axis.format(value) for axis, value in zip(AXES, SECOND, strict=True)]
    ax.set_yticks(rows, names, fontsize=9)
    ax.set(xlabel='error [% of half the range of the axis]', xlim=(-26.0, 16.0))
    ax.set_title('Another demand: which axis pays', fontsize=10, loc='left')
    ax.legend(frameon=False, fontsize=9, loc='upper left', bbox_to_anchor=(0.0, 1.0))


def main() -> int:
    """Draw the picture."""
    vehicle = Vehicle.load('hexarotor')
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(9.6, 3.6), width_ratios=(1.15, 1.0), layout='constrained')
    section(left, vehicle)
    bars(right, vehicle)
    for ax in (left, right):
        ax.spines[['top', 'right']].set_visible(False)
    figure.savefig(DOCS / 'allocation.png', dpi=150)
    print(f'written: {DOCS.name}/allocation.png')
    return 0


if __name__ == '__main__':
    sys.exit(main())
