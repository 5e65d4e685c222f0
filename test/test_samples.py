"""Messages joined to samples by their stamps, and messages that no flight can have."""

import math

import numpy as np
import pytest

from ca_ros.errors import CaRosError
from ca_ros.nodes.messages import speeds_message, stamp, state_messages
from ca_ros.nodes.topics import POSE, SPEEDS, VELOCITY
from ca_ros.process.samples import Samples
from ca_ros.vehicle.state import NULL_STATE

STEP = 10_000_000


def add(samples, time, speeds=(250.0, 260.0), height=0.0, state_time=None):
    """Add a state and the rotor speeds that follow it, with a stamp [ns]."""
    state = NULL_STATE.copy()
    state[2] = height
    position, velocity, attitude, rates = np.split(state, [3, 6, 10])
    pose, twist = state_messages(
        position, attitude, velocity, rates,
        stamp(time if state_time is None else state_time), 'map', 'base_link')
    samples.add(POSE.name, pose)
    samples.add(VELOCITY.name, twist)
    samples.add(SPEEDS.name, speeds_message(np.array(speeds), time))


def test_a_flight_has_the_complete_samples_from_the_first_turn_of_a_rotor():
    samples = Samples()
    for time in (0, STEP):
        add(samples, time, speeds=(0.0, 0.0))
    assert (samples.start, samples.last, samples.any_complete()) == (None, None, True)
    add(samples, 2 * STEP, height=1.0)
    # A state without speeds is none.
    add(samples, 4 * STEP, state_time=3 * STEP)
    add(samples, 5 * STEP, height=2.0)
    flight = samples.flight(5 * STEP, origin=2 * STEP)
    np.testing.assert_array_equal(flight.time, [0.0, 0.03])
    np.testing.assert_array_equal(flight.position[:, 2], [1.0, 2.0])
    np.testing.assert_array_equal(flight.speeds, [[250.0, 260.0]] * 2)
    assert (samples.start, samples.last) == (2 * STEP, 5 * STEP)
    assert samples.answered(2 * STEP)
    assert not samples.answered(3 * STEP)


def test_a_flight_can_begin_without_a_turn():
    samples = Samples()
    add(samples, 0, speeds=(0.0, 0.0))
    samples.begin(0)
    add(samples, STEP, speeds=(0.0, 0.0))
    assert samples.last == STEP
    assert len(samples.flight(STEP).time) == 2


@pytest.mark.parametrize('speeds', [(250.0,), (250.0,) * 3, ()])
def test_another_number_of_rotor_speeds_is_refused_before_and_after_it_is_known(speeds):
    fault = f'motor_speed has {len(speeds)} rotor speeds: expected 2'
    for known_first in (True, False):
        samples = Samples()
        if known_first:
            samples.expect(2)
            with pytest.raises(CaRosError, match=fault):
                add(samples, 0, speeds=speeds)
        else:
            add(samples, 0, speeds=speeds)
            with pytest.raises(CaRosError, match=fault):
                samples.expect(2)


@pytest.mark.parametrize('wrong', [math.inf, -math.inf, math.nan])
def test_numbers_that_are_not_finite_are_refused(wrong):
    with pytest.raises(CaRosError, match=r'motor_speed at 0\.01 s: .*expected finite'):
        add(Samples(), STEP, speeds=(250.0, wrong))
    with pytest.raises(CaRosError, match=r'local_position/pose at 0\.01 s: .*expected finite'):
        add(Samples(), STEP, height=wrong)


def test_stamps_that_go_back_are_refused_and_repeated_ones_are_not():
    samples = Samples()
    add(samples, 2 * STEP)
    add(samples, 2 * STEP)
    with pytest.raises(CaRosError, match=r'local_position/pose: stamp 0\.01 s after 0\.02 s'):
        add(samples, STEP)
    assert len(samples.flight(2 * STEP).time) == 1


def test_before_a_flight_old_messages_can_be_forgotten():
    samples = Samples()
    for i in range(5):
        add(samples, i * STEP, speeds=(0.0, 0.0))
    samples.forget(STEP)
    samples.begin(0)
    assert len(samples.flight(4 * STEP).time) == 2
