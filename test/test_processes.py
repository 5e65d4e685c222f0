"""Child processes: started again when they end, given up when they cannot start."""

import os
import signal
import subprocess
import sys
import time

import psutil

from ca_ros.process.processes import Deadline, Processes, end, start
from ca_ros.testing import DEADLINE

SLEEP = [sys.executable, '-c', 'import time; time.sleep(1000.0)']
FAIL = [sys.executable, '-c', 'raise SystemExit(3)']
CHILD = [sys.executable, '-c',
         f'import subprocess, time; subprocess.Popen({SLEEP}); time.sleep(1000.0)']


def until(condition):
    """Wait until a condition holds, and return what it is."""
    deadline = Deadline(DEADLINE)
    while not (value := condition()):
        assert not deadline.passed()
        time.sleep(0.01)
    return value


def test_what_is_killed_is_started_again_however_often():
    with Processes({'sleeper': SLEEP, 'other': SLEEP}) as processes:
        other = processes.running['other']
        for i in range(1, 6):
            victim = processes.running['sleeper']
            victim.kill()
            assert until(processes.respawn) == {'sleeper': -signal.SIGKILL}
            assert processes.running['sleeper'].pid != victim.pid
            assert processes.respawned == {'sleeper': i}
            assert processes.ended() == {}
        assert processes.running['other'] is other
    assert not any(psutil.pid_exists(p.pid) for p in processes.running.values())


def test_a_process_that_fails_again_and_again_at_its_start_is_given_up(monkeypatch):
    monkeypatch.setattr(Processes, 'STARTING', 1e6)
    with Processes({'failing': FAIL}) as processes:
        for _ in range(Processes.ATTEMPTS - 1):
            assert until(processes.respawn) == {'failing': 3}
        until(processes.ended)
        assert processes.respawn() == {}
        assert processes.ended() == {'failing': 3}


def test_what_fails_later_is_not(monkeypatch):
    monkeypatch.setattr(Processes, 'STARTING', 0.0)
    with Processes({'failing': FAIL}) as processes:
        for _ in range(2 * Processes.ATTEMPTS):
            assert until(processes.respawn) == {'failing': 3}


def test_nothing_is_left_of_what_a_killed_process_had_started():
    with Processes({'parent': CHILD}) as processes:
        parent = processes.running['parent']
        [child] = until(psutil.Process(parent.pid).children)
        parent.kill()
        until(processes.respawn)
        until(lambda: gone(child))


def gone(process):
    """Tell whether a process has ended, whoever has taken note of that."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


DEAF = [sys.executable, '-uc', """
import signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print('deaf')
time.sleep(1000.0)
"""]


def test_what_does_not_end_in_time_is_killed_and_named(capsys):
    deaf, sleeper = start(DEAF, stdout=subprocess.PIPE), start(SLEEP)
    assert deaf.stdout.readline() == b'deaf\n'
    deaf.stdout.close()
    assert end([deaf, sleeper], signal.SIGTERM, 0.3) == [deaf]
    assert (deaf.returncode, sleeper.returncode) == (-signal.SIGKILL, -signal.SIGTERM)
    [line] = [line for line in capsys.readouterr().err.splitlines() if line.startswith('killed')]
    assert line.startswith(f'killed, as it did not end within 0.3 s: {sys.executable} -uc')
    assert end([deaf, sleeper], signal.SIGTERM, 0.3) == []


# Notes its own SIGTERM in a file, as a node sends its last command.
LAST_COMMAND = """
import pathlib, signal, sys
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
file = pathlib.Path(sys.argv[1])
file.with_suffix('.pid').touch()
signal.sigwait({signal.SIGTERM})
file.touch()
"""

# Starts two of them, one of them twice, and says when all is done.
PARENT = """
import os, sys, time
from pathlib import Path
from ca_ros.process.processes import Processes
folder = Path(sys.argv[1])
os.environ['TIED'] = str(folder)
names = ('first', 'respawned')
with Processes({name: [sys.executable, '-c', sys.argv[2], str(folder / name)]
                for name in names}) as processes:
    processes.running['respawned'].kill()
    while 'respawned' not in processes.respawn():
        time.sleep(0.01)
    for name in names:
        while not (folder / name).with_suffix('.pid').exists():
            time.sleep(0.01)
    print('ready', flush=True)
    time.sleep(1000.0)
"""


def tied(folder):
    """Return the processes that a parent with this folder has started."""
    found = []
    for process in psutil.process_iter():
        try:
            if process.environ().get('TIED') == str(folder) and not gone(process):
                found.append(process)
        except psutil.Error:
            pass
    return found


def test_children_are_terminated_when_their_parent_is_killed(tmp_path):
    with subprocess.Popen([sys.executable, '-c', PARENT, str(tmp_path), LAST_COMMAND],
                          stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout.readline() == 'ready\n'
        parent.kill()
    try:
        until(lambda: not tied(tmp_path))
        # SIGTERM has reached them, so that nodes can send their last command.
        assert (tmp_path / 'first').exists()
        assert (tmp_path / 'respawned').exists()
    finally:
        for child in tied(tmp_path):
            child.kill()


def test_a_child_whose_parent_ended_before_it_was_tied_ends_at_once(monkeypatch):
    monkeypatch.setattr(os, 'getpid', lambda: -1)
    # As in bringup, which notes its signals.
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        assert start(SLEEP).wait(DEADLINE) == -signal.SIGTERM
    finally:
        signal.signal(signal.SIGTERM, before)
