"""The controller: signs, equilibrium, and an admissible wrench whatever the state."""


import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ca_ros import AdmissibleSet
from ca_ros.control.controller import Controller
from ca_ros.control.waypoint import Waypoint
from ca_ros.problem.prioritization import AXIS_REVERSALS, PrioritiesSettings
from ca_ros.simulation.record import Flight
from ca_ros.vehicle.state import heading, tilt
from strategies import FLEET, HEXAROTOR, settings_of

SETTINGS = settings_of({})
CONTROLLER = Controller.from_settings(HEXAROTOR, SETTINGS)
HOVER = [9.81, 0.0, 0.0, 0.0]
REST = np.zeros(3)
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
THRUST, ROLL, PITCH, YAW = range(4)


def attitude(*euler):
    """Return the quaternion of Euler angles 123."""
    return Rotation.from_euler('XYZ', euler).as_quat()


def wrench(waypoint, position=REST, attitude=LEVEL, velocity=REST, angular_velocity=REST):
    goal = Waypoint.of(*waypoint)
    return CONTROLLER.wrench(position, attitude, velocity, angular_velocity, goal)


@pytest.mark.parametrize('heading', [0.0, 0.7, -2.0, np.pi])
def test_hover_at_the_waypoint_is_an_equilibrium(heading):
    position = np.array([3.0, -2.0, 5.0])
    u = wrench((*position, heading), position, attitude(0.0, 0.0, heading))
    np.testing.assert_allclose(u, HOVER, atol=1e-12)


