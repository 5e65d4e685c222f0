"""``ca_ros from-urdf``: a parameter file from a URDF, with its rotor links by name."""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from ca_ros.arguments import add_rotor_numbers, command
from ca_ros.arrays import Array
from ca_ros.input_files import read_text
from ca_ros.settings import ParameterError
from ca_ros.vehicle.parameter_text import parameter_text
from ca_ros.vehicle.vehicle import Vehicle


class Model(NamedTuple):
    """What a URDF says of a vehicle, in the frame of its root link, all joints at zero.

    - `mass`: of all links [kg]
    - `center` (3,): their centre of mass [m]
    - `inertia` (3, 3): about the centre of mass [kg m^2]
    - `positions` and `axes` (n, 3): of the rotors: the origins of their links [m], and the axes of
      their joints
    """

    name: str
    mass: float
    center: Array
    inertia: Array
    positions: Array
    axes: Array


def read_urdf(text: str, rotors: Sequence[str]) -> Model:
    """Read a URDF, with the names of its rotor links in the order of the rotors.

    The thrust is along the axis of a rotor's joint.  Raises a ParameterError that names the link
    or joint and the fault.
    """
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ParameterError(f'no URDF: {error}') from None
    links = {link.get('name', ''): link for link in robot.iter('link')}
    joints = {}
    for joint in robot.iter('joint'):
        if (child := joint.find('child')) is not None:
            joints[child.get('link', '')] = joint
    if missing := [name for name in rotors if name not in joints or name not in links]:
        turning = [name for name in joints if joints[name].get('type') == 'continuous']
        raise ParameterError(
            f'{missing[0]}: no link with a joint; continuous joints turn '
            f'{", ".join(turning) or "no link"}')
    if twice := [name for name in rotors if rotors.count(name) > 1]:
        raise ParameterError(f'{twice[0]}: named twice: expected one link for each rotor')
    places = {name: _place(name, joints) for name in links}
    masses, centers, inertias = [], [], []
    for name, link in links.items():
        if (inertial := link.find('inertial')) is None:
            continue
        turn, origin = _after(places[name], inertial)
        moments = inertial.find('inertia')
        xx, xy, xz, yy, yz, zz = (
            _number(name, moments, f'i{axes}') for axes in ('xx', 'xy', 'xz', 'yy', 'yz', 'zz')
        )
        masses.append(_number(name, inertial.find('mass'), 'value'))
        centers.append(origin)
        inertias.append(turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T)
    mass = float(np.sum(masses))
    if not mass > 0.0:
        raise ParameterError(f'the links have a mass of {mass:g} kg: expected an <inertial>')
    center = np.array(masses) @ np.array(centers) / mass
    total = np.sum(inertias, axis=0)
    for each, m in zip(np.array(centers) - center, masses, strict=True):
        total += m * (each @ each * np.eye(3) - np.outer(each, each))
    axes = []
    for name in rotors:
        axis = joints[name].find('axis')
        way = _vector(name, axis, 'xyz') if axis is not None else np.array([1.0, 0.0, 0.0])
        axes.append(places[name][0] @ way)
    positions = np.array([places[name][1] for name in rotors])
    name = robot.get('name', 'multirotor')
    return Model(name, mass, center, total, positions, np.array(axes).round(12))


def _place(link: str, joints: dict[str, ElementTree.Element]) -> tuple[Array, Array]:
    """Return rotation (3, 3) and origin (3,) of a link in the frame of the root link."""
    chain: list[ElementTree.Element] = []
    while link in joints:
        chain.append(joints[link])
        parent = joints[link].find('parent')
        link = '' if parent is None else parent.get('link', '')
        if len(chain) > len(joints):
            raise ParameterError(f'{link}: the joints form a ring')
    place = np.eye(3), np.zeros(3)
    for joint in reversed(chain):
        place = _after(place, joint)
    return place


def _after(place: tuple[Array, Array], element: ElementTree.Element) -> tuple[Array, Array]:
    """Return a place, moved by the <origin> of an element."""
    origin = element.find('origin')
    name = element.get('name', element.tag)
    turn, start = place
    if origin is None:
        return place
    (roll, pitch, yaw) = _vector(name, origin, 'rpy')
    x, y, z = (np.array([np.cos(angle), np.sin(angle)]) for angle in (roll, pitch, yaw))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, x[0], -x[1]], [0.0, x[1], x[0]]])
    about_y = np.array([[y[0], 0.0, y[1]], [0.0, 1.0, 0.0], [-y[1], 0.0, y[0]]])
    about_z = np.array([[z[0], -z[1], 0.0], [z[1], z[0], 0.0], [0.0, 0.0, 1.0]])
    return turn @ about_z @ about_y @ about_x, start + turn @ _vector(name, origin, 'xyz')


def _vector(name: str, element: ElementTree.Element, key: str) -> Array:
    try:
        found = np.array([float(word) for word in element.get(key, '0 0 0').split()])
    except ValueError:
        found = np.zeros(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ParameterError(f'{name}: {key}={element.get(key)!r}: expected three numbers')
    return found


def _number(name: str, element: ElementTree.Element | None, key: str) -> float:
    try:
        return float('' if element is None else element.get(key, ''))
    except ValueError:
        raise ParameterError(f'{name}: <inertial> without a number {key}') from None


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument('file', type=Path, help='a URDF, after xacro')
    parser.add_argument('--rotors', nargs='+', required=True, metavar='LINK')
    words = ('cw', 'ccw')
    parser.add_argument('--spins', nargs='+', required=True, choices=words, help='from above')
    add_rotor_numbers(parser, 'k_f [kg m]')
    parser.add_argument('--torque-coefficient', type=float, required=True, help='[kg m^2]')


def run(options: argparse.Namespace) -> None:
    """Print the parameter file."""
    text = read_text(options.file)
    try:
        model = read_urdf(text, options.rotors)
        title = f'From {options.file.name}: the rotors are {", ".join(options.rotors)}.'
        text = parameter_text({
            'vehicle': {
                'name': f"'{model.name}'", 'mass': model.mass, 'center_of_mass': model.center,
                'inertia': model.inertia.ravel(),
            },
            'rotors': {
                'positions': model.positions, 'axes': model.axes, 'spins': options.spins,
                'thrust_coefficient': options.thrust_coefficient,
                'torque_coefficient': options.torque_coefficient, 'speed_min': options.speed_min,
                'speed_max': options.speed_max,
            },
        }, title)
        Vehicle.from_text(text)
    except ValueError as error:
        raise ParameterError(f'{options.file}: {error}') from None
    print(text, end='')


main = partial(command, 'from-urdf', add_options, run)
