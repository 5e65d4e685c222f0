"""Metrics that the paper leaves out: worked out by hand, and by an independent solver."""

import numpy as np
import pytest
from scipy.optimize import minimize

from ca_ros import AdmissibleSet, AllocationProblem, Vehicle, make_allocator
from ca_ros.studies.wrench_metrics import (
    cells,
    energy,
    exceeded_axes,
    least_energy,
    lost,
    metrics,
    reversed_axes,
)
from ca_ros.studies.wrench_sets import samples

AXES = ('thrust', 'roll', 'pitch', 'yaw')

UNIT = AllocationProblem(
    np.eye(4), -10.0, 10.0, axes=AXES, reference=[5.0, 0.0, 0.0, 0.0])
"""Each effector is an axis; half the range of each is 10."""


@pytest.mark.parametrize(('demand', 'served', 'reversal', 'excess'), [
    ([7, 1, -1, 2], [7, 1, -1, 2], [], []),
    # Thrust is not judged; 0.05 is less than 1 % of half the range.
    ([7, 1, -1, 2], [3, 1.05, 0, -0.05], [], []),
    ([7, 1, -1, 2], [7, -0.2, -1, -2], [1, 3], []),
    ([7, 1, -1, 2], [7, 1.2, -1.2, 0], [], [1, 2]),
    # Without a demand nothing can be reversed, but anything is too much.
    ([7, 0, 0, 0], [7, 0.2, -0.2, 0.05], [], [1, 2]),
])
def test_axes_by_hand(demand, served, reversal, excess):
    demands, answers = np.array([demand], float), np.array([served], float)
    assert np.flatnonzero(reversed_axes(UNIT, demands, answers)).tolist() == reversal
    assert np.flatnonzero(exceeded_axes(UNIT, demands, answers)).tolist() == excess


def test_losses_by_hand():
    demands = np.array([[7.0, 3.0, 4.0, 1.0], [4.0, 0.0, 5.0, 0.0]])
    served = np.array([[6.0, 3.0, 1.0, 1.0], [4.0, 4.0, 5.0, 0.0]])
    # Roll and pitch: 3 + 4 of 5 + 5.  Thrust, relative to 5: 1 + 0 of 2 + 1.
    assert lost(UNIT, demands, served) == pytest.approx(
        {'roll and pitch': 0.7, 'thrust': 1.0 / 3.0, 'yaw': 0.0})
    assert lost(UNIT, np.array([[5.0, 0.0, 0.0, 0.0]]), served[:1])['yaw'] == 0.0


def test_shares_count_wrenches_and_not_axes():
    demands = np.array([[5.0, 1, 1, 1], [5.0, 1, 1, 1], [5.0, 1, 1, 1], [5.0, 1, 1, 1]])
    thrusts = np.array([[5.0, -1, -1, 1], [5.0, 1, 1, 2], [5.0, 1, 1, 1], [5.0, 1, 1, 1]])
    found = metrics(UNIT, demands, thrusts)
    assert (found['reversed'], found['exceeded']) == (0.25, 0.25)
    assert cells(found)['axis reversed [%]'] == '25'
    assert 'energy' not in found


def test_the_least_energy_of_two_rotors_by_hand():
    """Of f_1 + f_2 = 2 the mean is best; a bound moves it."""
    for upper, best in (([3.0, 3.0], 2.0), ([0.25, 3.0], 0.25**1.5 + 1.75**1.5)):
        problem = AllocationProblem([[1.0, 1.0]], 0.0, upper)
        assert least_energy(problem, np.array([[2.0]])) == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize('sampling', ['volume', 'boundary'])
@pytest.mark.parametrize('name', ['hexarotor', 'octorotor', 'rov'])
def test_the_least_energy_is_that_of_another_solver(name, sampling):
    admissible = AdmissibleSet(Vehicle.load(name))
    problem = admissible.problem
    wrenches = samples(admissible, sampling, 0, 0, 15)
    found = least_energy(problem, wrenches)
    exact = make_allocator('exact', problem)
    for u, least in zip(wrenches, found, strict=True):
        start = exact.allocate(u).thrusts
        best = minimize(
            lambda f: energy(f[None])[0], start,
            jac=lambda f: 1.5 * np.sign(f) * np.sqrt(np.abs(f)), method='SLSQP',
            bounds=list(zip(problem.lower, problem.upper, strict=True)),
            constraints={'type': 'eq', 'fun': lambda f, u=u: problem.gamma @ f - u,
                         'jac': lambda f: problem.gamma},
            options={'ftol': 1e-13, 'maxiter': 500})
        assert least == pytest.approx(min(best.fun, energy(start[None])[0]), rel=1e-4)
        assert least <= energy(start[None])[0] * (1.0 + 1e-4)
