"""Metrics that the paper leaves out: what becomes of each axis, and the energy of the thrusts."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.problem.problem import AllocationProblem

NOTED = 0.01  # share of half an axis's range from which reversal or excess counts
STEPS, STEP = 1000, 0.3  # of `least_energy`, and the weight of a step's energy


def axis_groups(axes: tuple[str, ...]) -> dict[str, list[int]]:
    """Return the rows of each group of axes whose losses are added: roll with pitch, one each."""
    pair = [axes.index(axis) for axis in ('roll', 'pitch') if axis in axes]
    groups = {'roll and pitch': pair} if len(pair) == 2 else {}
    return groups | {axis: [row] for row, axis in enumerate(axes) if not (groups and row in pair)}


def reversed_axes(problem: AllocationProblem, demands: Array, served: Array) -> BoolArray:
    """Return which axes (N, m) are served against their demand, thrust excepted.

    Demands (N, m) and served wrenches (N, m) are relative to the reference, hover for a vehicle.
    An axis without a demand that is served at all counts in `exceeded_axes`.
    """
    wanted, given = demands - problem.reference, served - problem.reference
    return (given * np.sign(wanted) < -NOTED * problem.extent) & _signed(problem)


def exceeded_axes(problem: AllocationProblem, demands: Array, served: Array) -> BoolArray:
    """Return which axes (N, m) are served beyond their demand, thrust excepted."""
    wanted, given = demands - problem.reference, served - problem.reference
    same = np.where(wanted == 0.0, np.abs(given), given * np.sign(wanted))
    return (same > np.abs(wanted) + NOTED * problem.extent) & _signed(problem)


def lost(problem: AllocationProblem, demands: Array, served: Array) -> dict[str, float]:
    """Return the share of the demand that is missed for each of `axis_groups`.

    The sum of the lengths of demand minus served over the sum of the lengths of the demands, which
    are relative to the reference.  It is above 1 where more is missed than was demanded.
    """
    found = {}
    for name, rows in axis_groups(problem.axes).items():
        wanted = np.linalg.norm((demands - problem.reference)[:, rows], axis=1).sum()
        missed = np.linalg.norm((demands - served)[:, rows], axis=1).sum()
        found[name] = float(missed / wanted) if wanted else 0.0
    return found


def energy(thrusts: Array) -> Array:
    """Return the sum (N,) of |f|^1.5 over thrusts (N, n) [N^1.5].

    The ideal power of a rotor in hover is proportional to it (momentum theory: G. J. Leishman,
    Principles of Helicopter Aerodynamics, 2nd ed., 2006, Chapter 2).
    """
    return (np.abs(thrusts) ** 1.5).sum(axis=1)


def least_energy(problem: AllocationProblem, served: Array) -> Array:
    """Return the least `energy` (N,) of thrusts that give attainable wrenches (N, m) [N^1.5].

    The alternating direction method of multipliers: projections onto the thrusts that give the
    wrench, and minima of the energy of each thrust within its bounds, in turn (S. Boyd et al.,
    Foundations and Trends in Machine Learning 3 (2011), Section 5).
    """
    scale = float(np.abs([problem.lower, problem.upper]).max())
    low, high = problem.lower / scale, problem.upper / scale
    inverse = np.linalg.pinv(problem.gamma)
    particular = served @ inverse.T / scale
    onto = np.eye(problem.n) - inverse @ problem.gamma
    thrusts = np.clip(particular, low, high)
    sums = np.zeros_like(thrusts)
    for _ in range(STEPS):
        exact = particular + (thrusts - sums) @ onto.T
        at = exact + sums
        # The minimum of STEP |f|^1.5 + (f - at)^2 / 2: a quadratic equation in sqrt(|f|).
        root = (np.sqrt(2.25 * STEP**2 + 4.0 * np.abs(at)) - 1.5 * STEP) / 2.0
        thrusts = np.clip(np.sign(at) * root**2, low, high)
        sums += exact - thrusts
    return energy(scale * thrusts)


def metrics(problem: AllocationProblem, demands: Array, thrusts: Array) -> dict[str, Any]:
    """Return the metrics of thrusts (N, n) that answer demands (N, m), by name.

    ``reversed`` and ``exceeded`` are the shares of the wrenches with such an axis.
    """
    served = demands - problem.residual(demands, thrusts)
    return {
        'reversed': float(reversed_axes(problem, demands, served).any(axis=1).mean()),
        'exceeded': float(exceeded_axes(problem, demands, served).any(axis=1).mean()),
        'lost': lost(problem, demands, served),
    }


def energies(problem: AllocationProblem, demands: Array, thrusts: Array) -> dict[str, float]:
    """Return the mean `energy` of thrusts (N, n) [N^1.5], and its excess, by name.

    The excess is relative to the least energy that gives the same wrenches.
    """
    spent, served = energy(thrusts), demands - problem.residual(demands, thrusts)
    excess = spent.sum() / least_energy(problem, served).sum() - 1.0
    return {'energy': float(spent.mean()), 'energy_excess': float(excess)}


def cells(own: Mapping[str, Any]) -> dict[str, str]:
    """Return the metrics of a method as cells of a table, by the titles of the columns [%]."""
    shares = {
        'axis reversed [%]': own['reversed'], 'axis exceeded [%]': own['exceeded'],
        **{f'{name} lost [%]': share for name, share in own['lost'].items()},
    }
    if 'energy_excess' in own:
        shares['energy above least [%]'] = own['energy_excess']
    return {title: f'{abs(round(100.0 * share, 2)):g}' for title, share in shares.items()}


def _signed(problem: AllocationProblem) -> BoolArray:
    return np.array([axis != 'thrust' for axis in problem.axes])
