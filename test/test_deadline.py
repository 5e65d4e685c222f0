"""Deadlines exclude stalls of the machine."""

import pytest

from ca_ros.process import deadline as module
from ca_ros.process.deadline import Deadline


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets."""
    class Clock:
        now = 100.0

        @classmethod
        def monotonic(cls):
            return cls.now

    monkeypatch.setattr(module, 'time', Clock)
    return Clock


@pytest.mark.parametrize(
    ('pause', 'polls'), [(0.25, 8), (3600.0, 4)], ids=['without a stall', 'stalled machine'])
def test_it_passes_after_its_limit_of_which_a_stall_takes_half_a_second(clock, pause, polls):
    deadline = Deadline(2.0)
    for _ in range(polls):
        clock.now += pause
        assert not deadline.passed()
    clock.now += pause
    assert deadline.passed()
