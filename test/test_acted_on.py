"""Which of the failures that a detector has named are acted on."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linprog

from ca_ros import Vehicle, acted_on
from ca_ros.control.waypoint import Waypoint
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.detection.kernel_detector import make_detector
from ca_ros.firmware.faults import arms_of
from ca_ros.simulation.closed_loop import Detection, fly
from ca_ros.studies.cases import Case

VEHICLES = (
    'quadrotor', 'hexarotor', 'hexarotor_ppnnpn', 'hexarotor_realistic', 'hexarotor_tilted',
    'octorotor', 'x8', 'y6')


def named(vehicle, *names, arms=()):
    """Return a detector that has named failures one after the other: each is health by rotor."""
    health, order = vehicle.health.copy(), [0] * vehicle.n
    for each, name in enumerate(names, 1):
        for rotor, left in name.items():
            health[rotor - 1], order[rotor - 1] = left, each
    return SimpleNamespace(vehicle=vehicle, health=health, failed_arms=arms, order=order)


def hovers_level(vehicle, health):
    """Return whether thrust, roll and pitch of hover can be moved either way, by HiGHS."""
    curve = vehicle.speed_max**2 * vehicle.thrust_coefficient * health
    low = vehicle.speed_min**2 * vehicle.thrust_coefficient * health
    rows, hover = vehicle.wrenches[2:5], np.array([vehicle.weight, 0.0, 0.0])
    for way in (*np.eye(3), *-np.eye(3)):
        found = linprog(
            np.r_[np.zeros(vehicle.n), -1.0], A_eq=np.c_[rows, -way], b_eq=hover,
            bounds=[*zip(low, curve, strict=True), (0.0, None)])
        if found.status or found.x[-1] < 1e-6:
            return False
    return True


@pytest.mark.parametrize('name', VEHICLES)
def test_a_loss_is_acted_on_where_the_vehicle_still_hovers_level(name):
    vehicle, withheld = Vehicle.load(name), 0
    losses = [{rotor: left} for rotor in range(1, vehicle.n + 1) for left in (0.0, 0.3, 0.6)]
    losses += [dict.fromkeys(pair, 0.0) for pair in combinations(range(1, vehicle.n + 1), 2)]
    for loss in losses:
        detector = named(vehicle, loss)
        health, arms, rest = acted_on(detector)
        if hovers_level(vehicle, detector.health):
            assert (rest, arms) == ((), ())
            np.testing.assert_array_equal(health, detector.health)
        else:
            withheld += 1
            assert rest == tuple(loss)
            np.testing.assert_array_equal(health, vehicle.health)
    # The quadrotor: each lost rotor, and each pair.  Without a pair side by side the hexarotors
    # fall, and with the six pairs of one corner x8 and y6.
    assert withheld == {
        'quadrotor': 10, 'octorotor': 0, 'x8': 4, 'y6': 3}.get(name, 6)


def test_a_later_loss_with_which_nothing_holds_takes_nothing_back():
    vehicle = Vehicle.load('hexarotor')
    for first, second in (1, 2), (2, 1):
        health, _, withheld = acted_on(named(vehicle, {first: 0.0}, {second: 0.0}))
        assert withheld == (second,)
        assert np.flatnonzero(health < 1.0).tolist() == [first - 1]
    # A third one may do.
    health, _, withheld = acted_on(named(vehicle, {1: 0.0}, {2: 0.0}, {5: 0.0}))
    assert (withheld, health.tolist()) == ((2,), [0.0, 1.0, 1.0, 1.0, 0.0, 1.0])


@pytest.mark.parametrize('make', [FailureDetector, make_detector])
def test_names_count_in_their_order_after_a_clock_that_steps_back(make):
    detector, still = make(Vehicle.load('hexarotor'), motor_time_constant=0.05), np.zeros(3)
    for start, slow in (100, [1]), (10, [0, 1]):
        for time in range(start * 10**9, (start + 1) * 10**9, 10_000_000):
            detector.observe(time, [0.0, 0.0, 0.0, 1.0], still, still)
            detector.command(time, np.full(6, 200.0))
            turning = np.full(6, 200.0)
            turning[slow] = 0.0
            detector.measure(time, turning)
        assert np.flatnonzero(detector.health == 0.0).tolist() == slow
    assert acted_on(detector).withheld == (1,)
    detector.reset()
    assert detector.order == [0] * 6


@pytest.mark.parametrize('name', ['x8', 'y6'])
def test_an_arm_is_acted_on_as_one_effector_and_a_whole_arm_that_is_lost_is_not(name):
    vehicle = Vehicle.load(name)
    arms = arms_of(vehicle)
    for pair in arms:
        half = dict.fromkeys(pair, 0.5)
        detector = named(vehicle, half, arms=(pair,))
        health, found, withheld = acted_on(detector)
        assert (found, withheld) == ((pair,), ())
        np.testing.assert_array_equal(health, detector.health)
        one, other = pair
        unlike = named(vehicle, {one: 0.5, other: 0.6}, arms=(pair,))
        assert acted_on(unlike)[1:] == ((pair,), ())
        assert acted_on(named(vehicle, {one: 0.0}, {other: 0.0})).withheld == (other,)
    both = named(vehicle, dict.fromkeys((*arms[0], *arms[1]), 0.5), arms=tuple(arms[:2]))
    assert acted_on(both).arms == tuple(arms[:2])


def test_what_is_announced_counts_and_what_was_lost_before_is_no_reason():
    one, two = (Vehicle.load(name).with_health for name in ('quadrotor', 'hexarotor'))
    assert acted_on(named(one([0.0, 1.0, 1.0, 1.0]), {1: 0.0})).withheld == ()
    assert acted_on(named(one([0.0, 1.0, 1.0, 1.0]), {2: 0.0})).withheld == ()
    found = acted_on(named(two([0.0, 1.0, 1.0, 1.0, 1.0, 1.0]), {2: 0.0}))
    assert (found.withheld, found.health.tolist()) == ((2,), [0.0, 1.0, 1.0, 1.0, 1.0, 1.0])


class Alarm:
    """A detector that names a sound rotor, the first, after a second."""

    def __init__(self, vehicle):
        self.vehicle, self.failed_arms = vehicle, ()
        self.health, self.order = vehicle.health, [0] * vehicle.n

    def observe(self, time, *_):
        if time != 10**9:
            return False
        self.health, self.order = self.vehicle.fail(1).health, [1, *self.order[1:]]
        return True

    def command(self, time, command):
        pass


@pytest.mark.parametrize(('name', 'withheld'), [('quadrotor', (1,)), ('hexarotor', ())])
def test_a_false_alarm_costs_no_flight(name, withheld):
    """Without roll and pitch the quadrotor would fall; the hexarotor flies without the rotor."""
    case = Case.load(name)
    detection = Detection(Alarm(case.vehicle), case.detection('exact')._reconfigure)
    flight = fly(
        case.controller(), case.allocator('exact'), case.plant(), Waypoint.of(0, 0, 1, 0), 8.0,
        detection=detection)
    assert (flight.speeds[-1, 0] > 0.0) == bool(withheld)
    assert np.linalg.norm(flight.position[-1] - [0.0, 0.0, 1.0]) < 0.05
    [(_, health, acted)] = detection.found
    assert health[0] == 0.0
    assert acted.withheld == withheld
