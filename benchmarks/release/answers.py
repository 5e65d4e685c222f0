"""The answers of the installed version, as a file: ``python -m release.answers FILE.npz``.

Runs in the folder above, in the environment of the version, which may be an old one.
"""

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any

import numpy as np

import ca_ros
from ca_ros import AdmissibleSet, Vehicle, make_allocator

from .drawn import KINDS, speeds, wrenches
from .speed import exact, within_rates

VEHICLES = (
    'hexarotor', 'hexarotor_ppnnpn', 'hexarotor_realistic', 'hexarotor_tilted', 'octorotor',
    'quadrotor', 'rov', 'x8', 'y6', 'azimuth_boat', 'hexarotor_tilting',
    'omnidirectional_gimbals', 'tricopter',
)
PROBLEMS = 'admire', 'harv', 'omnidirectional_hexarotor'
SIZE = 200  # wrenches of a kind


def found_in(name: str, *modules: str) -> Any:
    """Return what the first of some modules has by a name; versions keep it in different ones."""
    for module in modules:
        with suppress(ImportError, AttributeError):
            return getattr(import_module(module), name)
    raise ImportError(f'{name} is in none of {", ".join(modules)}')


def result(name: str, allocate: Callable[[Any], Any], demands: Any) -> Iterator[tuple[str, Any]]:
    """Yield what a method answers to wrenches, by name."""
    answers = [allocate(u) for u in demands]
    for field in ('thrusts', 'wrench', 'saturation'):
        yield f'{name} {field}', np.array([getattr(answer, field) for answer in answers])
    yield f'{name} status', np.array([ca_ros.Status(answer.status).name for answer in answers])


def explained(name: str, allocate: Callable[[Any], Any], demands: Any) -> Iterator[
    tuple[str, Any]
]:
    """Yield the explanations of answers, by name."""
    reasons = [allocate(u).explanation for u in demands]
    yield f'{name} margin', np.array([reason.margin for reason in reasons])
    yield f'{name} served', np.array([reason.served for reason in reasons])
    yield f'{name} text', np.array([str(reason) for reason in reasons])


def of_problem(problem: Any, subject: Any) -> Iterator[tuple[str, Any]]:
    """Yield the answers of all methods and of the admissible set; subject: vehicle or problem."""
    methods: list[tuple[str, str, dict[str, str]]]
    methods = [(name, name, {}) for name in ca_ros.ALLOCATORS]
    methods += [(f'exact {policy}', 'exact', {'policy': policy}) for policy in ('scale', 'reject')]
    for name, method, settings in methods:
        try:
            allocator = make_allocator(method, subject, **settings)
        except (ValueError, TypeError):
            # The method does not take this problem, or has no settings of its own by default.
            continue
        for kind in KINDS:
            demands = wrenches(problem, kind, SIZE)
            yield from result(f'{name}, {kind}:', allocator.allocate, demands)
    explain = exact(subject).allocate
    yield from explained('explanation, beyond:', explain, wrenches(problem, 'beyond', 40))
    admissible = AdmissibleSet(subject)
    for kind in KINDS:
        demands = wrenches(problem, kind, 40)
        yield f'set, {kind}: contains', np.array([admissible.contains(u) for u in demands])
        yield f'set, {kind}: margin', np.array([admissible.margin(u) for u in demands])
        yield f'set, {kind}: scale', np.array([admissible.scale(u) for u in demands], float)
    # Of vectors in sets no volume is known.
    with suppress(TypeError):
        yield 'set, volume', np.array(admissible.volume)


def of_vehicle(name: str) -> Iterator[tuple[str, Any]]:
    """Yield the answers for a shipped vehicle: all methods, within rates, sets, audits."""
    vehicle = Vehicle.load(name)
    allocator = exact(vehicle)
    problem = allocator.problem
    yield 'matrix', np.array(problem.gamma)
    yield from of_problem(problem, vehicle)
    try:
        slow = within_rates(allocator)
    except ValueError:
        # Rotors that tilt have limits of their own.
        slow = None
    if slow is not None:
        pairs = list(zip(
            wrenches(problem, 'uniform', SIZE), speeds(vehicle, SIZE), strict=True))
        answers = [slow(u, last, 0.01) for u, last in pairs]
        yield 'within rates: thrusts', np.array([answer.thrusts for answer in answers])
    healths = [np.ones(vehicle.n), *(1.0 - np.eye(vehicle.n))]
    audits = [ca_ros.audit(vehicle.with_health(health)) for health in healths]
    yield 'audit', np.array([str(each) for each in audits])


def of_detector(name: str) -> Iterator[tuple[str, Any]]:
    """Yield what the detector finds in a flight in which the thrust of a rotor is lost."""
    make_detector = found_in(
        'make_detector', 'ca_ros', 'ca_ros.detection.kernel_detector',
        'ca_ros.flight.kernel_detector')
    vehicle = Vehicle.load(name)
    wrench = np.array(exact(vehicle).problem.gamma)
    hover = vehicle.mass * vehicle.gravity / wrench[0].sum()
    command = vehicle.speeds(np.full(vehicle.n, hover))
    inertia = np.array(vehicle.inertia)
    inertia = np.diag(inertia) if inertia.ndim == 1 else inertia
    for rotor in range(vehicle.n):
        detector, rng = make_detector(vehicle), np.random.default_rng(rotor)
        linear, angular, found = np.array([0.5, 0.0, 0.0]), np.zeros(3), []
        for step in range(120):
            if step >= 80:
                thrust = hover * wrench[:, rotor]
                linear = linear - [0.0, 0.0, 0.01 * thrust[0] / vehicle.mass]
                angular = angular - 0.01 * np.linalg.solve(inertia, thrust[1:])
            noise = 0.01 * rng.standard_normal(6)
            state = np.array([0.0, 0.0, 0.0, 1.0]), linear + noise[:3], angular + noise[3:] / 2.0
            time = 10_000_000 * step
            detector.observe(time, *state)
            detector.command(time, command)
            found.append(detector.health)
        yield f'detector, rotor {rotor + 1}: health', np.array(found)


def everything() -> Iterator[tuple[str, Any]]:
    """Yield all answers, each with the name of its vehicle."""
    parts = [(name, of_vehicle(name)) for name in VEHICLES]
    parts += [(name, of_detector(name)) for name in ('hexarotor', 'octorotor', 'x8')]
    for name in PROBLEMS:
        load = getattr(ca_ros.AllocationProblem, 'load', None)
        problem = (load or found_in('load_problem', 'ca_ros.problem.files'))(name)
        parts.append((name, of_problem(problem, problem)))
    for name, found in parts:
        try:
            for part, values in found:
                yield f'{name}|{part}', values
        except Exception as error:
            # An old version may lack what a newer one has: `compare` shows the reason.
            yield f'{name}|cannot', np.array([f'{type(error).__name__}: {error}'])


if __name__ == '__main__':
    warnings.simplefilter('ignore')
    np.savez_compressed(sys.argv[1], **dict(everything()))
