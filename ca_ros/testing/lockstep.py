"""Lockstep with the simulator: a record of each step, single steps, and wrench messages."""

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from numpy.typing import ArrayLike
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from ca_ros.arrays import Array
from ca_ros.nodes.messages import nanoseconds, stamp, wrench_message, wrench_numbers
from ca_ros.nodes.topics import POSE, TILTS, VELOCITY, WRENCH, offered
from ca_ros.process.samples import SAMPLED, Samples
from ca_ros.simulation.record import Flight
from ca_ros.testing.graph import Graph
from ca_ros.vehicle.vehicle import Vehicle

ROWS = 11  # number of states in the table of a report

HEAD = 't [s] position [m]               rates [rad/s]              thrust [N], torques [N m]'


class Lockstep:
    """A simulator in lockstep with the nodes under test, and a record of all its steps.

    The simulator takes a step when rotor speeds answer its state, so a flight does not depend on
    the speed of the machine.  To test a plant of one's own, start it first, and leave the
    simulator out of `nodes`, the nodes of this package to start.  They all get the ROS arguments,
    such as ``('-p', 'rotors.health:=0.9')``.  The vehicle is a shipped one or a parameter file.
    """

    def __init__(
        self, graph: Graph, vehicle: str = 'hexarotor',
        nodes: Sequence[str] = ('simulator', 'allocator'), ros_arguments: Sequence[str] = (),
    ) -> None:
        self._graph, self._samples = graph, Samples()
        model = Vehicle.load(vehicle)
        self._samples.expect(model.n, len(model.servos))
        self._wrenches: dict[int, WrenchStamped] = {}
        for topic in (*SAMPLED, TILTS, WRENCH):
            receive: Any = partial(self._samples.add, topic.name)
            if topic is WRENCH:
                receive = self._receive_wrench
            graph.node.create_subscription(topic.kind, topic.name, receive, offered('lockstep'))
        graph.sections['lockstep'] = self.table
        arguments = ['--vehicle', vehicle, '--ros-args', '-p', 'mode:=lockstep', *ros_arguments]
        if 'simulator' in nodes:
            graph.start('simulator', *arguments)
        # Without an answer the simulator waits, so the record has the first step, too.
        graph.spin_until(
            lambda: {topic.name for topic in SAMPLED} <= self._samples.newest.keys(),
            'lockstep: the first state',
        )
        for node in nodes:
            if node != 'simulator':
                graph.start(node, *arguments)

    @property
    def time(self) -> int:
        """The stamp of the present state [ns]."""
        return min(self._samples.newest[topic.name] for topic in (POSE, VELOCITY))

    def run(self, until: float) -> Flight:
        """Return the flight up to a time [s], inclusive; an AssertionError without an answer."""
        __tracebackhide__ = True
        end = round(until * 1e9)
        while self.time <= end:
            self._advance()
        return self._samples.flight(end)

    def step(self, numbers: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Answer the present state with a wrench, see `wrench`; return the next state.

        Position (3,), attitude (4,), velocity (3,) and angular velocity (3,) are as in `Flight`.
        Raises an AssertionError if the simulator does not take the step.
        """
        __tracebackhide__ = True
        message = wrench(numbers, self.time)
        self._advance(repeat=lambda: self._command.publish(message))
        return self._samples.state(self.time)

    def table(self) -> str:
        """Return states and commands of the flight as a table; empty before the first step."""
        samples, lines = self._samples, [HEAD]
        flight = samples.flight(max(samples.newest.values(), default=0))
        last = len(flight.time) - 1
        if last < 0:
            return ''
        for k in sorted({last * i // (ROWS - 1) for i in range(ROWS)}):
            time, position, rates = flight.time[k], flight.position[k], flight.angular_velocity[k]
            command = self._wrenches.get(round(time * 1e9))
            numbers = [*position, *rates, *(six(command)[2:] if command else [])]
            lines.append(f'{time:5.2f}{"".join(f" {x:8.3g}" for x in numbers)}')
        return '\n'.join(lines)

    @cached_property
    def _command(self) -> Publisher:
        return self._graph.publisher(WRENCH.kind, WRENCH.name)

    def _advance(self, repeat: Callable[[], object] | None = None) -> None:
        """Wait for the next state."""
        __tracebackhide__ = True
        time, wrenches = self.time, self._wrenches
        # The messages of a step may arrive in any order.
        self._graph.spin_until(
            lambda: self.time > time
            and self._samples.answered(time)
            and (time in wrenches or not wrenches),
            f'lockstep: rotor speeds that answer the state at {time / 1e9:g} s',
            repeat,
        )

    def _receive_wrench(self, message: WrenchStamped) -> None:
        self._wrenches[nanoseconds(message.header.stamp)] = message


def wrench(numbers: ArrayLike, time: int = 0, frame: str = '') -> WrenchStamped:
    """Return the message of a wrench (6,), force [N] before torque [N m], or of a thrust [N].

    The message has the stamp `time` [ns] and the frame `frame`.
    """
    values = np.asarray(numbers, dtype=float)
    if not values.ndim:
        values = np.array([0.0, 0.0, values, 0.0, 0.0, 0.0])
    return wrench_message(values, Header(stamp=stamp(time), frame_id=frame))


def six(message: WrenchStamped) -> Array:
    """Return the wrench (6,) of a message: force [N] before torque [N m]."""
    return np.array(wrench_numbers(message))
