"""Time limits that stand still with the machine."""

import pytest

from ca_ros import patience
from ca_ros.patience import Patience


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets."""
    class Clock:
        now = 100.0

        @classmethod
        def monotonic(cls):
            return cls.now

    monkeypatch.setattr(patience, 'time', Clock)
    return Clock


def test_it_is_over_after_its_limit(clock):
    limit = Patience(2.0)
    for _ in range(8):
        clock.now += 0.25
        assert not limit.over()
    clock.now += 0.25
    assert limit.over()


def test_a_machine_that_stood_still_has_kept_nobody_waiting(clock):
    limit = Patience(2.0)
    for _ in range(4):
        clock.now += 3600.0
        assert not limit.over()
    clock.now += 3600.0
    assert limit.over()
