"""Load on the nodes and on the machine, and flights that a loaded machine may disturb."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

PACES = 1.0, 0.3, 0.1
"""Real time factors; with the last a loop of nodes keeps up even where it is starved."""

STARVED = 0.25
"""What others must have had of the processors' time for a flight to be repeated more slowly."""


def taken():
    """Return what others than this process and its children have had of the processors [s]."""
    ticks = list(map(int, Path('/proc/stat').read_text().split('\n', 1)[0].split()[1:9]))
    # All but idle and waiting for input and output; with what the hypervisor gave to others.
    busy = (sum(ticks) - ticks[3] - ticks[4]) / os.sysconf('SC_CLK_TCK')
    own = sum(os.times()[:4])
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            own += sum(child.cpu_times()[:2])
    return busy - own


def fly_in_real_time(flight):
    """Fly, and more slowly if that fails where others had the processors.

    `flight` takes the real time factor.  A vehicle whose loop is starved falls, in real time; but
    on a machine that had time for it there is no excuse.
    """
    for factor in PACES:
        begun, before = time.monotonic(), taken()
        try:
            return flight(factor)
        except AssertionError as error:
            share = (taken() - before) / (time.monotonic() - begun) / os.cpu_count()
            print(f'others had {share:.0%} of the processors during: {error}')
            if share < STARVED or factor == PACES[-1]:
                raise


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
