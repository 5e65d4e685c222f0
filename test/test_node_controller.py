"""The controller node, over DDS."""

import math
import time

import numpy as np
import pytest
from rcl_interfaces.msg import Log

from ca_ros.control.controller import Controller
from ca_ros.control.waypoint import Waypoint
from ca_ros.testing import Graph, counts, six
from nodes import (
    LAW,
    REST,
    WAYPOINT,
    ControllerClient,
    expected,
    host,
    pose_message,
    velocity_message,
)
from strategies import file_values, settings_of


@pytest.fixture(scope='module')
def client():
    """Share a controller that flies to `WAYPOINT`."""
    with Graph() as graph:
        client = ControllerClient(graph, host)
        client.send_waypoint(*WAYPOINT)
        yield client


def test_no_wrench_before_a_waypoint_and_waypoints_are_logged_once_a_second(graph):
    client = ControllerClient(graph)
    for _ in range(3):
        client.send(*REST)
        client.settle()
    assert client.wrenches == []
    begun = time.monotonic()
    for i in range(100):
        client.waypoint.publish(pose_message((1.0, 2.0, float(i)), WAYPOINT[1], 0))
        time.sleep(0.01)
    client.send_waypoint(*WAYPOINT)

    def lines():
        return [entry.msg[:18] for entry in client.log if entry.msg.startswith('waypoint')]

    client.graph.spin_until(lambda: lines()[-1:] == ['waypoint [1. 2. 3.'], 'the last waypoint')
    assert 2 <= len(lines()) <= 2 + time.monotonic() - begun
    for _ in range(3):
        client.send_waypoint(*WAYPOINT)
    assert lines().count('waypoint [1. 2. 3.') <= 2
    assert client.ask(*REST).tobytes() == expected(REST).tobytes()


def test_wrenches_equal_those_of_the_law_to_the_last_bit(client):
    rng = np.random.default_rng(0)
    for _ in range(100):
        position, velocity, angular_velocity = rng.normal(scale=3.0, size=(3, 3))
        attitude = rng.normal(size=4)
        state = position, attitude / np.linalg.norm(attitude), velocity, angular_velocity
        assert client.ask(*state).tobytes() == expected(state).tobytes()
    assert client.stamps() == sorted(set(client.stamps()))
    assert {message.header.frame_id for message in client.wrenches} == {'base_link'}


def test_pose_and_velocity_of_different_times_are_not_combined(client):
    before = len(client.wrenches)
    times = [client.new_stamp() for _ in range(4)]
    client.pose.publish(pose_message(*REST[:2], times[0]))
    client.velocity.publish(velocity_message(*REST[2:], times[1]))
    client.pose.publish(pose_message(*REST[:2], times[2]))
    client.velocity.publish(velocity_message(*REST[2:], times[3]))
    client.ask(*REST)
    assert client.stamps()[before:] == [client.last]


@pytest.mark.parametrize('frame', ['base_link', 'odom'])
def test_a_waypoint_in_another_frame_is_refused_and_the_old_one_stays(client, frame):
    message = pose_message((5.0, 5.0, 5.0), (0.0, 0.0, 0.0, 1.0), 0)
    message.header.frame_id = frame
    # Not more than one a second is said of.
    client.graph.spin_until(
        lambda: any(frame in entry.msg and 'expected map' in entry.msg for entry in client.log),
        'word of it', repeat=lambda: client.waypoint.publish(message))
    assert client.ask(*REST).tobytes() == expected(REST).tobytes()


def test_a_state_in_another_frame_is_not_answered(client):
    before = len(client.wrenches)
    for pose_frame, velocity_frame in (('odom', 'base_link'), ('map', 'map')):
        stamp = client.new_stamp()
        pose, velocity = pose_message(*REST[:2], stamp), velocity_message(*REST[2:], stamp)
        pose.header.frame_id, velocity.header.frame_id = pose_frame, velocity_frame
        client.pose.publish(pose)
        client.velocity.publish(velocity)
    client.ask(*REST)
    assert client.stamps()[before:] == [client.last]


def test_a_new_waypoint_waits_for_the_next_state(client):
    client.ask(*REST)
    before = len(client.wrenches)
    client.send_waypoint(*WAYPOINT)
    client.settle()
    client.ask(*REST)
    assert client.stamps()[before:] == [client.last]


def test_a_waypoint_without_attitude_is_refused_and_the_old_one_stays(client):
    client.waypoint.publish(pose_message((5.0, 5.0, 5.0), (0.0, 0.0, 0.0, 0.0), 0))
    client.graph.spin_until(
        lambda: any(entry.level == Log.WARN and 'waypoint' in entry.msg for entry in client.log),
        'word of it')
    assert client.ask(*REST).tobytes() == expected(REST).tobytes()


