"""An inertial unit: the mean force between two states, and the motion from it alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ca_ros.detection.inertial import AHEAD, HELD, InertialMotion, SpecificForces, Standby
from ca_ros.vehicle.state import GAP, rotation_matrix

MS = 1_000_000  # [ns]


def force(x):
    return np.array([x, 0.0, 9.81])


def test_the_mean_weighs_each_sample_by_the_time_since_the_one_before():
    forces = SpecificForces()
    for time, x in ((2, 1.0), (6, 3.0), (14, 5.0)):
        forces.add(time * MS, force(x))
    # 1 for 2 ms, 3 for 4 ms, 5 for 4 ms.
    np.testing.assert_allclose(forces.mean(0, 10 * MS), force(3.4))
    # The newest sample holds on: 5 for 10 ms; then 5 for 2 ms and 7 for 8.
    np.testing.assert_array_equal(forces.mean(10 * MS, 20 * MS), force(5.0))
    forces.add(22 * MS, force(5.0))
    forces.add(30 * MS, force(7.0))
    np.testing.assert_allclose(forces.mean(20 * MS, 30 * MS), force(6.6))


def test_one_sample_for_a_step_is_its_mean_to_the_last_bit():
    forces, rng = SpecificForces(), np.random.default_rng(0)
    for step in range(1, 50):
        sample = rng.normal(size=3)
        forces.add(10 * MS * step, sample)
        np.testing.assert_array_equal(forces.mean(10 * MS * (step - 1), 10 * MS * step), sample)


def test_there_is_no_mean_without_a_sample_at_the_end():
    forces = SpecificForces()
    assert forces.mean(0, MS) is None
    forces.add(5 * MS, force(1.0))
    assert forces.mean(0, 5 * MS + HELD + 1) is None
    assert forces.mean(6 * MS, 6 * MS) is None
    # A simulator that is reset begins again at zero.
    forces.add(MS, force(2.0))
    np.testing.assert_array_equal(forces.mean(0, 2 * MS), force(2.0))


def test_a_sample_of_another_time_is_no_part_of_the_mean():
    forces = SpecificForces()
    assert forces.mean(0, 10 * MS) is None
    assert 'none' in forces.fault
    for ahead, words in ((300 * MS, 'ahead'), (-HELD - MS, 'behind')):
        for step in range(1, 100):
            forces.add(10 * MS * step + ahead, force(1.0))
            assert forces.mean(10 * MS * (step - 1), 10 * MS * step) is None
            assert words in forces.fault
            assert len(forces._samples) == 1
        forces = SpecificForces()
    # A state that is a little old has its own; after a gap of the samples there is none.
    for step in range(1, 6):
        forces.add(20 * MS * step, force(step))
    forces.add(20 * MS + AHEAD, force(6.0))
    np.testing.assert_array_equal(forces.mean(10 * MS, 20 * MS), force(1.0))
    forces = SpecificForces()
    forces.add(20 * MS + AHEAD, force(6.0))
    assert forces.mean(10 * MS, 20 * MS) is None
    assert not forces.fault


@pytest.mark.parametrize(('clock', 'ages', 'ahead'), [
    (0, (0,), 0), (20, (0,), 20), (45, (0,), 45), (0, (20, 25, 28), 20), (0, (40, 45, 48), 40),
    (25, (20,), 45), (-20, (0, 5), 0), (0, (120,), 120)])
def test_how_far_samples_are_ahead_is_the_least_of_late(clock, ages, ahead):
    """Whether their clock is ahead, or the states come late [ms]."""
    forces, last = SpecificForces(), 0
    for step in range(1, 400):
        for k in range(5):
            forces.add((10 * step + 2 * k - 8 + clock) * MS, force(1.0))
        end = (10 * step - ages[step % len(ages)]) * MS
        forces.mean(last, end)
        last = end
        assert forces.ahead <= ahead * MS + 2 * MS
    assert forces.ahead >= ahead * MS
    assert forces.fault == (
        'it is ahead of the states by more than 100 ms: its clock is, or they come late'
        if ahead > 100 else '')


def test_that_samples_have_stopped_holds_until_they_come_again_but_not_a_wrong_clock():
    def flown(ahead, stopped):
        """Fly for 0.2 s at 100 Hz; then the states stop, and the samples go on."""
        forces = SpecificForces()
        for step in range(1, 60):
            if step not in stopped:
                forces.add(10 * MS * step + ahead, force(1.0))
            if step <= 20:
                forces.mean(10 * MS * (step - 1), 10 * MS * step)
            yield forces.fault

    assert set(flown(0, ())) == {''}
    for stopped in range(10, 40), range(40):
        faults = [*flown(0, stopped)]
        assert all(faults[20:stopped.stop - 1])
        assert not any(faults[stopped.stop - 1:])
    for ahead, words in ((200 * MS, 'ahead'), (-200 * MS, 'is behind'), (-55 * MS, 'is behind')):
        for stopped in (), range(10, 12):
            assert all(words in each for each in [*flown(ahead, stopped)][20:])


@given(st.lists(st.integers(1, 20), min_size=5, max_size=40), st.integers(1, 15))
def test_means_of_states_at_any_rate_add_up(gaps, period):
    """Each sample counts once, however many of them come between two states."""
    times = np.cumsum(gaps)
    values = np.sin(times)
    forces, total, last = SpecificForces(), 0.0, 0
    for time, x in zip(times.tolist(), values, strict=True):
        forces.add(time * MS, force(x))
        while last + period <= time:
            total += period * forces.mean(last * MS, (last + period) * MS)[0]
            last += period
    at = np.searchsorted(times, np.arange(last) + 0.5)
    np.testing.assert_allclose(total, values[at].sum(), atol=1e-9)


def test_a_vehicle_that_tilts_at_rest_is_levelled_and_stays_at_rest():
    motion, tilt = InertialMotion(9.81), 0.2
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    felt = turn.T @ [0.0, 0.0, 9.81]
    for _ in range(12_000):
        motion.turn(0.005, np.zeros(3), felt)
        motion.move(0.005, felt)
    np.testing.assert_allclose(rotation_matrix(motion.attitude)[2], turn[2], atol=1e-3)
    assert abs(motion.velocity).max() < 0.05


def test_the_motion_follows_the_gyro_and_the_force():
    """A turn by 90 degrees about z in a second, and a push forward of 1 m/s^2 for as long."""
    motion = InertialMotion(9.81)
    for _ in range(1000):
        motion.turn(0.001, np.array([0.0, 0.0, np.pi / 2]), force(0.0))
    np.testing.assert_allclose(rotation_matrix(motion.attitude)[:2, 0], [0.0, 1.0], atol=1e-3)
    for _ in range(1000):
        body = motion.move(0.001, force(1.0))
    # It forgets half of it in a second: 2 (1 - exp(-0.5)).
    np.testing.assert_allclose(body, [0.787, 0.0, 0.0], atol=2e-3)
    np.testing.assert_allclose(motion.velocity, [0.0, 0.787, 0.0], atol=2e-3)


def test_an_imu_serves_alone_until_the_first_state_and_half_a_second_after_the_last():
    standby, left = Standby(9.81), np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    standby.sense(0, np.zeros(3), force(0.0))
    assert standby.alone
    # It flies to the left, which is where its nose points.
    standby.hear(left, np.array([2.0, 0.0, 0.0]))
    for k in range(1, 101):
        attitude, velocity = standby.sense(10 * k * MS, np.zeros(3), force(0.0))
        assert standby.alone == (10 * k * MS >= GAP)
    np.testing.assert_allclose(attitude, left, atol=1e-9)
    # Of the velocity exp(-0.5) is left after a second.
    np.testing.assert_allclose(velocity, [1.213, 0.0, 0.0], atol=5e-3)
    standby.hear(left, np.zeros(3))
    assert not standby.alone
    _, velocity = standby.sense(1010 * MS, np.zeros(3), force(0.0))
    assert not standby.alone
    np.testing.assert_array_equal(velocity, np.zeros(3))


def test_after_a_gap_of_the_imu_nothing_is_carried_on_and_the_time_does_not_count():
    standby = Standby(9.81)
    standby.hear(np.array([0.0, 0.0, 1.0, 0.0]), np.ones(3))
    for time in (0, GAP, 0, 0):
        attitude, velocity = standby.sense(time, np.zeros(3), force(0.0))
        assert not standby.alone
        if time:
            np.testing.assert_array_equal(attitude, [0.0, 0.0, 0.0, 1.0])
            np.testing.assert_array_equal(velocity, np.zeros(3))
