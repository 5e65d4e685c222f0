"""The allocator's end, of whatever kind: its last word reaches the motors."""

import re
import signal
import subprocess
import sys
from contextlib import suppress

import pytest
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray

from ca_ros.testing import BEST_EFFORT, RELIABLE, Graph, executable, wrench
from strategies import length

ENDS = length(1, 2, 50)
"""How many allocators each signal ends."""

AT_ONCE = 5
"""So many allocators run side by side."""

OPTIONS = ['--vehicle', 'hexarotor', '--ros-args', '-p', 'command_timeout:=1000.0']
"""No watchdog has a say in what goes out at the end."""

SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
IDLE, STILL = [40.0] * 6, [0.0] * 6

RACE = re.compile(
    r'Traceback.*\n(?:(?:  .*)?\n)*OSError: Signal \d+ ignored due to race condition\n')
"""What CPython prints of a signal that comes while its handler is being replaced."""


class Motors:
    """An allocator in a namespace of its own, and what two kinds of motors hear from it."""

    def __init__(self, graph, *options, namespace='uav', program=('allocator',)):
        self.graph, self.node = graph, f'/{namespace}/allocator'
        self.process = graph.start(
            *program, *OPTIONS, *options, '-r', f'__ns:=/{namespace}')
        self.command = graph.publisher(WrenchStamped, f'/{namespace}/command/wrench')
        self.heard = [
            graph.listen(Float64MultiArray, f'/{namespace}/command/motor_speed', qos)
            for qos in (RELIABLE, BEST_EFFORT)]
        graph.connect(self.node)

    def send(self, thrust):
        """Command a thrust [N]."""
        self.command.publish(wrench(thrust))

    def fly(self):
        """Command until both kinds of motors turn."""
        self.graph.spin_until(
            lambda: all(self.heard), f'{self.node}: answers', repeat=lambda: self.send(9.81))

    def last_words(self):
        """Return what each kind of motors has heard that answers no command."""
        return [
            [message.data.tolist() for message in messages if not answers(message)]
            for messages in self.heard]

    def check_last_word(self, expected):
        """Wait until both kinds of motors have heard it; it is the last that they hear."""
        self.graph.spin_until(lambda: all(self.last_words()), f'{self.node}: a last word')
        for messages, words in zip(self.heard, self.last_words(), strict=True):
            assert {tuple(word) for word in words} == {tuple(expected)}
            assert not answers(messages[-1])


def answers(message):
    """Tell whether a message answers a command."""
    return message.layout.dim[1].label != 'no stamp'


@pytest.mark.slow
@pytest.mark.timeout(1200 + 10 * ENDS)
@pytest.mark.parametrize(('number', 'action', 'word'), [
    (signal.SIGINT, 'idle', IDLE), (signal.SIGTERM, 'stop', STILL), (signal.SIGHUP, 'hold', IDLE)])
def test_the_last_word_is_that_of_the_timeout_action_but_never_hold(
        number, action, word, record_property):
    for first in range(0, ENDS, AT_ONCE):
        with Graph() as graph:
            together = [
                Motors(graph, '-p', f'timeout_action:={action}', namespace=f'uav{i}')
                for i in range(min(AT_ONCE, ENDS - first))]
            for motors in together:
                motors.fly()
            for motors in together:
                motors.process.send_signal(number)
            for motors in together:
                check_clean(motors.process, *graph.outlive(motors.process))
            for motors in together:
                motors.check_last_word(word)
    record_property(f'last words after {number.name}', f'{ENDS} of {ENDS}')


def check_clean(process, out, err):
    """It ended as it should, and said nothing of a bug."""
    assert (process.returncode, out) == (0, ''), err
    assert 'Traceback' not in err, err


def test_the_last_word_is_repeated_for_those_that_cannot_say_that_they_missed_it(graph):
    motors = Motors(graph, '-p', 'mode:=lockstep')
    motors.fly()
    check_clean(motors.process, *graph.end(motors.process, signal.SIGTERM))
    graph.spin_until(lambda: len(motors.last_words()[0]) > 1, 'the last word once more')


def test_an_allocator_that_never_had_a_sound_command_says_nothing(graph):
    motors = Motors(graph)
    after = Motors(graph, namespace='after')
    motors.send(float('nan'))
    graph.connect(motors.node)
    check_clean(motors.process, *graph.end(motors.process, signal.SIGINT))
    after.fly()
    assert motors.heard == [[], []]


def test_a_terminal_that_closes_is_no_reason_to_end_where_nohup_says_so(graph):
    motors = Motors(graph, program=('/usr/bin/nohup', *executable('allocator')))
    motors.fly()
    motors.process.send_signal(signal.SIGHUP)
    for heard in motors.heard:
        heard.clear()
    motors.fly()
    motors.process.send_signal(signal.SIGTERM)
    graph.outlive(motors.process)
    assert motors.process.returncode == 0
    motors.check_last_word(IDLE)


def test_many_signals_are_as_good_as_one(graph):
    motors = Motors(graph)
    motors.fly()
    # Also while the interpreter ends.
    ended = False
    while not ended:
        for number in SIGNALS:
            motors.process.send_signal(number)
        with suppress(subprocess.TimeoutExpired):
            ended = motors.process.wait(0.002) is not None
    out, err = graph.outlive(motors.process)
    check_clean(motors.process, out, RACE.sub('', err))
    motors.check_last_word(IDLE)


# Bugs

BROKEN = """
import sys
from ca_ros.nodes import allocator

class Broken(allocator.AllocatorNode):
    def {method}(self, *arguments):
        if getattr(self, '_answer', None) is not None and {condition}:
            raise RuntimeError('this is the bug')
        return super().{method}(*arguments)

sys.exit(allocator.run('broken', Broken, ''))
"""

BUGS = {
    'a command': ('_serve', 'arguments[0].wrench[2] == 30.0'),
    'a timer': ('_levels', 'True'),
    'a parameter': ('_use', 'True'),
}


@pytest.mark.parametrize('bug', length(['a timer', 'a parameter'], BUGS))
def test_a_bug_ends_the_node_with_its_name_and_the_rotors_idle(graph, bug):
    method, condition = BUGS[bug]
    code = BROKEN.format(method=method, condition=condition)
    motors = Motors(graph, '-r', '__node:=allocator', program=(sys.executable, '-c', code))
    client = graph.node.create_client(SetParameters, f'{motors.node}/set_parameters')
    graph.spin_until(client.service_is_ready, 'a service')
    motors.send(9.81)
    if bug != 'a timer':
        graph.spin_until(lambda: all(motors.heard), 'an answer')
    motors.send(30.0)
    if bug == 'a parameter':
        client.call_async(SetParameters.Request(parameters=[
            Parameter('rotors.health', value=0.9).to_parameter_msg()]))
    out, err = graph.outlive(motors.process)
    assert (motors.process.returncode, out) == (1, '')
    assert err.splitlines()[-1] == 'RuntimeError: this is the bug'
    assert f'in {method}' in err
    motors.check_last_word(IDLE)
