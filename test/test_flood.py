"""A flood of messages does not make a node deaf."""

import signal
import time

import pytest
from rcl_interfaces.srv import GetParameters

from ca_ros.testing import Diagnostics, counts
from nodes import start_flood
from strategies import length

SECONDS = length(0.3, 2.0, 12.0)
"""How long each flood lasts."""

ANSWERED = 10.0
"""Within this time a service must answer [s]: Fast DDS sends what the kernel has lost again after
a second; an executor that serves one message after the other needs minutes."""

ASKED = 0.1
"""Period of the requests [s]: in a flood the kernel may lose one before DDS reads it."""


class Asker:
    """Asks a node for a parameter, and notes the longest time until an answer."""

    def __init__(self, graph, node):
        self._graph = graph
        self._client = graph.node.create_client(GetParameters, f'{node}/get_parameters')
        graph.spin_until(self._client.service_is_ready, 'the service')
        self.answers, self.longest = 0, 0.0

    def ask(self):
        """Send requests until one of them is answered."""
        begun, futures = time.monotonic(), []

        def answered():
            if time.monotonic() >= begun + ASKED * len(futures):
                futures.append(self._client.call_async(GetParameters.Request(names=['mode'])))
            return any(future.done() for future in futures)

        self._graph.spin_until(answered, 'an answer', deadline=ANSWERED)
        self.answers += 1
        self.longest = max(self.longest, time.monotonic() - begun)


@pytest.mark.slow
@pytest.mark.timeout(1200 + 10 * SECONDS)
@pytest.mark.parametrize('name', length(['simulator'], ['allocator', 'simulator']))
def test_a_node_answers_during_and_after_a_flood(graph, name, record_property):
    graph.start(name, '--vehicle', 'hexarotor')
    diagnostics = Diagnostics(graph)
    parameters = graph.connect(f'/{name}')
    during, after = (Asker(graph, f'/{name}') for _ in range(2))
    during.ask()
    senders = [start_flood(graph, name, 9.81) for _ in range(2)]
    diagnostics.wait(
        f'/{name}', lambda level, message, values: counts(values)['received'] > 1000, 'a flood')
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        during.ask()
    # The shared memory of a killed process may hold up this one for a second.
    for sender in senders:
        graph.end(sender, signal.SIGTERM)
    after.ask()
    begun = time.monotonic()
    changed = {'simulator': 'simulator.failures', 'allocator': 'rotors.health'}[name]
    value = ['1@1e5'] if name == 'simulator' else 0.9
    assert parameters.set_atomically({changed: value}).successful
    took = time.monotonic() - begun
    assert parameters.get(changed) == [value]
    for what, value in (
            ('answers during the flood', during.answers),
            ('longest time until one, during it [ms]', round(1e3 * during.longest)),
            ('the same after it [ms]', round(1e3 * after.longest)),
            ('a change of health after it [ms]', round(1e3 * took))):
        record_property(f'{name}: {what}', value)
