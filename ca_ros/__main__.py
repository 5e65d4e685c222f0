"""What this installation of ca_ros has, and its commands: ``python -m ca_ros [COMMAND]``."""

import argparse
import ast
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from signal import SIG_DFL, SIGPIPE, signal

from ca_ros import explore
from ca_ros.allocation import ALLOCATORS
from ca_ros.commands import COMMANDS, warn_in_one_line
from ca_ros.errors import message
from ca_ros.kernel import NOT_BUILT, chosen, load
from ca_ros.problem.problem import AllocationProblem
from ca_ros.px4 import parameters as px4_parameters
from ca_ros.studies import fit_thrust, identify
from ca_ros.studies.sets import audit_command
from ca_ros.vehicle.files import shipped_problems, shipped_tilting, shipped_vehicles
from ca_ros.vehicle.formats import gazebo, urdf
from ca_ros.vehicle.vehicle import Vehicle

DOCS = {
    'README.md': 'how to run it, comparison, results',
    'docs/': 'guides, topics, parameters, how the exact allocator works',
    'examples/': 'MuJoCo, and a search for designs',
}


def main(argv: Sequence[str] | None = None) -> int:
    """Say what there is, or run a command; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='python -m ca_ros', description='Say what this installation of ca_ros has.'
    )
    commands = parser.add_subparsers(title='commands', metavar='COMMAND', dest='command')
    for command in (audit_command, explore, fit_thrust, gazebo, identify, px4_parameters, urdf):
        name, about = command.COMMAND
        words = f'{about[0].upper()}{about[1:]}.'
        command.add_options(one := commands.add_parser(name, help=about, description=words))
        one.set_defaults(run=command.run)
    parser.add_argument('--version', action='version', version=installed()[0])
    options = parser.parse_args(argv)
    warn_in_one_line('ca_ros')
    try:
        if options.command is None:
            overview()
        else:
            options.run(options)
    except (OSError, ValueError) as error:
        sys.stdout.flush()
        prog = ' '.join(filter(None, ['ca_ros', options.command]))
        print(f'{prog}: {message(error)}', file=sys.stderr)
        return 1
    return 0


def overview() -> None:
    """Print what there is."""
    version, programs = installed()
    print(
        f'ca_ros {version} in {Path(__file__).parent}\n'
        f'rclpy: {rclpy()}\n'
        f'exact allocator: {kernel()}'
    )
    sections = {
        'executables, each with --help (the nodes and bringup need ROS 2 for it)': programs,
        'vehicles, for --vehicle and Vehicle.load': vehicles(),
        'problems, for --vehicle of static_study and attainable, and AllocationProblem.load': (
            problems()
        ),
        'methods, for --method and make_allocator': {
            name: first_line(kind.__doc__) for name, kind in ALLOCATORS.items()
        },
        'documentation, with the sources': DOCS,
    }
    width = max(len(name) for lines in sections.values() for name in lines)
    for title, lines in sections.items():
        print(f'\n{title}:')
        for name, text in lines.items():
            print(f'  {name:{width}}  {text}')
    print(
        '\npython -m ca_ros audit VEHICLE: which axes the rotors can control, also after each '
        'single failure'
        '\npython -m ca_ros --help: the other commands, such as fit-thrust and px4-parameters'
    )


def installed() -> tuple[str, dict[str, str]]:
    """Return the version, and what each executable is by the first line of its module."""
    try:
        package = distribution('ca_ros')
    except PackageNotFoundError:
        return '(not installed: no executables)', {}
    programs = sorted(package.entry_points.select(group='console_scripts'))
    return package.version, {
        point.name: summary(COMMANDS.get(point.name, point.module)) for point in programs
    }


def summary(module: str) -> str:
    """Return the first line of a module's docstring without importing it, as it may need ROS."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return 'missing: reinstall the package'
    return first_line(ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding='utf-8'))))


def first_line(docstring: str | None) -> str:
    """Return the first line of a docstring."""
    return (docstring or '').strip().partition('\n')[0].replace(' [1]_', '')


def vehicles() -> dict[str, str]:
    """Return the shipped vehicles."""
    files = shipped_vehicles() | shipped_tilting()
    found = {name: Vehicle.load(file) for name, file in files.items()}
    return {
        name: f'{each.n} rotors, {each.mass:g} kg, {", ".join(each.axes)}'
        for name, each in found.items()
    }


def problems() -> dict[str, str]:
    """Return the shipped problems without a vehicle."""
    found = {name: AllocationProblem.load(file) for name, file in shipped_problems().items()}
    return {name: f'{each.n} effectors, {", ".join(each.axes)}' for name, each in found.items()}


def kernel() -> str:
    """Return which implementation the exact allocator runs on."""
    try:
        engine = chosen(1, 1)
    except ValueError as error:
        return str(error)
    if engine is not None:
        return 'the kernel in C'
    return 'NumPy, by CA_ROS_KERNEL' if load() else f'NumPy; {NOT_BUILT}'


def rclpy() -> str:
    """Say where rclpy comes from, without importing it."""
    spec = find_spec('rclpy')
    if spec and spec.origin:
        return str(Path(spec.origin).parent)
    way = "source ROS 2 Jazzy, or install ca_ros's extra 'ros' (x86-64 Linux)"
    return f'absent, and with it the nodes: {way}'


if __name__ == '__main__':
    # A reader such as head may end first.
    signal(SIGPIPE, SIG_DFL)
    raise SystemExit(main())