def test_what_it_cuts_off_the_demand_is_published_and_warned_of(client):
    tilted = REST[0], (0.3, 0.2, 0.0, 0.93), REST[2], (0.0, 0.0, -6.0)
    parts = [np.array(part) for part in (*tilted, *WAYPOINT)]
    demand = np.concatenate([np.zeros(2), LAW.demand(*parts[:4], Waypoint(*parts[4:]))])
    for state, wanted in ((tilted, demand), (REST, expected(REST))):
        stamps = []
        # The node may learn only after the first state that somebody listens.
        client.graph.spin_until(
            lambda stamps=stamps: stamps and all(
                messages and messages[-1].header.stamp.sec == stamps[-1]
                for messages in (client.wrenches, client.unallocated)),
            'what was cut',
            repeat=lambda stamps=stamps, state=state: stamps.append(client.send(*state)))
        cut = six(client.unallocated[-1])
        np.testing.assert_allclose(six(client.wrenches[-1]) + cut, wanted, rtol=0.0, atol=1e-12)
        assert cut.any() == (state is tilted)
    # It lasts a second: whoever waits for it has the node cut again.
    cuts = client.graph.node.create_timer(0.1, lambda: client.send(*tilted))
    values = client.diagnostics.wait(
        '/controller', lambda level, message, values: 'not attainable' in message, 'a warning')[2]
    cuts.cancel()
    assert counts(values)['cut'] >= 1
    assert 'yaw' in values['unallocated [N, N m]']
    assert float(values['least yaw served [%]']) < 100.0
    # The least since the node began may be that of another test, cut by the priorities.
    reason = values['least yaw served limited by']
    assert 'rotor' in reason or reason == 'axes that come first'
    client.graph.spin_until(
        lambda: any('unallocated: ' in entry.msg for entry in client.log), 'a line in the log')


def test_a_tilt_beyond_what_is_commanded_is_warned_of(client):
    for half, said in ((0.55, False), (0.65, True)):
        fallen = REST[0], (math.sin(half), 0.0, 0.0, math.cos(half)), *REST[2:]
        timer = client.graph.node.create_timer(0.02, lambda fallen=fallen: client.send(*fallen))
        client.diagnostics.wait(
            '/controller',
            lambda level, message, values, said=said: message and said == ('tilt' in message)
            and 'no ' not in message, 'a status')
        timer.cancel()


def test_a_position_that_leaves_the_plan_is_warned_of(client):
    def off_plan():
        return [entry.msg for entry in client.log if 'leaves the plan' in entry.msg]

    away = -np.array(WAYPOINT[0]) / np.linalg.norm(WAYPOINT[0])
    client.send_waypoint(*WAYPOINT)
    client.log.clear()
    for grown in (0.0, 0.9):
        client.ask(tuple(grown * LAW.settings.speed_max * away), *REST[1:])
        client.settle()
        assert not off_plan()
    until = time.monotonic() + 60.0
    while not off_plan() and time.monotonic() < until:
        client.ask(tuple(1.1 * LAW.settings.speed_max * away), *REST[1:])
        client.settle()
    assert off_plan()[0].endswith(' m from the waypoint, after 3.74 m')


def test_it_gives_way_by_the_order_of_its_parameters(client):
    # Tilted and turning so much that not all can be given.
    state = REST[0], (0.3, 0.2, 0.0, 0.93), REST[2], (0.0, 0.0, -6.0)
    order = ['yaw', 'thrust', 'roll pitch']
    assert client.ask(*state).tobytes() == expected(state).tobytes()
    for result in client.parameters.set({'allocation.exact.order': order}):
        assert result.successful, result.reason
    law = Controller.from_settings(LAW.vehicle, settings_of({'allocation.exact.order': order}))
    parts = [np.array(part) for part in (*state, *WAYPOINT)]
    wrench = np.concatenate([np.zeros(2), law.wrench(*parts[:4], Waypoint(*parts[4:]))])
    assert abs(wrench[5] - expected(state)[5]) > 0.01
    assert client.ask(*state).tobytes() == wrench.tobytes()
    default = file_values('hexarotor')['allocation.exact.order']
    for result in client.parameters.set({'allocation.exact.order': default}):
        assert result.successful, result.reason
    (result,) = client.parameters.set({'allocation.exact.order': ['yaw']})
    assert not result.successful
    assert 'allocation.exact.order' in result.reason
