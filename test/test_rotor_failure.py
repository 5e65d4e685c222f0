"""A rotor fails in flight, over DDS: announced through rotors.health, or not."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Float64MultiArray

LOST = [0.0, 1.0, 1.0, 1.0, 1.0, 1.0]
HOVER, NEXT = np.array([0.0, 0.0, 1.0]), np.array([1.0, 1.0, 2.0])


def waypoint(position):
    message = PoseStamped()
    p = message.pose.position
    p.x, p.y, p.z = position.tolist()
    return message


def distance(pose, goal):
    p = pose.pose.position
    return float(np.linalg.norm(np.array([p.x, p.y, p.z]) - goal))


@pytest.mark.slow
@pytest.mark.parametrize('announced', [True, False])
def test_a_ppnnpn_hexarotor_loses_rotor_1_at_hover(graph, announced):
    for name in ('controller', 'allocator', 'simulator'):
        graph.start(name, '--vehicle', 'hexarotor_ppnnpn', '--ros-args', '-p', 'mode:=lockstep')
    goal = graph.publisher(PoseStamped, 'command/pose')
    poses = graph.listen(PoseStamped, 'local_position/pose')
    speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
    nodes = {name: graph.connect(f'/{name}') for name in ('controller', 'allocator', 'simulator')}

    def arrived(position):
        return bool(poses) and distance(poses[-1], position) < 0.02

    graph.spin_until(
        lambda: arrived(HOVER), 'hover', repeat=lambda: goal.publish(waypoint(HOVER)))
    # The simulator loses the rotor last: in lockstep any order is the same to the vehicle, but
    # the others must know before its next commands are flown.
    for name in ['controller', 'allocator'] * announced + ['simulator']:
        (result,) = nodes[name].set({'rotors.health': LOST})
        assert result.successful, result.reason
    del poses[:], speeds[:]
    graph.spin_until(
        lambda: arrived(NEXT) or any(distance(pose, NEXT) > 20.0 for pose in poses[-1:]),
        'the next waypoint, or far from it',
        repeat=lambda: goal.publish(waypoint(NEXT)))
    assert arrived(NEXT) == announced
    if announced:
        # Not the first ones, which may have been on their way since before the loss.
        assert all(message.data[0] == 0.0 for message in speeds[-100:])
    assert np.isfinite([message.data for message in speeds]).all()
