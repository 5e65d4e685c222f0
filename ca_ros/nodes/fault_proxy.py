"""The fault proxy node: forwards messages with losses, delays and damage."""

import argparse
from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from math import inf
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from ca_ros.nodes.diagnostics import OK, WARN, DiagnosticsPublisher, mismatch
from ca_ros.nodes.executable import run, split
from ca_ros.nodes.link_faults import FAULTY, FaultSettings, Link, corrupted
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.stream import STEADY
from ca_ros.nodes.topics import deep
from ca_ros.settings import ParameterError, Settings, table

PREFIX = 'faulty/'


def remaps(node: str) -> list[str]:
    """Return the ROS arguments that make a node subscribe to the faulty topics."""
    topics = [topic.name for topic in FAULTY if node in topic.subscribers]
    return [word for topic in topics for word in ('-r', f'{topic}:={PREFIX}{topic}')]


class FaultProxyNode(Node):
    """Subscribes to each topic and publishes its messages, with faults, on faulty/topic."""

    declared = FaultSettings

    def __init__(self, node_name: str = 'fault_proxy', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.parameters = Parameters(self, FaultSettings, FaultSettings)
        if unknown := self.parameters.unknown:
            names = ', '.join(table(FaultSettings))
            raise ParameterError(f'{unknown[0]}: no such parameter ({names})')
        self._use(self.parameters.settings.links())
        self.parameters.on_change(lambda settings: settings.links(), self._use)
        # With deep queues the proxy itself loses no message.
        quality = deep()
        kinds = {topic.name: topic.kind for topic in FAULTY if topic.name in self._faults}
        self._links = {topic: Link[Any]() for topic in self._faults}
        self._counts = {topic: Counter[str]() for topic in self._faults}
        self._out = {
            topic: self.create_publisher(kind, f'{PREFIX}{topic}', quality)
            for topic, kind in kinds.items()
        }
        self._in = {
            topic: self.create_subscription(kind, topic, partial(self._take, topic), quality)
            for topic, kind in kinds.items()
        }
        self._alarm = self.create_timer(1.0, self._pass_on, clock=STEADY)
        self._alarm.cancel()
        self._diagnostics = DiagnosticsPublisher(self, hardware_id='link')
        self.create_timer(1.0, self._diagnose, clock=STEADY)

    def _use(self, faults: dict[str, FaultSettings]) -> None:
        """Apply these faults from the next message on."""
        self._faults = faults

    def destroy_node(self) -> None:
        """Publish the final counts and destroy the node."""
        self._diagnose()
        super().destroy_node()

    def _take(self, topic: str, message: Any) -> None:
        counts = self._counts[topic]
        fate = self._faults[topic].fate(counts['received'])
        counts['received'] += 1
        counts.update(fate.kinds)
        if fate.corruption:
            corrupt(message, fate.corruption, fate.place)
        self._links[topic].put(message, fate, self._now())
        self._pass_on()

    def _pass_on(self) -> None:
        """Publish the messages that are due, and set the timer for the next one."""
        for topic, link in self._links.items():
            for message in link.take(self._now()):
                self._out[topic].publish(message)
                self._counts[topic]['passed'] += 1
        due = min(link.due for link in self._links.values())
        if due == inf:
            self._alarm.cancel()
        else:
            self._alarm.timer_period_ns = max(1, round((due - self._now()) * 1e9))
            self._alarm.reset()

    def _now(self) -> float:
        return STEADY.now().nanoseconds / 1e9

    def _diagnose(self) -> None:
        """Publish the counts; active faults are a warning."""
        statuses = []
        for topic, faults in self._faults.items():
            values = {**self._counts[topic], 'on their way': len(self._links[topic])}
            notes = [f'{name} {value:g}' for name, value in faults.active.items()]
            stream = self._in[topic]
            for other in self.get_publishers_info_by_topic(stream.topic_name):
                fault = mismatch(other, stream, other.qos_profile, stream.qos_profile)
                if fault is None:
                    continue
                notes.append(f'a publisher offers another {fault}: its messages are not forwarded')
                self.get_logger().warning(f'{topic}: {notes[-1]}', throttle_duration_sec=10.0)
            level, message = (WARN, ', '.join(notes)) if notes else (OK, 'no faults')
            statuses.append((topic, level, message, values))
        self._diagnostics.publish(*statuses)


def corrupt(message: Any, corruption: str, place: float) -> None:
    """Damage a message."""
    if corruption == 'frame':
        message.header.frame_id = 'corrupted'
    elif isinstance(message, Float64MultiArray):
        message.data = array('d', corrupted(list(message.data), corruption, place))
    else:
        fields = [*_numbers(message)]
        values = [getattr(part, name) for part, name in fields]
        for (part, name), value in zip(fields, corrupted(values, corruption, place), strict=True):
            setattr(part, name, value)


def _numbers(message: Any) -> Iterator[tuple[Any, str]]:
    """Yield the number fields of a message, as pairs of a submessage and a field's name."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if kind == 'double':
            yield message, name
        elif hasattr(value, 'get_fields_and_field_types'):
            yield from _numbers(value)


def _parse(
    prog: str, description: str, argv: Sequence[str], declared: type[Settings]
) -> list[str]:
    """Return the arguments for ROS; the node has none of its own."""
    lines = '\n'.join(
        f'  {name:<12} {field.description}; {field.range()}'
        for name, field in table(declared).items()
    )
    nodes = dict.fromkeys(node for topic in FAULTY for node in topic.subscribers)
    words = '\n'.join(f'  {node} --ros-args {" ".join(remaps(node))}' for node in nodes)
    epilog = f'parameters:\n{lines}\n\nnodes that should read the faulty topics:\n{words}'
    parser = argparse.ArgumentParser(
        prog=prog, description=description, epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    own, ros = split(argv)
    parser.parse_args(own)
    return ros


def main() -> int:
    """Run the node."""
    return run(
        'fault_proxy',
        FaultProxyNode,
        f'Forward messages from TOPIC to {PREFIX}TOPIC with losses, delays and damage. The fate\n'
        'of a message depends on seed, topic and number alone. Nodes that wait for an answer\n'
        'repeat messages by the clock, so damage that they cannot detect (sign, huge) differs\n'
        'between flights.',
        parse=_parse,
    )
