"""Rooms import one way, and few of them need ROS."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import ca_ros_cli
from ca_ros import ALLOCATORS
from ca_ros_cli import COMMANDS, STUDIES
from ca_ros_cli import NODES as LOOP

BLOCK = """
import sys
from importlib import import_module
from importlib.abc import MetaPathFinder
from pkgutil import walk_packages


class Blocker(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in BLOCKED:
            raise ModuleNotFoundError(f'{name} is blocked', name=name)


sys.meta_path.insert(0, Blocker())
"""

ROS = ('rclpy', 'rcl_interfaces', 'std_msgs', 'geometry_msgs', 'diagnostic_msgs', 'nav_msgs',
       'std_srvs', 'rosgraph_msgs', 'builtin_interfaces', 'rosidl_runtime_py',
       'ament_index_python')

EVERY_MODULE = """
import ca_ros

ROOMS = ('ca_ros.nodes.', 'ca_ros.process.', 'ca_ros.bringup.', 'ca_ros.testing',
         'ca_ros.px4.bridge')
names = [module.name for module in walk_packages(ca_ros.__path__, 'ca_ros.')
         if not module.name.startswith(ROOMS)]
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
admissible.scale(u, scale_reference=None), admissible.prioritize(u, order=None)
print(*ALLOCATORS, gamma.shape, a.status.name, batch.thrusts.shape)
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


@pytest.mark.slow
def test_every_module_but_the_nodes_imports_without_ros(tmp_path):
    result = run(tmp_path, EVERY_MODULE)
    assert result.returncode == 0, result.stderr
    modules = {'ca_ros.vehicle.vehicle', 'ca_ros.allocation.exact', 'ca_ros.simulation.plant'}
    assert modules <= set(result.stdout.split())


@pytest.mark.slow
def test_a_method_imports_its_solver_when_it_needs_it(tmp_path):
    result = run(tmp_path, 'import ca_ros', (*ROS, 'scipy', 'osqp'))
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
def test_the_nodes_do_not():
    # Otherwise the tests beside this one would prove nothing.
    result = run(None, NODES)
    assert result.returncode != 0
    assert 'is blocked' in result.stderr


@pytest.mark.slow
def test_the_example_of_the_contract_runs_without_ros_and_studies(tmp_path):
    result = run(tmp_path, EXAMPLE, (*ROS, 'osqp', *STUDIES))
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == [*ALLOCATORS, '(4,', '6)', 'EXACT', '(2,', '6)']


# What a node starts with

IMPORTED = """
import sys

import MODULE

print(*sorted({name.partition('.')[0] for name in sys.modules}))
"""
HEAVY = {'scipy', 'osqp', 'jinja2', *STUDIES}
"""Packages that take longer to import than all else: imported by the functions that need them."""


@pytest.mark.slow
@pytest.mark.parametrize('modules', [
    'ca_ros', ', '.join(COMMANDS[name][0] for name in (*LOOP, 'bringup', 'monitor', 'viewer'))])
def test_what_is_not_needed_is_not_imported(modules):
    result = subprocess.run(
        [sys.executable, '-c', IMPORTED.replace('MODULE', modules)], capture_output=True,
        text=True)
    assert result.returncode == 0, result.stderr
    assert 'numpy' in result.stdout.split()
    assert not HEAVY & set(result.stdout.split())


FLIGHT = """
from ca_ros.bringup.bringup import main
from ca_ros.nodes import allocator, controller, simulator

raise SystemExit(main(['--mode', 'lockstep', '--duration', '1', '--waypoint', '0', '0', '0',
    '--heading', '0', '--out', 'out']))
"""


@pytest.mark.long
def test_bringup_flies_without_the_studies_packages_and_says_that_there_is_no_plot(
        graph, tmp_path):
    result = run(tmp_path, FLIGHT, STUDIES)
    assert result.returncode == 0, result.stderr
    assert "no plot       needs matplotlib: pip install 'ca_ros[studies]'" in result.stdout
    assert [file.name for file in (tmp_path / 'out').iterdir()] == ['flight.csv']


@pytest.mark.slow
@pytest.mark.parametrize('absent', [STUDIES, ROS], ids=['studies', 'ros'])
def test_a_command_without_its_packages_names_them_in_one_line(tmp_path, absent):
    # The firmware needs no more than the package itself.
    studies = [name for name in COMMANDS if 'study' in name or name == 'attainable']
    nodes = [name for name, (_, about) in COMMANDS.items() if about.startswith('node')]
    names = studies if absent is STUDIES else [*nodes, 'bringup']
    script = f'from ca_ros_cli import main; print([main([name]) for name in {names}])'
    result = run(tmp_path, script, absent)
    assert (result.returncode, result.stdout) == (0, f'{[1] * len(names)}\n')
    for name, line in zip(names, result.stderr.splitlines(), strict=True):
        assert line.startswith(f'{name}: needs ')
        assert ("'ca_ros[studies]'" if absent is STUDIES else "'ca_ros[ros]'") in line


def test_an_interrupt_while_a_command_starts_ends_it_without_a_traceback(monkeypatch, capfd):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(ca_ros_cli, 'import_module', interrupted)
    assert ca_ros_cli.main(['allocator']) == 130
    assert capfd.readouterr() == ('', '')


INTERRUPTED = """
import sys


class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == 'numpy':
            raise KeyboardInterrupt


sys.meta_path.insert(0, Interrupt())
from ca_ros_cli import main
raise SystemExit(main(['bringup']))
"""


@pytest.mark.slow
def test_an_interrupt_while_the_package_is_imported_ends_a_command_without_a_traceback(tmp_path):
    result = run(tmp_path, INTERRUPTED, ())
    assert (result.returncode, result.stdout, result.stderr) == (130, '', '')


# Rooms

ROOMS = ['vehicle', 'solver', 'kernel', 'problem', 'allocation', 'control', 'detection',
         'simulation', 'firmware', 'parameter_files', 'nodes', 'px4', 'process', 'bringup',
         'studies', 'testing']
"""From the first to the last on the way of a wrench: none imports a later one."""

PACKAGE = Path(__file__).parent.parent / 'ca_ros'


@cache
def imports():
    """Return the modules that each module imports, those for types alone included."""
    found = {}
    for file in PACKAGE.rglob('*.py'):
        parts = file.relative_to(PACKAGE.parent).with_suffix('').parts
        name = '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)
        found[name] = set()
        for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found[name] |= {node.module} | {
                    f'{node.module}.{alias.name}' for alias in node.names}
    return {name: {other for other in others if other in found} for name, others in found.items()
            } | {'': set().union(*found.values())}


def room(module):
    return module.split('.')[1] if '.' in module else ''


def test_no_room_imports_a_later_one():
    wrong = [
        f'{module} imports {other}'
        for module, others in imports().items() if room(module) in ROOMS
        for other in others
        if room(other) in ROOMS and ROOMS.index(room(other)) > ROOMS.index(room(module))]
    assert not wrong
    assert {file.parent.name for file in PACKAGE.glob('*/__init__.py')} == {*ROOMS} - {
        'parameter_files'}


def test_no_modules_import_each_other_in_a_circle():
    graph = imports()
    below = {name: {o for o in others if o != name} for name, others in graph.items() if name}
    # The package and its rooms gather what is in them for their users.
    gathering = {name for name in below if (PACKAGE.parent / name.replace('.', '/')).is_dir()}
    left = {name: others - gathering for name, others in below.items() if name not in gathering}
    while ends := [name for name, others in left.items() if not others & left.keys()]:
        for name in ends:
            del left[name]
    assert not left


def test_few_places_ask_which_kind_of_problem_it_is():
    asked = [
        f'{file.relative_to(PACKAGE)}: {ast.unparse(call)}'
        for file in PACKAGE.rglob('*.py') for call in ast.walk(ast.parse(file.read_text()))
        if isinstance(call, ast.Call) and ast.unparse(call.func) == 'isinstance'
        and ast.unparse(call.args[1]) in ('Box', 'ConvexSets', 'VehicleProblem')]
    # `backend_of`, and four others.
    assert len(asked) <= 5, asked
