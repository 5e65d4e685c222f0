"""What the tests of the nodes share: a ROS graph of their own, with real processes in it."""

import fcntl
import os
import random
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
import uuid
from collections import Counter
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path

import numpy as np
import psutil
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from ca_ros.bringup.deadline import Deadline

DEADLINE = 240.0
"""When something that has not happened is held to be never going to [s]."""

FIRST_PAUSE, LAST_PAUSE = 0.25, 2.0
"""Between repetitions of a message that may have been lost, or of which the answer was [s]."""

SLOW_MOTION = 0.1
"""Real time factor at which a loop of nodes keeps up even where it is starved of processors."""

MARK = 'CA_ROS_TEST_GRAPH'
"""Set in the environment of a graph's processes, so that those that they start are found too."""

RELIABLE, BEST_EFFORT = (
    QoSProfile(reliability=reliability, history=HistoryPolicy.KEEP_LAST, depth=1000)
    for reliability in (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
)


def executable(name):
    """Return the path of an installed executable, colcon's before pip's, or a path as it is."""
    if Path(name).is_absolute():
        return Path(name)
    prefixes = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    places = [Path(prefix, 'lib', 'ca_ros') for prefix in prefixes]
    for place in [*places, Path(sysconfig.get_path('scripts'))]:
        if (place / name).is_file():
            return place / name
    pytest.fail(f"no executable '{name}': install the package, with pip install -e . or colcon")


class Graph:
    """A ROS graph: processes and one node of the test, in a domain that no other test uses."""

    def __enter__(self):
        self.domain, self._lock = _claim_domain()
        self._mark = uuid.uuid4().hex
        self._processes = {}
        self._ends = []
        return self

    def __exit__(self, fault, *_):
        running = [process for process in self._processes.values() if process.poll() is None]
        for process in running:
            process.send_signal(signal.SIGINT)
        for process in running:
            with suppress(subprocess.TimeoutExpired):
                process.wait(DEADLINE)
        left = self.alive()
        for process in left:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        for process in self._processes.values():
            process.communicate()
        psutil.wait_procs(left, DEADLINE)
        if 'node' in vars(self):
            self._executor.shutdown()
            self.node.destroy_node()
            rclpy.shutdown(context=self.node.context)
        self._lock.close()
        if fault is None:
            assert not left
            assert [process.returncode for process in running] == [0] * len(running)

    # Processes

    def start(self, name, *arguments, **options):
        """Start an executable in a process group of its own."""
        environment = os.environ | {'ROS_DOMAIN_ID': str(self.domain), MARK: self._mark}
        process = subprocess.Popen(
            [executable(name), *arguments], env=environment, start_new_session=True,
            stdin=subprocess.DEVNULL, text=True, **options)
        self._processes[f'{name} {process.pid}'] = process
        return process

    def start_silent(self, name, *arguments):
        """Start an executable whose output `communicate` will return."""
        # So much fits in before somebody must read it.
        return self.start(
            name, *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, pipesize=1 << 20)

    def end(self, process, number):
        """Send a signal to a process of `start_silent`; return what it had to say."""
        process.send_signal(number)
        return self.outlive(process)

    def outlive(self, process, deadline=DEADLINE):
        """Wait until a process of `start_silent` ends; return what it had to say."""
        limit, output = Deadline(deadline), None
        while output is None and not limit.passed():
            with suppress(subprocess.TimeoutExpired):
                output = process.communicate(timeout=0.1)
        if output is None:
            # Our executables then show where they are.
            process.send_signal(signal.SIGUSR1)
            try:
                _, err = process.communicate(timeout=5.0)
            except subprocess.TimeoutExpired as late:
                err = (late.stderr or b'').decode()
            process.kill()
            raise AssertionError(f'not ended within {deadline:g} s: {err}')
        # From here on it is not missed.
        self._processes = {k: p for k, p in self._processes.items() if p is not process}
        return output

    def alive(self):
        """Return the processes of this graph, and those that they have started."""
        found = []
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                if process.environ().get(MARK) == self._mark:
                    found.append(process)
        return found

    # The node

    @cached_property
    def node(self):
        """The node of the test."""
        context = rclpy.Context()
        rclpy.init(
            args=[], context=context, domain_id=self.domain,
            signal_handler_options=SignalHandlerOptions.NO)
        return rclpy.create_node(
            'test', context=context, start_parameter_services=False, enable_rosout=False)

    @cached_property
    def _executor(self):
        executor = SingleThreadedExecutor(context=self.node.context)
        executor.add_node(self.node)
        return executor

    def publisher(self, kind, topic, qos=RELIABLE):
        """Return a publisher."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self._ends.append((topic, publisher.get_subscription_count))
        return publisher

    def listen(self, kind, topic, qos=RELIABLE):
        """Return a list that grows with the messages of a topic."""
        messages = []
        subscription = self.node.create_subscription(kind, topic, messages.append, qos)
        self._ends.append((topic, subscription.get_publisher_count))
        return messages

    def connect(self, name, parameter='mode'):
        """Wait until the ends of all topics have found each other; return a node's parameters.

        A participant's ends are announced in the order in which they were made: a node that
        answers a service's client knows all ends that were made before the client.
        """
        parameters = Parameters(self, name)
        for topic, matched in self._ends:
            self.spin_until(matched, f'{topic}: matched')
        parameters.get(parameter)
        return parameters

    def spin_until(self, condition, what, repeat=None, deadline=DEADLINE):
        """Spin until a condition holds; `repeat` is called at first and ever more rarely."""
        limit, again, pause = Deadline(deadline), time.monotonic(), FIRST_PAUSE
        while not condition():
            ended = {k: p.returncode for k, p in self._processes.items() if p.poll() is not None}
            assert not ended, f'{what}: waited for in vain, exit codes: {ended}'
            assert not limit.passed(), f'{what}: not within {deadline:g} s'
            if repeat and time.monotonic() >= again:
                repeat()
                again, pause = time.monotonic() + pause, min(2.0 * pause, LAST_PAUSE)
            self._executor.spin_once(timeout_sec=0.1)


def fly_in_real_time(flight):
    """Fly, and once more in slow motion if that fails: `flight` takes the real time factor.

    A vehicle whose loop is starved of processors falls, in real time.
    """
    try:
        return flight(1.0)
    except AssertionError as error:
        print(f'in slow motion once more, after: {error}')
        return flight(SLOW_MOTION)


def _claim_domain():
    """Lock one of the domains that DDS has ports for; 0 is everyone's, and left alone."""
    for domain in random.sample(range(1, 102), 101):
        path = Path(tempfile.gettempdir(), f'ca_ros_domain_{domain}')
        try:
            if not path.exists():
                path.touch()
            lock = path.open()
        except PermissionError:
            # Another user's.
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
        else:
            return domain, lock
    pytest.fail('all ROS domains are claimed')


class Diagnostics:
    """What the nodes of a graph say of themselves."""

    def __init__(self, graph):
        self._graph = graph
        self.arrays = graph.listen(DiagnosticArray, '/diagnostics')

    def all(self, node):
        """Return what a node has said: level, message and values of each time."""
        return [
            (status.level, status.message, {pair.key: pair.value for pair in status.values})
            for array in self.arrays for status in array.status
            if status.name.startswith(f'{node.lstrip("/")}: ')]

    def wait(self, node, condition, what):
        """Wait until the newest level, message and values fulfil a condition; return them."""
        def fulfilled():
            said = self.all(node)
            return bool(said) and condition(*said[-1])
        self._graph.spin_until(fulfilled, f'{node} says: {what}')
        return self.all(node)[-1]


def counts(values):
    """Return the counts among the values of a diagnosis; those that are not there are zero."""
    return Counter({
        key: int(value) for key, value in values.items() if value.isdigit() and '[' not in key})


class Parameters:
    """The parameters of a node in another process, through its services."""

    def __init__(self, graph, node):
        self._graph = graph
        self._clients = {
            kind: graph.node.create_client(kind, f'{node}/{name}')
            for kind, name in (
                (SetParameters, 'set_parameters'),
                (SetParametersAtomically, 'set_parameters_atomically'),
                (GetParameters, 'get_parameters'))}

    def get(self, *names):
        """Return the values of parameters."""
        answer = self._call(GetParameters, GetParameters.Request(names=names))
        return [parameter_value_to_python(value) for value in answer.values]

    def set(self, values):
        """Set parameters one by one; return the result of each."""
        request = SetParameters.Request(parameters=_written(values))
        return self._call(SetParameters, request).results

    def set_atomically(self, values):
        """Set parameters all or none; return the result."""
        request = SetParametersAtomically.Request(parameters=_written(values))
        return self._call(SetParametersAtomically, request).result

    def _call(self, kind, request):
        client, futures = self._clients[kind], []
        self._graph.spin_until(client.service_is_ready, f'{client.srv_name}: ready')
        # The answer is lost if the node has not yet found the client's end that waits for it.
        self._graph.spin_until(
            lambda: any(future.done() for future in futures), f'{client.srv_name}: answered',
            repeat=lambda: futures.append(client.call_async(request)))
        return next(future.result() for future in futures if future.done())


def _written(values):
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


def wrench(numbers, time=0, frame=''):
    """Return the message of a wrench (6,), force before torque, or of a thrust, at a time [ns]."""
    message = WrenchStamped()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time, 10**9)
    f, t = message.wrench.force, message.wrench.torque
    f.x, f.y, f.z, t.x, t.y, t.z = map(
        float, (0, 0, numbers, 0, 0, 0) if np.isscalar(numbers) else numbers)
    return message


def six(message):
    """Return a wrench (6,), force before torque."""
    f, t = message.wrench.force, message.wrench.torque
    return np.array([f.x, f.y, f.z, t.x, t.y, t.z])


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
    return graph.start_silent(sys.executable, '-c', FLOOD, name, str(number))


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
