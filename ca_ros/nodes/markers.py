"""A vehicle in flight as markers for RViz and Foxglove."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ca_ros.arrays import Array, IntArray
from ca_ros.vehicle.state import rotation_matrix
from ca_ros.vehicle.vehicle import Vehicle

COLORS = {
    'free': (0.0, 0.45, 0.70), 'maximum': (0.84, 0.37, 0.0), 'minimum': (0.90, 0.62, 0.0),
    'lost': (0.54, 0.57, 0.61), 'demand': (0.84, 0.37, 0.0), 'served': (0.0, 0.45, 0.70),
    'body': (0.35, 0.40, 0.46), 'path': (0.0, 0.62, 0.45), 'text': (0.55, 0.55, 0.55),
}  # fmt: skip
"""Those of Okabe and Ito, which the colour-blind can tell apart; text: on dark and on light."""

KINDS = {0: 'free', 1: 'maximum', -1: 'minimum', -2: 'lost'}  # by the values of ``~/saturation``
DISC = 0.42  # radius of a rotor as a share of the least distance between two
LINES_MAX = 2  # of the audit, which can be long


@dataclass
class View:
    """What is known of a flight.

    `speeds` [rad/s] and `saturation` have an entry for each rotor, `angles` [rad] one for each
    servo; wrenches are six numbers, forces before torques [N, N m].  `path` are the places where
    the vehicle was [m].
    """

    position: Array
    attitude: Array
    speeds: Array
    saturation: Sequence[int] | IntArray
    angles: Array = field(default_factory=lambda: np.zeros(0))
    waypoint: Array | None = None
    demand: Array | None = None
    served: Array | None = None
    path: list[Array] = field(default_factory=list)
    text: str = ''


def radius(vehicle: Vehicle) -> float:
    """Return the radius of the rotors' discs [m], so that those side by side do not touch."""
    gaps = np.linalg.norm(vehicle.arms[:, None, :2] - vehicle.arms[:, :2], axis=2)
    apart = gaps[gaps > 1e-6]
    return DISC * float(apart.min()) if apart.size else 0.1


def markers(vehicle: Vehicle, view: View, frame: str, stamp: Time) -> MarkerArray:
    """Return the markers, in the world frame: there need not be a TF."""
    size = float(np.linalg.norm(vehicle.arms, axis=1).max())
    turn = rotation_matrix(view.attitude)
    center, hubs = view.position, view.position + vehicle.arms @ turn.T
    axes = vehicle.servos.directions(view.angles) @ turn.T
    thrusts = vehicle.thrusts(view.speeds) / np.abs(vehicle.thrust_max).max(initial=1e-9)
    found: list[Marker] = []

    def add(
        space: str, kind: int, color: str, scale: Sequence[float], alpha: float = 1.0
    ) -> Marker:
        marker = Marker(ns=space, id=len(found), type=kind, action=Marker.ADD)
        marker.header.frame_id, marker.header.stamp = frame, stamp
        x, y, z = (float(each) for each in scale)
        marker.scale = Vector3(x=x, y=y, z=z)
        marker.color = ColorRGBA(**dict(zip('rgb', COLORS[color], strict=True)), a=alpha)
        marker.pose.orientation.w = 1.0
        found.append(marker)
        return marker

    def arrow(space: str, color: str, start: Array, way: Array, width: float) -> None:
        length = float(np.linalg.norm(way))
        # A head of no length is no arrow.
        if length > 1e-6:
            head = min(3.0 * width, length)
            shape = add(space, Marker.ARROW, color, (width, 2.2 * width, head))
            shape.points = points([start, start + way])

    add('arms', Marker.LINE_LIST, 'body', (0.05 * size, 0.0, 0.0)).points = points(
        [end for hub in hubs for end in (center, hub)]
    )
    arrow('front', 'body', center, 0.4 * size * turn[:, 0], 0.08 * size)
    for hub, axis, thrust, state in zip(hubs, axes, thrusts, view.saturation, strict=True):
        name = KINDS[min(max(int(state), -2), 1)]
        width = 2.0 * radius(vehicle)
        disc = add('rotors', Marker.CYLINDER, name, (width, width, 0.03 * size), 0.6)
        disc.pose.position, disc.pose.orientation = points([hub])[0], upright(axis)
        arrow('thrusts', name, hub, size * thrust * axis, 0.06 * size)
    for name, wrench in (('demand', view.demand), ('served', view.served)):
        if wrench is not None:
            arrow(f'{name} torque', name, center, size * (turn @ wrench[3:]), 0.05 * size)
    if len(view.path) > 1:
        add('path', Marker.LINE_STRIP, 'path', (0.02, 0.0, 0.0)).points = points(view.path)
    if view.waypoint is not None:
        goal = add('waypoint', Marker.SPHERE, 'path', (0.12, 0.12, 0.12), 0.7)
        goal.pose.position = points([view.waypoint])[0]
    text = add('status', Marker.TEXT_VIEW_FACING, 'text', (0.0, 0.0, 0.2 * size))
    text.text = view.text
    text.pose.position = points([center + np.array([0.0, 0.0, 1.6 * size])])[0]
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL), *found])


def status_text(name: str, message: str) -> str:
    """Return the status of a message of the allocator, then `LINES_MAX` lines of its audit."""
    *audit, answer = message.split('; ')
    return '\n'.join([f'{name}: {answer}', *audit[:LINES_MAX]])


def points(places: Sequence[Array]) -> list[Point]:
    """Return places (k, 3) as messages."""
    return [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in places]


def upright(axis: Array) -> Quaternion:
    """Return the shortest turn of the z axis to a unit vector."""
    x, y, z = axis.tolist()
    if z < -1.0 + 1e-9:
        return Quaternion(x=1.0, y=0.0, z=0.0, w=0.0)
    w = np.sqrt((1.0 + z) / 2.0)
    return Quaternion(x=-y / (2.0 * w), y=x / (2.0 * w), z=0.0, w=float(w))
