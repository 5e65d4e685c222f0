"""The viewer: its markers, and that it publishes only while somebody looks."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Float64MultiArray

from ca_ros import Vehicle
from ca_ros.testing import Diagnostics

messages = pytest.importorskip('visualization_msgs.msg', reason='needs visualization_msgs')
from ca_ros.nodes.markers import View, markers, status_text, upright  # noqa: E402

TURN = np.array([0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4)])
"""Ninety degrees about z."""


def drawn(name='hexarotor', **view):
    vehicle = Vehicle.load(name)
    shown = View(np.array([1.0, 2.0, 3.0]), TURN, np.full(6, 400.0), [1, 0, -1, -2, 0, 0], **view)
    found = markers(vehicle, shown, 'map', PoseStamped().header.stamp).markers
    assert found[0].action == messages.Marker.DELETEALL
    assert len({marker.id for marker in found[1:]}) == len(found) - 1
    return found[1:]


def of(found, space):
    return [marker for marker in found if marker.ns == space]


def test_rotors_stand_where_they_are_in_the_world_and_show_their_bounds():
    found = drawn()
    discs = of(found, 'rotors')
    # Rotor 1 is 0.4 m in front of the centre of mass: after the turn to its left.
    place = discs[0].pose.position
    np.testing.assert_allclose([place.x, place.y, place.z], [1.0, 2.4, 3.0], atol=1e-12)
    assert len({(disc.color.r, disc.color.g) for disc in discs}) == 4
    # Neighbours are 0.4 m apart.
    assert 0.3 < discs[0].scale.x < 0.4
    start, end = of(found, 'thrusts')[0].points
    np.testing.assert_allclose([end.x - start.x, end.y - start.y, end.z - start.z], [0, 0, 0.4])


def test_thrusts_of_rotors_that_tilt():
    found = drawn('hexarotor_tilting', angles=np.array([0.5, 0, 0, 0, 0, 0]))
    start, end = of(found, 'thrusts')[0].points
    # About its arm, from up to the right, which is forwards in the world after the turn.
    np.testing.assert_allclose(
        [end.x - start.x, end.y - start.y, end.z - start.z],
        [0.4 * np.sin(0.5), 0, 0.4 * np.cos(0.5)], atol=1e-12)


def test_torques_path_waypoint_and_status():
    found = drawn(
        demand=np.array([0, 0, 9.81, 1.0, 0, 0]), served=np.array([0, 0, 9.81, 0.5, 0, 0]),
        path=[np.zeros(3), np.ones(3)], waypoint=np.array([4.0, 5.0, 6.0]), text='EXACT')
    lengths = {}
    for name in ('demand torque', 'served torque'):
        [arrow] = of(found, name)
        start, end = arrow.points
        # A roll torque, along the x axis of the body, which is the y axis of the world.
        assert abs(end.x - start.x) < 1e-12
        lengths[name] = end.y - start.y
    assert lengths['demand torque'] == pytest.approx(2.0 * lengths['served torque'])
    assert len(of(found, 'path')[0].points) == 2
    assert of(found, 'waypoint')[0].pose.position.x == 4.0
    assert of(found, 'status')[0].text == 'EXACT'


def test_the_text_has_the_status_first_and_no_long_audit():
    message = 'yaw lost; it spins; hover margin 0.9; around hover: roll -1 to +1 N m; EXACT'
    assert status_text('x8', message) == 'x8: EXACT\nyaw lost\nit spins'
    assert status_text('x8', 'EXACT') == 'x8: EXACT'


@pytest.mark.parametrize('axis', [[0, 0, 1], [0, 0, -1], [0.6, 0, 0.8], [0, -0.6, -0.8]])
def test_discs_are_normal_to_the_axes(axis):
    q = upright(np.array(axis, float))
    x, y, z, w = q.x, q.y, q.z, q.w
    third = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    np.testing.assert_allclose(third, axis, atol=1e-12)


def test_the_node_publishes_only_while_somebody_looks(graph):
    graph.start('viewer', '--vehicle', 'hexarotor')
    diagnostics = Diagnostics(graph)
    pose = graph.publisher(PoseStamped, 'local_position/pose')
    speeds = graph.publisher(Float64MultiArray, 'command/motor_speed')
    here = PoseStamped()
    here.header.frame_id = 'map'
    here.pose.orientation.w = 1.0

    def looked(condition):
        def step():
            here.header.stamp.sec += 1
            here.pose.position.z += 0.1
            pose.publish(here)
            speeds.publish(Float64MultiArray(data=[250.0] * 6))
            return condition()
        return step

    def idle():
        states = diagnostics.all('viewer')
        return states and states[-1][1] == 'nobody looks'

    graph.spin_until(looked(idle), 'the viewer has a state')
    assert 'pictures' not in diagnostics.all('viewer')[-1][2]
    found = graph.listen(messages.MarkerArray, 'viewer/markers')
    graph.spin_until(looked(lambda: len(found) > 3), 'markers')
    assert {marker.ns for marker in found[-1].markers} >= {'rotors', 'thrusts', 'status', 'path'}
    stamps = [message.markers[1].header.stamp.sec for message in found]
    assert stamps == sorted(set(stamps))
