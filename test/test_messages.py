"""Messages from and to arrays: every number arrives to the last bit."""

import re
import struct

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension

from ca_ros.nodes.messages import (
    nanoseconds,
    pose_arrays,
    read_wrench,
    speeds_message,
    speeds_stamp,
    stamp,
    state_messages,
    twist_arrays,
    wrench_message,
    wrench_numbers,
)
from ca_ros.nodes.rclpy_internals import RMWError

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


@given(st.integers(0, 20).flatmap(vectors), TIMES)
def test_speeds(speeds, time):
    message = sent(speeds_message(speeds, time))
    assert same((np.array(message.data), speeds))
    assert speeds_stamp(message) == time


@given(st.lists(st.text() | st.text().map('stamp {}'.format)))
@example(['stamp \N{SUPERSCRIPT TWO}'])
@example(['stamp ' + '1' * 5000])
@example(['stamp 9223372036854775808'])
def test_foreign_labels_are_no_stamp(labels):
    message = Float64MultiArray()
    message.layout.dim = [MultiArrayDimension(label=label) for label in labels]
    time = speeds_stamp(message)
    # A stamp fits into a header.
    assert time is None or nanoseconds(stamp(time)) == time
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


FRAMES = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=20)


def as_rclpy_reads(data):
    message = deserialize_message(data, WrenchStamped)
    time = nanoseconds(message.header.stamp)
    return message.header, time, np.array(wrench_numbers(message)).tobytes()


def as_read(data):
    command = read_wrench(data)
    return command.header, command.time, np.array(command.wrench).tobytes()


@given(vectors(6), st.integers(-2**31, 2**31 - 1), st.integers(0, 2**32 - 1), FRAMES)
def test_a_wrench_is_read_as_rclpy_reads_it(wrench, seconds, fraction, frame):
    message = wrench_message(wrench, Header(frame_id=frame))
    message.header.stamp.sec, message.header.stamp.nanosec = seconds, fraction
    data = bytes(serialize_message(message))
    expected = message.header, seconds * 10**9 + fraction, wrench.tobytes()
    assert as_read(data) == as_rclpy_reads(data) == expected


def cdr(order, frame, padding, *numbers):
    """Return a WrenchStamped of 3.5 s in CDR, written by hand."""
    head = struct.pack(f'{order}iII', 3, 500_000_000, len(frame))
    body = head + frame + padding + struct.pack(f'{order}{len(numbers)}d', *numbers)
    return (b'\0\1\0\0' if order == '<' else b'\0\0\0\0') + body


NUMBERS = 0.0, -1.0, 9.81, 0.25, 1e-300, 7.0


@pytest.mark.parametrize('order', '<>')
@pytest.mark.parametrize(('frame', 'padding'), [(b'uav\0', b''), (b'uav1\0', b'\xff' * 7)])
def test_a_wrench_of_either_byte_order(order, frame, padding):
    data = cdr(order, frame, padding, *NUMBERS)
    header = Header(stamp=stamp(3_500_000_000), frame_id=frame[:-1].decode())
    expected = header, 3_500_000_000, np.array(NUMBERS).tobytes()
    assert as_read(data) == as_rclpy_reads(data) == expected


@given(st.data())
def test_damaged_bytes_are_read_as_rclpy_reads_them(data):
    sound = cdr('<', b'base_link\0', b'\0\0', *NUMBERS)
    damaged = bytearray(sound)
    for place in data.draw(st.lists(st.integers(0, 30), max_size=3)):
        damaged[place] = data.draw(st.integers(0, 255))
    damaged = bytes(damaged)[: data.draw(st.integers(0, len(damaged)))] + data.draw(st.binary())
    try:
        expected = as_rclpy_reads(damaged)
    except RMWError:
        with pytest.raises(RMWError):
            read_wrench(damaged)
    else:
        assert as_read(damaged) == expected
