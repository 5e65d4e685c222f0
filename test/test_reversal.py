"""No axis is reversed, exceeded or moved without demand where a lesser quantity can pay."""

from itertools import product

import numpy as np
import pytest

from benchmarks.wrenches import WAYPOINTS
from ca_ros import AdmissibleSet, Vehicle, control_allocation_matrix, make_allocator
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.controller import Controller
from ca_ros.flight.rigid_body import NULL_STATE, RigidBody, rotation_matrix
from ca_ros.nodes.settings import load
from ca_ros.vehicle.files import config_directory
from strategies import PX4_ROWS, UNIT, UNIT_QUADROTOR, extreme, length

WRENCHES = length(200, 1000)
JUDGED = length(10, 25)
"""How many of the reversed ones are judged by a linear program."""

SHIPPED = sorted(file.stem for file in config_directory().glob('*.yaml'))

ROUNDING = 1e-9

def off_sense(served, demand, reference):
    """Return how far values are outside of the range between reference and demand."""
    low, high = np.minimum(reference, demand), np.maximum(reference, demand)
    return np.maximum(np.maximum(low - served, served - high), 0.0)


def least_off_sense(vehicle, served, demand, reversal):
    """Return how far yaw has to be off its sense, by a linear program over the thrusts.

    Roll and pitch are what they are, and thrust is anywhere, or where `reversal` is 'avoid'
    between its demand and hover, or where it is.
    """
    gamma, axes = control_allocation_matrix(vehicle), vehicle.axes
    thrust, yaw = axes.index('thrust'), axes.index('yaw')
    kept = [axes.index(axis) for axis in ('roll', 'pitch')]
    ends = [demand[thrust], vehicle.weight, served[thrust]]
    if reversal == 'prevent':
        ends = [-np.inf, np.inf]
    # The columns behind the thrusts: thrust, yaw, excess and lack of yaw.
    rest = np.zeros((4, 4))
    rest[2, 0] = rest[3, 1] = -1.0
    rest[3, 2:] = -1.0, 1.0
    matrix = np.hstack([gamma[[*kept, thrust, yaw]], rest])
    answer = extreme(
        np.append(np.zeros(vehicle.n + 2), [1.0, 1.0]),
        matrix, np.append(served[kept], [0.0, 0.0]),
        np.concatenate([vehicle.thrust_min, [min(ends), min(0.0, demand[yaw]), 0.0, 0.0]]),
        np.concatenate([vehicle.thrust_max, [max(ends), max(0.0, demand[yaw]), np.inf, np.inf]]))
    return None if answer is None else answer[-2:].sum()


def judge(vehicle, demands, size, reversal):
    """Check what is served of unattainable demands; return how many of them have yaw off."""
    admissible = AdmissibleSet(vehicle)
    demands = demands[~admissible.contains(demands, tolerance=ROUNDING)]
    axes, half = vehicle.axes, admissible.problem.extent
    hover = admissible.problem.hover
    served, pure = (admissible.prioritize(demands, thrust_deviation=choice)
                    for choice in (reversal, 'allow'))
    assert admissible.contains(served, tolerance=1e-12 * (1.0 + half.max())).all()
    kept = [axes.index(axis) for axis in ('roll', 'pitch')]
    np.testing.assert_allclose(served[:, kept], pure[:, kept], rtol=0.0, atol=ROUNDING)
    yaw = axes.index('yaw')
    off = off_sense(served[:, yaw], demands[:, yaw], hover[yaw])
    assert (off <= off_sense(pure[:, yaw], demands[:, yaw], hover[yaw]) + ROUNDING).all()
    reversed_ = np.flatnonzero(off > ROUNDING)
    for i in reversed_[:size]:
        least = least_off_sense(vehicle, served[i], demands[i], reversal)
        # The judge's solver may be at a loss where roll and pitch are extreme to rounding.
        assert least is None or off[i] <= least + 1e-6 * half[yaw], (demands[i], served[i])
    return len(reversed_)


@pytest.mark.slow
@pytest.mark.parametrize('reversal', ['prevent', 'avoid'])
def test_a_grid_of_commands_on_a_quadrotor(reversal):
    steps = np.linspace(-4.0, 4.0, 9)
    grid = np.array(list(product(np.linspace(0.0, 4.0, 8), steps, steps, steps)))
    assert len(grid) == 5832
    off = judge(UNIT_QUADROTOR, grid, JUDGED, reversal)
    # Where thrust pays as much as it takes, nothing at all is off.
    assert off == 0 or reversal == 'avoid'


