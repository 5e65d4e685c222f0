"""What this installation of ca_ros has: version, engine, vehicles, problems and methods."""

from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from ca_ros.allocation import ALLOCATORS
from ca_ros.kernel import NOT_BUILT, chosen, load
from ca_ros.problem.problem import AllocationProblem
from ca_ros.vehicle.files import shipped_problems, shipped_tilting, shipped_vehicles
from ca_ros.vehicle.vehicle import Vehicle


def versions() -> str:
    """Return the version, where rclpy comes from, and the engine of the exact allocator."""
    try:
        number = version('ca_ros')
    except PackageNotFoundError:
        number = '(not installed)'
    return (
        f'ca_ros {number} in {Path(__file__).parent}\n'
        f'rclpy: {_rclpy()}\n'
        f'exact allocator: {_engine()}'
    )


def text() -> str:
    """Return the shipped vehicles and problems, and the methods."""
    files = shipped_vehicles() | shipped_tilting()
    vehicles = {name: Vehicle.load(file) for name, file in files.items()}
    problems = {name: AllocationProblem.load(file) for name, file in shipped_problems().items()}
    sections = {
        'vehicles, for --vehicle and Vehicle.load': {
            name: f'{each.n} rotors, {each.mass:g} kg, {", ".join(each.axes)}'
            for name, each in vehicles.items()},
        'problems, for --vehicle of static_study and attainable, and AllocationProblem.load': {
            name: f'{each.n} effectors, {", ".join(each.axes)}'
            for name, each in problems.items()},
        'methods, for --method and make_allocator': {
            name: (kind.__doc__ or '').strip().partition('\n')[0].replace(' [1]_', '')
            for name, kind in ALLOCATORS.items()},
    }
    width = max(len(name) for lines in sections.values() for name in lines)
    return '\n\n'.join(
        '\n'.join([f'{title}:', *(f'  {name:{width}}  {about}' for name, about in lines.items())])
        for title, lines in sections.items())


def _engine() -> str:
    """Return which implementation the exact allocator runs on."""
    try:
        engine = chosen(1, 1)
    except ValueError as error:
        return str(error)
    if engine is not None:
        return 'the kernel in C'
    return 'NumPy, by CA_ROS_KERNEL' if load() else f'NumPy; {NOT_BUILT}'


def _rclpy() -> str:
    """Say where rclpy comes from, without importing it."""
    spec = find_spec('rclpy')
    if spec and spec.origin:
        return str(Path(spec.origin).parent)
    way = "source ROS 2 Jazzy, or install ca_ros's extra 'ros' (x86-64 Linux)"
    return f'absent, and with it the nodes: {way}'
