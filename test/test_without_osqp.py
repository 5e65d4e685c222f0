"""A machine without osqp allocates as exactly, and says what it lacks."""

import subprocess
import sys

PROGRAM = """
import sys

sys.modules['osqp'] = None  # importing it raises an ImportError

from ca_ros import Vehicle, make_allocator

vehicle = Vehicle.load('hexarotor')
print(make_allocator('exact', vehicle).allocate([9.81, 0.5, 0.0, 0.1]).status.name)
try:
    make_allocator('osqp', vehicle)
except ValueError as error:
    print(error)
"""


def test_it_allocates_and_names_the_missing_package():
    run = subprocess.run([sys.executable, '-c', PROGRAM], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    status, reason = run.stdout.splitlines()
    assert status == 'EXACT'
    assert reason.startswith('osqp:')
    assert 'pip install osqp' in reason
    assert 'exact solves the same program' in reason