@pytest.mark.parametrize('reversal', ['prevent', 'avoid'])
@pytest.mark.parametrize('name', length(['hexarotor', 'rov'], SHIPPED))
def test_random_commands_on_every_shipped_vehicle(name, reversal):
    vehicle, rng = Vehicle.load(name), np.random.default_rng(0)
    problem = AdmissibleSet(vehicle).problem
    reach = 3.0 * problem.extent
    judge(vehicle, rng.uniform(
        problem.center - reach, problem.center + reach, (WRENCHES, len(reach))), JUDGED, reversal)


class Asking(Controller):
    """The controller, with a record of the wrenches that it wants before it gives way."""

    def demand(self, *state):
        """Record and return the wrench that the controller wants."""
        self.asked = [*getattr(self, 'asked', []), super().demand(*state)]
        return self.asked[-1]


@pytest.mark.parametrize('name', ['octorotor'])
def test_the_saturated_commands_of_the_flight_of_the_benchmark(name):
    vehicle = Vehicle.load(name)
    controller = Asking(vehicle, load(name).controller)
    allocator, state = make_allocator('exact', vehicle), NULL_STATE
    for waypoint in WAYPOINTS:
        flight = fly(controller, allocator, RigidBody(vehicle), waypoint, 2.5, state=state)
        velocity = rotation_matrix(flight.attitude[-1]) @ flight.velocity[-1]
        state = np.concatenate([
            flight.position[-1], velocity, flight.attitude[-1], flight.angular_velocity[-1]])
    demands = np.array(controller.asked)
    assert (~AdmissibleSet(vehicle).contains(demands, tolerance=ROUNDING)).sum() > 20
    judge(vehicle, demands, JUDGED, 'prevent')


def test_yaw_is_not_reversed_worked_out_by_hand():
    # Roll and pitch of 1 leave f4 - f2 = 1, so f4 = 1 and f2 = 0, and the same f1 = f3 = g: thrust
    # is 1 + 2 g and yaw is 2 g - 1.  With the most thrust, g = 1, yaw would be +1 where -1 was
    # asked for.  Thrust may pay down to hover, 2: then yaw is 0.
    demand = [3.6, 1.0, 1.0, -1.0]
    expected = {
        'allow': [3.0, 1.0, 1.0, 1.0],
        'avoid': [2.0, 1.0, 1.0, 0.0],
        'prevent': [2.0, 1.0, 1.0, 0.0]}
    for reversal, wrench in expected.items():
        allocation = make_allocator(
            'exact', UNIT_QUADROTOR, thrust_deviation=reversal).allocate(demand)
        np.testing.assert_allclose(allocation.wrench, wrench, atol=1e-12)
    # With 3 of thrust asked for at a weight of 2.4, g may go down to 0.7 only, unless prevented.
    heavier = AdmissibleSet(Vehicle.from_parameters(UNIT | {'vehicle.mass': 2.4 / 9.81}))
    expected = {'avoid': [2.4, 1.0, 1.0, 0.4], 'prevent': [2.0, 1.0, 1.0, 0.0]}
    for reversal, wrench in expected.items():
        served = heavier.prioritize(demand, thrust_deviation=reversal)
        np.testing.assert_allclose(served, wrench, atol=1e-12)


# PX4

def test_the_rows_of_px4():
    admissible = AdmissibleSet(UNIT_QUADROTOR)
    demands = np.column_stack([4.0 * PX4_ROWS[:, 3], PX4_ROWS[:, :3]])
    saturated = ~admissible.contains(demands, tolerance=ROUNDING)
    demands = demands[saturated]
    assert len(demands) == 39
    off, sacrificed = {}, {}
    for reversal in ('allow', 'avoid', 'prevent'):
        served = admissible.prioritize(demands, thrust_deviation=reversal)
        np.testing.assert_allclose(served[:, 1:3], demands[:, 1:3], atol=ROUNDING)
        off[reversal] = np.count_nonzero(off_sense(served[:, 3], demands[:, 3], 0.0) > ROUNDING)
        sacrificed[reversal] = np.abs(demands - served)[:, 0].sum() / 4.0
    assert off == {'allow': 16, 'avoid': 0, 'prevent': 0}
    # PX4's airmode of roll and pitch gives up 7.04.
    assert sacrificed['prevent'] < 6.4
    # With yaw before thrust it is PX4's full airmode.
    served = admissible.prioritize(demands, ['roll pitch', 'yaw', 'thrust'])
    full = PX4_ROWS[saturated, 12:] @ control_allocation_matrix(UNIT_QUADROTOR).T
    np.testing.assert_allclose(served, full, rtol=0.0, atol=1e-6)
