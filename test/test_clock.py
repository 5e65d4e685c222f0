"""Limits of acceleration under a clock that stands still, runs back or is missing."""

import time

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray

from ca_ros.testing import wrench
from nodes import host

RATE = 3600.0
"""Of the rotors [rad/s^2]: 18 rad/s in 5 ms."""


@pytest.mark.parametrize(('clock', 'stamps'), [
    ([], [0]), ([100], [0]), ([100], [10**11]), ([100, 50], [10**11, 5 * 10**10])],
    ids=['missing', 'stands still', 'the same stamp', 'runs back'])
def test_rotors_reach_what_they_reach_in_steady_time(graph, clock, stamps):
    host(graph, 'allocator', '-p', 'use_sim_time:=true', '-p', 'command_timeout:=100.0',
         '-p', f'rotors.acceleration_max:={RATE}')
    command = graph.publisher(WrenchStamped, 'command/wrench')
    ticks = graph.publisher(Clock, '/clock')
    answers = []

    def receive(message):
        answers.append((time.monotonic(), np.array(message.data)))

    graph.node.create_subscription(Float64MultiArray, 'command/motor_speed', receive, 10)
    graph.connect('allocator')
    sent = []
    for k in range(12):
        if clock:
            ticks.publish(Clock(clock=Time(sec=clock[min(k // 6, len(clock) - 1)])))
        thrust, count = (20.0 if k % 2 else 2.0), len(answers)
        sent.append(time.monotonic())
        message = wrench(thrust, stamps[min(k // 6, len(stamps) - 1)], 'base_link')
        command.publish(message)
        graph.spin_until(lambda count=count: len(answers) > count, 'an answer')
    moved = 0.0
    for k in range(2, 12):
        change = np.abs(answers[k][1] - answers[k - 1][1]).max()
        # The node's own time between the two is at most that from the send before to this answer.
        assert change <= RATE * min(0.1, answers[k][0] - sent[k - 1]) + 1e-6
        moved += change
    # They do not freeze either.
    assert moved > 0.0
