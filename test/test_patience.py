"""Time limits that stand still with the machine."""

import pytest

from ca_ros.bringup import deadline as patience
from ca_ros.bringup.deadline import Patience


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


@pytest.mark.parametrize(
    ('pause', 'looks'), [(0.25, 8), (3600.0, 4)], ids=['as it runs', 'a machine that stood still'])
def test_it_is_over_after_its_limit_in_which_a_long_pause_is_half_a_second(clock, pause, looks):
    limit = Patience(2.0)
    for _ in range(looks):
        clock.now += pause
        assert not limit.over()
    clock.now += pause
    assert limit.over()
