"""Allocator and simulator for a long time at 500 Hz; only `soak.py` runs it.

CA_ROS_SOAK says for how many seconds (default 600).
"""

import math
import os
import time
from collections import Counter

import numpy as np
import psutil
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from ca_ros.testing import counts, wrench
from nodes import busy_processors, some_wrenches

SECONDS = float(os.environ.get('CA_ROS_SOAK', '600'))
RATE = 500
"""Of the commands [Hz]."""

PAUSES = 10
"""How often in each half no command is sent until the rotors have been told."""

WARM_UP = 0.2
"""Share of the time before memory is looked at."""

GROWTH_MAX = 0.01
"""Of the resident memory from then on."""

REMEMBERED = 4096
"""So many commands back it is known when they were sent."""


class Load:
    """Sends commands, some of them bad, and checks what comes back."""

    def __init__(self, graph):
        self.graph, self.sent, self.told, self.unsound = graph, 0, 0, 0
        self.nodes = {
            name: psutil.Process(graph.start(name, '--vehicle', 'hexarotor').pid)
            for name in ('allocator', 'simulator')}
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        # Lists of all messages would not stay small.
        graph.node.create_subscription(
            Float64MultiArray, 'command/motor_speed', self._check, 10)
        graph.node.create_subscription(DiagnosticArray, '/diagnostics', self._note, 10)
        self.times, self.trips, self.said, self.memory = [0.0] * REMEMBERED, [], {}, {}
        for name in self.nodes:
            graph.connect(name)
        # As in a flight most can be attained.
        inside, outside = np.split(some_wrenches(250), 2)
        self.wrenches = np.where(np.arange(250)[:, None] % 10 == 0, outside, inside)
        self.timer = graph.node.create_timer(1.0 / RATE, self._send)
        self.timer.cancel()

    def _send(self):
        numbers = self.wrenches[self.sent % len(self.wrenches)].copy()
        if self.sent % 97 == 50:
            numbers[5] = math.nan
        frame = 'map' if self.sent % 101 == 50 else 'base_link'
        self.sent += 1
        message = wrench(numbers, self.sent * 10**9, frame)
        self.times[self.sent % REMEMBERED] = time.perf_counter()
        self.command.publish(message)

    def _check(self, message):
        speeds, label = message.data, message.layout.dim[1].label
        self.unsound += len(speeds) != 6 or not all(40.0 <= speed <= 400.0 for speed in speeds)
        if label == 'no stamp':
            self.told += 1
        else:
            number = int(label.removeprefix('stamp ')) // 10**9
            self.trips.append(time.perf_counter() - self.times[number % REMEMBERED])

    def _note(self, array):
        name = array.status[0].name.split(':')[0].lstrip('/')
        values = {pair.key: pair.value for pair in array.status[0].values}
        self.said[name] = self.said.get(name, (0,))[0] + 1, values

    def values(self, name):
        """Return the next values that a node says."""
        before = self.said.get(name, (0,))[0]
        self.graph.spin_until(
            lambda: self.said.get(name, (0,))[0] > before + 1, f'{name}: a diagnosis')
        return self.said[name][1]

    def run(self, seconds):
        """Send for so long; return the figures of the time."""
        sent, before, waits = self.sent, counts(self.values('allocator')), []
        self.trips.clear()
        busy = 0.0
        for _ in range(PAUSES):
            began = time.monotonic()
            self.timer.reset()
            self.graph.spin_until(
                lambda began=began: time.monotonic() >= began + seconds / PAUSES, 'time')
            self.timer.cancel()
            ended, told = time.monotonic(), self.told
            busy += ended - began
            self.graph.spin_until(lambda told=told: self.told > told, 'the timeout action')
            waits.append(time.monotonic() - ended)
            for name, process in self.nodes.items():
                self.memory.setdefault(name, []).append(process.memory_info().rss)
        values = self.values('allocator')
        account = counts(values)
        account.subtract(before)
        latencies = ('latency p50 [us]', 'latency p99 [us]', 'latency max [us]')
        return {
            'rate [Hz]': round((self.sent - sent) / busy),
            'sent': self.sent - sent,
            'account': dict(account),
            'overtaken on their way': self.sent - sent - account['received'],
            **{name: int(values[name]) for name in latencies},
            'round trip p99 [us]': round(1e6 * np.percentile(self.trips, 99)),
            'pauses': PAUSES,
            'rotors told after [ms]': round(1e3 * max(waits)),
            'out of bounds': self.unsound,
        }


def check_account(account):
    """What was received is served or dropped, with the reason."""
    account = Counter(account)
    dropped = sum(n for key, n in account.items() if key.startswith('dropped: '))
    assert account['received'] == account['served'] + account['rejected'] + dropped, account
    return dropped


@pytest.mark.timeout(SECONDS + 1200)
def test_endurance(graph, record_property):
    load = Load(graph)
    figures = {'alone': load.run(SECONDS / 2)}
    with busy_processors():
        figures['with busy processors'] = load.run(SECONDS / 2)
    for name in load.nodes:
        values = load.memory[name][round(2 * PAUSES * WARM_UP):]
        figures[f'{name}: resident memory [MB]'] = round(values[-1] / 1e6, 1)
        figures[f'{name}: its growth [%]'] = round(100 * (values[-1] / values[0] - 1), 2)
        check_account(counts(load.values(name)))
    for name, value in figures.items():
        record_property(name, value)
    for half in ('alone', 'with busy processors'):
        account = figures[half]['account']
        assert check_account(account) > 0
        assert account['timeouts'] >= PAUSES
        assert figures[half]['out of bounds'] == 0
    for name in load.nodes:
        assert figures[f'{name}: its growth [%]'] <= 100 * GROWTH_MAX
