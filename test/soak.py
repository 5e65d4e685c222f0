"""The long run: `make soak SOAK=600`, or `python test/soak.py --seconds 600`.

`python test/soak.py test_node_health -k obeys` runs these tests alone.

First `endurance.py`, then other tests in their longest forms.  The figures end in a table and in
soak.json.
"""

import argparse
import json
import os
import platform
import sys
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path

import pytest

HERE = Path(__file__).parent

SERIES = ('endurance', 'test_fuzz', 'test_flood', 'test_watchdog', 'test_node_health',
          'test_reconfiguration', 'test_end', 'test_kill',
          'test_fault_proxy', 'test_kernel', 'test_preference', 'test_problem', 'test_kernel_c')


class Figures:
    """Gathers the outcomes of the tests, and what they have recorded."""

    def __init__(self):
        self.tests = {}

    def pytest_runtest_logreport(self, report):
        """Take down a test, and above all what went wrong in it."""
        if report.when == 'call' or not report.passed:
            self.tests[report.nodeid] = {
                'outcome': report.outcome,
                'time [s]': round(report.duration, 1),
                'figures': dict(report.user_properties),
            }


def main():
    """Run all; return pytest's exit code."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=600.0, help='at 500 Hz (default: 600)')
    parser.add_argument('--out', type=Path, default=HERE.parent / 'out' / 'soak', metavar='DIR')
    parser.add_argument('-k', default='', help="the tests whose names match, as of pytest's -k")
    parser.add_argument('files', nargs='*', default=SERIES, metavar='FILE')
    arguments = parser.parse_args()
    # Read when the tests are imported.
    os.environ |= {'CA_ROS_LONG': 'soak', 'CA_ROS_SOAK': str(arguments.seconds)}
    files = [str(HERE / f'{name}.py') for name in arguments.files]
    figures = Figures()
    options = ['-q', '-p', 'no:cacheprovider', '-k', arguments.k]
    code = pytest.main([*options, *files], plugins=[figures])
    arguments.out.mkdir(parents=True, exist_ok=True)
    results = {
        'date': datetime.now(timezone.utc).isoformat(timespec='seconds'),
        'machine': f'{platform.machine()}, {os.cpu_count()} processors',
        'python': platform.python_version(),
        'versions': {name: version(name) for name in ('ca_ros', 'numpy')},
        'seconds': arguments.seconds,
        'tests': figures.tests,
    }
    (arguments.out / 'soak.json').write_text(json.dumps(results, indent=2) + '\n')
    for name, test in figures.tests.items():
        print(f'{test["outcome"]:8}{test["time [s]"]:7.1f} s  {Path(name).name}')
        for key, value in test['figures'].items():
            print(f'{"":18} {key}: {value}')
    return code


if __name__ == '__main__':
    sys.exit(main())
