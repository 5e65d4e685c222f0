"""A console that nobody reads does not hold up a node, and one that is closed does not end it."""

import os
import pty
import signal
import tty
from contextlib import suppress

import pytest
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from ca_ros.testing import executable, wrench
from strategies import length


def pipe():
    """Return both ends of a pipe."""
    return os.pipe()


def terminal():
    """Return both ends of a terminal."""
    screen, console = pty.openpty()
    tty.setraw(console)
    return screen, console


def commands(graph):
    """Return the answers of an allocator, and a function that sends a wrong and a good command."""
    command = graph.publisher(WrenchStamped, 'command/wrench')
    speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
    graph.connect('/allocator')

    def send():
        command.publish(wrench(float('nan')))
        command.publish(wrench(9.81))

    return speeds, send


@pytest.mark.parametrize('make', length([terminal], [pipe, terminal]))
def test_an_allocator_answers_whether_or_not_its_log_is_read(graph, make):
    reader, console = make()
    os.set_blocking(console, False)
    with suppress(BlockingIOError):
        while True:
            os.write(console, b'a line that nobody reads\n')
    os.set_blocking(console, True)
    graph.start('allocator', '--vehicle', 'hexarotor', stdout=console, stderr=console)
    # Each kind of complaint is one more line that has nowhere to go.
    speeds, send = commands(graph)
    graph.spin_until(lambda: len(speeds) > 10, 'answers', repeat=send)
    # What others write to the same console waits for its reader as before.
    assert os.get_blocking(console)
    os.close(reader)
    os.close(console)


@pytest.mark.parametrize('closed', length(['<&- >&- 2>&-'], ['2>&-', '<&- >&- 2>&-']))
def test_an_allocator_answers_where_standard_streams_are_closed(graph, closed):
    code = f'exec "$0" "$@" --vehicle hexarotor {closed}'
    process = graph.start('/bin/sh', '-c', code, *executable('allocator'))
    speeds, send = commands(graph)
    graph.spin_until(lambda: len(speeds) > 3, 'answers', repeat=send)
    # No socket has the number of a stream that others write to.
    assert os.readlink(f'/proc/{process.pid}/fd/2') == os.devnull
    graph.end(process, signal.SIGTERM)
    assert process.returncode == 0
