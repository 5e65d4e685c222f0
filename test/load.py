"""Load on the nodes and on the machine, and flights that a loaded machine may disturb."""

import os
import subprocess
import sys
from contextlib import contextmanager

PACES = 1.0, 0.3, 0.1
"""Real time factors; with the last a loop of nodes keeps up even where it is starved."""


def fly_in_real_time(flight):
    """Fly, and more slowly if that fails: `flight` takes the real time factor.

    A vehicle whose loop is starved of processors falls, in real time.
    """
    for factor in PACES[:-1]:
        try:
            return flight(factor)
        except AssertionError as error:
            print(f'more slowly once more, after: {error}')
    return flight(PACES[-1])


FLOOD = """
import sys, time
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

name, number = sys.argv[1], float(sys.argv[2])
rclpy.init()
if name == 'allocator':
    topic, message = 'command/wrench', WrenchStamped()
    message.wrench.force.z = number
else:
    topic, message = 'command/motor_speed', Float64MultiArray(data=[number] * 6)
publisher = rclpy.create_node('flood').create_publisher(type(message), topic, 1)
encoded = serialize_message(message)
while not publisher.get_subscription_count():
    time.sleep(0.01)
begun, sent = time.monotonic(), 0
while True:
    if sent < 1e4 * (time.monotonic() - begun):
        publisher.publish(encoded)
        sent += 1
"""


def start_flood(graph, name, number):
    """Flood an allocator or a simulator with commands of this thrust [N] or speed [rad/s]."""
    return graph.start(sys.executable, '-c', FLOOD, name, str(number))


@contextmanager
def busy_processors():
    """Keep each processor busy with a process of its own."""
    processes = [
        subprocess.Popen([sys.executable, '-c', 'while True: pass'])
        for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
