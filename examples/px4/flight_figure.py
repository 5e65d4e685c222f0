"""Plot the heights of flights: python flight_figure.py flights/*.ulg --out px4.png"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from flight_table import GROUND, measured

from ca_ros.figures import COLORS, STYLE

PANELS = {
    'The controller is killed': {
        'controller-killed, before': ('ca_ros 0.2.0', COLORS[1]),
        'controller-killed, mode': ('external mode', COLORS[0]),
    },
    'A rotor of the hexarotor is lost': {
        'lost, px4-pseudo-inverse-told': ('PX4: pseudo-inverse, told', COLORS[4]),
        'lost, px4-sequential-desaturation-told': ('PX4: desaturation, told', COLORS[1]),
        'lost, px4-sequential-desaturation-untold': ('PX4 by default, not told', '0.5'),
        'announced, mode': ('ca_ros, told', COLORS[0]),
        'named, mode': ('ca_ros, found', COLORS[2]),
    },
}
SHOWN = -1.0, 8.0  # times around the mark [s]


def main() -> None:
    """Plot what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('logs', nargs='+', type=Path)
    parser.add_argument('--out', type=Path, default=Path('px4.png'))
    options = parser.parse_args()
    groups = measured(options.logs)
    plt.rcParams.update(STYLE)
    figure, panels = plt.subplots(
        1, len(PANELS), figsize=(10.0, 4.2), sharey=True, layout='constrained'
    )
    for panel, (title, kinds) in zip(panels, PANELS.items(), strict=True):
        for kind, (label, color) in kinds.items():
            flights = groups.get(kind, [])
            fell = sum(flight.fell for flight in flights)
            for i, flight in enumerate(flights):
                name = f'{label}: {fell} of {len(flights)} fell' if i == 0 else None
                down = flight.fell & (flight.time > 0.0) & (flight.height < GROUND)
                end = int(np.argmax(down)) + 1 if down.any() else len(down)
                shown = flight.time[:end], flight.height[:end]
                panel.plot(*shown, color=color, lw=1.0, alpha=0.7, label=name)
        panel.axvline(0.0, color='black', lw=0.8, ls=':')
        panel.set(title=title, xlabel='time after it [s]', xlim=SHOWN)
        panel.legend(loc='upper center', bbox_to_anchor=(0.5, -0.16), ncols=2)
    panels[0].set(ylabel='height [m]', ylim=(0.0, 6.0))
    figure.savefig(options.out, dpi=140)


if __name__ == '__main__':
    main()
