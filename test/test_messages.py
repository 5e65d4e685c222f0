"""Messages from and to arrays: every number arrives to the last bit."""

import re

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension

from ca_ros.nodes.messages import (
    nanoseconds,
    pose_arrays,
    speeds_message,
    speeds_stamp,
    stamp,
    state_messages,
    twist_arrays,
    wrench_message,
    wrench_numbers,
)

TIMES = st.integers(0, 2**31 * 10**9 - 1)
"""What a stamp can hold [ns]."""


def vectors(n):
    """Draw arrays (n,) of any floats: signed zeros, subnormal ones, infinities and NaN too."""
    return arrays(float, n)


def sent(message):
    """Return a message as it comes out of the wire."""
    return deserialize_message(serialize_message(message), type(message))


def same(*pairs):
    """Whether arrays are equal to the last bit."""
    return all(a.tobytes() == b.tobytes() for a, b in pairs)


@given(TIMES)
def test_time(time):
    message = sent(Header(stamp=stamp(time))).stamp
    assert nanoseconds(message) == time
    assert message.sec * 10**9 + message.nanosec == time
    assert message.nanosec < 10**9


@given(st.integers(0, 20).flatmap(vectors), TIMES)
def test_speeds(speeds, time):
    message = sent(speeds_message(speeds, time))
    assert same((np.array(message.data), speeds))
    assert speeds_stamp(message) == time


@given(vectors(12))
def test_speeds_of_a_view(numbers):
    assert same((np.array(speeds_message(numbers[::2], 0).data), numbers[::2].copy()))


@given(st.lists(st.text() | st.text().map('stamp {}'.format)))
@example(['stamp \N{SUPERSCRIPT TWO}'])
@example(['stamp ' + '1' * 5000])
def test_foreign_labels_are_no_stamp(labels):
    message = Float64MultiArray()
    message.layout.dim = [MultiArrayDimension(label=label) for label in labels]
    time = speeds_stamp(message)
    assert time is None or any(re.fullmatch(f'stamp 0*{time}', label) for label in labels)


@given(vectors(3), vectors(4), vectors(3), vectors(3), TIMES)
def test_state(position, attitude, velocity, angular_velocity, time):
    messages = state_messages(
        position, attitude, velocity, angular_velocity, stamp(time), 'odom', 'uav1/base_link')
    pose, twist = map(sent, messages)
    state = position, attitude, velocity, angular_velocity
    assert same(*zip((*pose_arrays(pose), *twist_arrays(twist)), state, strict=True))
    assert (pose.header.frame_id, twist.header.frame_id) == ('odom', 'uav1/base_link')
    assert nanoseconds(pose.header.stamp) == nanoseconds(twist.header.stamp) == time


@given(vectors(6), TIMES, st.text(st.characters(exclude_characters='\0', codec='utf-8')))
def test_wrench(wrench, time, frame):
    message = sent(wrench_message(wrench, Header(stamp=stamp(time), frame_id=frame)))
    force, torque = message.wrench.force, message.wrench.torque
    assert same(
        (np.array(wrench_numbers(message)), wrench),
        (np.array([force.x, force.y, force.z]), wrench[:3]),
        (np.array([torque.x, torque.y, torque.z]), wrench[3:]))
    assert (nanoseconds(message.header.stamp), message.header.frame_id) == (time, frame)
