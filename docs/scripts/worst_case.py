"""Measure the worst case of the kernel for every shipped vehicle; fill docs/firmware.md.

See `ca_ros.firmware.worst_case`.  Takes some minutes.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from itertools import product

from pages import fill, shipped, telling

from ca_ros.firmware.command import checked
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.firmware import Firmware
from ca_ros.firmware.worst_case import measure
from ca_ros.vehicle.files import read
from ca_ros.vehicle.vehicle import Vehicle


def row(task: tuple[str, str, int, int]) -> list[str]:
    """Return the row of one vehicle and precision."""
    name, precision, size, generations = task
    faults = faults_of(Vehicle.load(name), ['single'])
    firmware = Firmware.make(faults, checked(read(name)).allocation, precision)
    sample, searched, bounds = measure(firmware, size, generations)
    counts = max(sample.steps, searched.steps), bounds.steps
    counts += max(sample.pivots, searched.pivots), bounds.pivots
    return [f'`{name}`', precision, *map(str, (*counts, sample.inexact + searched.inexact))]


SHOWN = [('`hexarotor`', 'double'), ('`hexarotor`', 'single'), ('`octorotor`', 'single')]
SHOWN += [('`rov`', 'double')]

TITLES = ('vehicle', 'precision', 'steps', 'bound', 'pivots', 'bound', 'inexact')


def main() -> None:
    """Fill the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--size', type=int, default=10_000_000, help='wrenches for each row')
    parser.add_argument('--generations', type=int, default=100, help='of the search')
    options = parser.parse_args()
    tasks = [
        (*each, options.size, options.generations)
        for each in product(shipped(), ('double', 'single'))
    ]
    with ProcessPoolExecutor() as pool:
        rows = list(pool.map(row, tasks))
    found = telling('worst_case', TITLES, rows, lambda row: tuple(row[:2]) in SHOWN, words=2)
    fill('firmware.md', worst_case=found)


if __name__ == '__main__':
    main()
