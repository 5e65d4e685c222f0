"""Nothing outside ca_ros.nodes needs ROS."""

import subprocess
import sys
from pathlib import Path

import pytest

BLOCK = """
import sys
from importlib import import_module
from importlib.abc import MetaPathFinder
from pkgutil import walk_packages


class Blocker(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in BLOCKED:
            raise ImportError(f'{name} is blocked')


sys.meta_path.insert(0, Blocker())
"""

ROS = ('rclpy', 'rcl_interfaces', 'std_msgs', 'geometry_msgs', 'diagnostic_msgs',
       'builtin_interfaces', 'rosidl_runtime_py', 'ament_index_python')

EVERY_MODULE = """
import ca_ros

names = [module.name for module in walk_packages(ca_ros.__path__, 'ca_ros.')
         if not module.name.startswith('ca_ros.nodes.')]
for name in names:
    import_module(name)
print(*names)
"""

NODES = """
from ca_ros.nodes import allocator
"""

EXAMPLE = """
import numpy as np
from ca_ros import Vehicle, AdmissibleSet, ALLOCATORS, control_allocation_matrix, make_allocator

u = [9.81, 0.0, 0.0, 0.0]
wrenches = [u, [12.0, 0.1, 0.0, 0.0]]
rng, size = np.random.default_rng(0), 5

vehicle = Vehicle.load('hexarotor')
gamma = control_allocation_matrix(vehicle)
allocator = make_allocator('exact', vehicle)
a = allocator.allocate(u)
a.thrusts, a.speeds, a.wrench, a.residual, a.saturation, a.status
batch = allocator.allocate_batch(wrenches)
admissible = AdmissibleSet(vehicle)
admissible.contains(u), admissible.margin(u), admissible.sample(rng, size), admissible.volume
admissible.scale(u, about=None), admissible.prioritize(u, order=None)
print(*ALLOCATORS, gamma.shape, a.status.name, batch.thrusts.shape)
"""


WITH_OSQP = """
from ca_ros import Vehicle, make_allocator

make_allocator('exact', Vehicle.load('hexarotor'), solver='osqp')
"""


def run(directory, script, blocked=ROS):
    """Run a script in a fresh interpreter that has this package but not the blocked ones."""
    setting = f"""
BLOCKED = {blocked!r}
sys.path.insert(0, {str(Path(__file__).parent.parent)!r})
"""
    return subprocess.run(
        [sys.executable, '-c', BLOCK + setting + script],
        cwd=directory, capture_output=True, text=True, check=False)


def test_every_module_but_the_nodes_imports_without_ros(tmp_path):
    result = run(tmp_path, EVERY_MODULE)
    assert result.returncode == 0, result.stderr
    assert {'ca_ros.vehicle', 'ca_ros.allocation.exact', 'ca_ros.closed_loop'} <= set(
        result.stdout.split())


def test_the_nodes_do_not():
    # Otherwise the tests beside this one would prove nothing.
    result = run(None, NODES)
    assert result.returncode != 0
    assert 'is blocked' in result.stderr


@pytest.mark.parametrize('blocked', [ROS, (*ROS, 'osqp', 'matplotlib', 'tqdm')])
def test_the_example_of_the_contract_runs_without_ros(tmp_path, blocked):
    result = run(tmp_path, EXAMPLE, blocked)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == [
        'exact', 'pseudo_inverse', 'conventional', 'direct', '(4,', '6)', 'EXACT', '(2,', '6)']


def test_without_osqp_its_start_is_refused_and_osqp_named(tmp_path):
    result = run(tmp_path, WITH_OSQP, ('osqp',))
    assert result.returncode != 0
    assert 'osqp' in result.stderr.splitlines()[-1]
    assert result.stderr.splitlines()[-1].startswith('ValueError')
