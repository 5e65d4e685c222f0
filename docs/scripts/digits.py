"""Print how thrusts change near the boundary for vehicles whose files have few digits.

This is the table of docs/exact.md: for each number of digits the worst of four symmetric
vehicles, with the default slack and with a slack of ten times the last digit.  Takes some minutes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test'))
from test_exact import NAMES, jumps, written


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--size', type=int, default=1000, help='wrenches for each vehicle')
    size = parser.parse_args().size
    for digits in range(3, 16):
        for slack in (1e-9, 10.0 ** (1 - digits)):
            if slack < 1e-9:
                continue
            found = [jumps(written(name, digits), size, slack=slack) for name in NAMES]
            changes, residuals = (np.concatenate(part) for part in zip(*found, strict=True))
            print(
                f'{digits:2} digits, slack {slack:.0e}: thrusts change by {changes.max():.1e} N '
                f'at most, {np.mean(changes < 1e-6):.1%} by less than 1e-6 N; '
                f'wrenches are missed by {residuals.max():.1e}',
                flush=True,
            )


if __name__ == '__main__':
    main()
