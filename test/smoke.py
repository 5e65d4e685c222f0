"""Try an installed wheel: its engine, and 100 wrenches with the thrusts that belong to them.

``python test/smoke.py c`` or ``numpy``, the engine that is expected, outside the repository;
``--write`` makes smoke.csv anew.
"""

import sys
from pathlib import Path

import numpy as np

import ca_ros
from ca_ros.kernel import chosen

TABLE = Path(__file__).with_name('smoke.csv')
"""Wrenches (4) and thrusts (6) of the hexarotor; half of the wrenches are unattainable."""


def main(expected):
    """Compare the engine and the thrusts; return the exit code."""
    engine = 'numpy' if chosen(6, 4) is None else 'c'
    allocator = ca_ros.Exact(ca_ros.Vehicle.load('hexarotor'))
    if expected == '--write':
        rng = np.random.default_rng(0)
        wrenches = rng.uniform([3, -1.8, -1.8, -0.2], [21, 1.8, 1.8, 0.2], (100, 4)).round(3)
        thrusts = allocator.allocate_batch(wrenches).thrusts
        np.savetxt(TABLE, np.hstack([wrenches, thrusts]), fmt='%.15g', delimiter=',')
        return 0
    table = np.loadtxt(TABLE, delimiter=',')
    error = np.abs(allocator.allocate_batch(table[:, :4]).thrusts - table[:, 4:]).max()
    print(f'ca_ros {ca_ros.__version__} in {ca_ros.__path__[0]}: engine {engine}, {error:.0e} N')
    return int(engine != expected or len(table) != 100 or error > 1e-9)


if __name__ == '__main__':
    raise SystemExit(main(*sys.argv[1:]))