def test_a_waypoint_above_takes_thrust_and_nothing_else():
    # m kp = 1.5 N for each metre, as long as the approach is slower than the limit.
    np.testing.assert_allclose(wrench((0.0, 0.0, 1.0, 0.0)), [9.81 + 1.5, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(wrench((0.0, 0.0, -1.0, 0.0)), [9.81 - 1.5, 0.0, 0.0, 0.0])


def test_velocity_is_damped():
    # m kd = 2.4 N for each metre a second.
    np.testing.assert_allclose(
        wrench((0.0, 0.0, 0.0, 0.0), velocity=np.array([0.0, 0.0, 1.0])),
        [9.81 - 2.4, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(('waypoint', 'axis', 'sign'), [
    # Forward-left-up: the nose goes down to fly ahead, the left side to fly to the left.
    ((1.0, 0.0, 0.0, 0.0), PITCH, 1.0),
    ((-1.0, 0.0, 0.0, 0.0), PITCH, -1.0),
    ((0.0, 1.0, 0.0, 0.0), ROLL, -1.0),
    ((0.0, -1.0, 0.0, 0.0), ROLL, 1.0),
    ((0.0, 0.0, 0.0, 0.5), YAW, 1.0),
    ((0.0, 0.0, 0.0, -0.5), YAW, -1.0),
])
def test_signs_of_the_torque_towards_a_waypoint(waypoint, axis, sign):
    u = wrench(waypoint)
    assert sign * u[axis] > 1e-3
    others = [i for i in (ROLL, PITCH, YAW) if i != axis]
    np.testing.assert_allclose(u[others], 0.0, atol=1e-12)


def test_signs_follow_the_heading():
    # Facing left (north), a waypoint to the east is on the right hand.
    u = wrench((1.0, 0.0, 0.0, np.pi / 2), attitude=attitude(0.0, 0.0, np.pi / 2))
    assert u[ROLL] > 1e-3
    assert u[PITCH] == pytest.approx(0.0, abs=1e-12)


def test_the_shorter_way_round_is_taken():
    # From 170 degrees to -170 it is 20 degrees to the left.
    heading = np.radians(170.0)
    assert wrench((0.0, 0.0, 0.0, -heading), attitude=attitude(0.0, 0.0, heading))[YAW] > 1e-3


@pytest.mark.parametrize(('euler', 'axis'), [((0.1, 0.0, 0.0), ROLL), ((0.0, 0.1, 0.0), PITCH)])
def test_a_tilt_is_taken_back(euler, axis):
    # J kp = 0.015 * 60 = 0.9 N m for each radian.
    assert wrench((0.0, 0.0, 0.0, 0.0), attitude=attitude(*euler))[axis] == pytest.approx(-0.09)


@pytest.mark.parametrize(('axis', 'damping'), [(0, 0.015 * 14.0), (1, 0.015 * 14.0), (2, 0.12)])
def test_a_turn_is_damped(axis, damping):
    omega = np.zeros(3)
    omega[axis] = 0.5
    u = wrench((0.0, 0.0, 0.0, 0.0), angular_velocity=omega)
    assert u[1 + axis] == pytest.approx(-0.5 * damping)


def test_the_acceleration_is_the_wanted_one():
    # Inverse dynamics: away from the limits the torque makes the turn about x and y decay as
    # -kd omega in a frame that does not spin with the body, the gyroscopic torque included.
    gains, inertia = SETTINGS.controller, HEXAROTOR.inertia
    omega = np.array([0.3, -0.2, 0.4])
    torque = wrench((0.0, 0.0, 0.0, 0.0), angular_velocity=omega)[1:]
    turn = np.linalg.solve(inertia, torque - np.cross(omega, inertia @ omega))
    turn += np.cross([0.0, 0.0, omega[2]], [omega[0], omega[1], 0.0])
    np.testing.assert_allclose(turn, -np.array(gains.attitude_damping) * omega, atol=1e-12)


# Tilt and heading are two things

@pytest.mark.parametrize('euler', [(0.0, 0.0, 0.0), (0.3, -0.2, 1.0)])
@pytest.mark.parametrize('heading', [0.4, 1.5, 3.1, -2.9])
def test_the_heading_does_not_change_what_is_asked_of_roll_and_pitch(euler, heading):
    body = attitude(*euler)
    u = [wrench((0.5, -0.3, 0.1, goal), attitude=body) for goal in (0.0, heading)]
    np.testing.assert_allclose(u[0][[ROLL, PITCH]], u[1][[ROLL, PITCH]], atol=1e-12)


def test_a_great_heading_error_asks_for_no_more_than_half_a_radian():
    half = wrench((0.0, 0.0, 0.0, 0.5))[YAW]
    assert half == pytest.approx(0.03 * 4.0 * 0.5)
    assert wrench((0.0, 0.0, 0.0, 3.0))[YAW] == pytest.approx(half)
    assert wrench((0.0, 0.0, 0.0, -3.0))[YAW] == pytest.approx(-half)


@pytest.mark.parametrize('euler', [(np.pi, 0.0, 0.0), (0.0, np.pi, 0.0), (3.0, 0.2, 0.7)])
def test_upside_down_it_turns_over(euler):
    u = wrench((0.0, 0.0, 0.0, 0.0), attitude=attitude(*euler))
    assert np.hypot(u[ROLL], u[PITCH]) > 0.5


@given(st.floats(-3.1, 3.1), st.floats(-3.0, 3.0), st.floats(0.0, 3.0))
def test_a_tilt_by_the_shortest_way_changes_no_heading(turn, direction, angle):
    axis = [np.cos(direction), np.sin(direction), 0.0]
    body = Rotation.from_rotvec(np.multiply(angle, axis)) * Rotation.from_euler('Z', turn)
    assert heading(body.as_quat()) == pytest.approx(turn, abs=1e-9)
    assert heading(-body.as_quat()) == pytest.approx(turn, abs=1e-9)
    assert tilt(body.as_quat()) == pytest.approx(angle, abs=1e-7)
    # What the controller holds for the heading is what a flight reports.
    states = np.tile(body.as_quat(), (3, 1))
    rest = np.zeros((3, 3))
    flight = Flight(np.arange(3.0), rest, states, rest, rest, np.zeros((3, 6)))
    np.testing.assert_allclose(flight.heading, turn, atol=1e-9)
    assert flight.heading_error(Waypoint.of(0.0, 0.0, 0.0, turn)) == pytest.approx(0.0, abs=1e-9)


def test_it_gives_way_by_the_order_of_the_user():
    order = ['yaw', 'roll pitch', 'thrust']
    groups = [('yaw',), ('roll', 'pitch'), ('thrust',)]
    mine = Controller.from_settings(
        HEXAROTOR, settings_of({'allocation.exact.order': order}))
    state = REST, attitude(0.6, 0.5, 0.0), REST, np.array([0.0, 0.0, -6.0])
    goal = Waypoint.of(2.0, -1.0, 3.0, 1.0)
    first, default = mine.wrench(*state, goal), CONTROLLER.wrench(*state, goal)
    assert first[YAW] > default[YAW] + 0.01
    demand = mine.demand(*state, goal)
    admissible = AdmissibleSet(HEXAROTOR)
    assert admissible.margin(demand) < 0.0
    np.testing.assert_allclose(first, admissible.prioritize(demand, groups), atol=1e-12)
    np.testing.assert_allclose(default, admissible.prioritize(demand), atol=1e-12)


def test_it_gives_way_by_the_reversal_of_the_user():
    state = REST, attitude(-0.3, -0.3, 0.0), REST, np.array([-4.0, 2.0, -4.0])
    goal = Waypoint.of(0.0, -3.0, -3.0, -1.0)
    served = {}
    for reversal in AXIS_REVERSALS:
        mine = Controller.from_settings(
            HEXAROTOR, settings_of({'allocation.exact.axis_reversal': reversal}))
        demand = mine.demand(*state, goal)
        served[reversal] = mine.wrench(*state, goal)
        np.testing.assert_allclose(
            served[reversal],
            AdmissibleSet(HEXAROTOR).prioritize(demand, axis_reversal=reversal),
            rtol=0.0, atol=1e-12)
        assert np.array_equal(mine.unallocated, demand - served[reversal])
    # Thrust, which is nearer to its demand if yaw may be reversed, pays otherwise.
    assert demand[YAW] > 0.1
    assert served['allow'][YAW] < -0.05
    assert served['prevent'][YAW] > -1e-12
    assert demand[THRUST] < served['allow'][THRUST] < served['prevent'][THRUST] - 1.0
    with pytest.raises(ValueError, match='axis_reversal'):
        PrioritiesSettings(axis_reversal='never')


def test_a_far_waypoint_does_not_turn_the_vehicle_over():
    # Tilted by the greatest tilt towards the waypoint, it wants no more.
    tilted = attitude(0.0, SETTINGS.controller.tilt_max, 0.0)
    u = wrench((1e6, 0.0, 0.0, 0.0), attitude=tilted)
    assert u[PITCH] <= 1e-12
    assert wrench((0.0, 0.0, -1e6, 0.0))[THRUST] > 0.0


anything = st.floats(-1e6, 1e6)
triple = st.tuples(anything, anything, anything).map(np.array)
quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).map(np.array).filter(
    lambda q: np.linalg.norm(q) > 1e-3).map(lambda q: q / np.linalg.norm(q))


@pytest.mark.parametrize('vehicle', ['hexarotor', 'asymmetric', 'tilted_hexarotor'])
@given(triple, quaternions, triple, triple, triple, anything)
def test_the_wrench_is_admissible_in_any_state(
        vehicle, position, quaternion, velocity, angular_velocity, goal, heading):
    controller = Controller(FLEET[vehicle], SETTINGS.controller)
    u = controller.wrench(
        position, quaternion, velocity, angular_velocity, Waypoint.of(*goal, heading))
    assert np.all(np.isfinite(u))
    assert AdmissibleSet(FLEET[vehicle]).contains(u, tolerance=1e-12 * (1.0 + np.linalg.norm(u)))
