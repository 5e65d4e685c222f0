"""Times per call against the number of rotors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ca_ros.allocation import make_allocator
from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.benchmark.accuracy import Accuracy, Judge
from ca_ros.evaluation.benchmark.calls import figures
from ca_ros.evaluation.benchmark.contenders import BASELINE, baseline, method, peer
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.benchmark.timing import Track, measure
from ca_ros.flight.controller import Gains
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.vehicle.files import load
from ca_ros.vehicle.vehicle import Vehicle

PAPER = 6
"""Rotors of the paper's vehicle."""


def ring(n: int) -> dict[str, Any]:
    """Return the parameters of the paper's hexarotor with n rotors on its circle instead of six.

    All n together give the thrust that the six give, so the admissible sets are much alike.
    """
    parameters: dict[str, Any] = dict(load('hexarotor'))
    radius = float(np.linalg.norm(parameters['rotors.positions'][:2]))
    angles = 2.0 * np.pi * np.arange(n) / n
    circle = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])
    parameters['rotors.positions'] = circle.ravel().tolist()
    parameters['rotors.spins'] = ['cw', 'ccw'] * (n // 2)
    for name in ('rotors.thrust_coefficient', 'rotors.torque_coefficient'):
        parameters[name] *= PAPER / n
    # Of another size than here; the exact allocator has no use for it.
    parameters['allocation.conventional.weight'] = 1e-4
    return parameters


def grow(
    plan: Plan, rival: str | None, seed: int, progress: Callable[[], Any]
) -> dict[str, dict[str, dict[str, Any]]]:
    """Return figures by load, contender and number of rotors.

    Parameters
    ----------
    plan : Plan
    rival : str or None
        The peer that is measured beside.
    seed : int
    progress : callable
        Called after each repetition.
    """
    found = {}
    for name in ('uniform', 'flight'):
        tracks: dict[str, Track] = {}
        judges: dict[str, Judge] = {}
        for n in plan.rotors:
            parameters = ring(n)
            vehicle = Vehicle.from_parameters(parameters)
            admissible = AdmissibleSet(vehicle)
            if name == 'uniform':
                chance = np.random.default_rng(seed)
                wrenches = loads.uniform(admissible, chance, plan.wrenches)
            else:
                gains = Gains.from_parameters(parameters)
                wrenches = loads.flight(vehicle, gains, plan.flight)
            problem = admissible.problem
            contenders = {
                BASELINE: baseline(problem),
                'exact': method(partial(make_allocator, 'exact', vehicle)),
            }
            if rival is not None:
                contenders[rival] = peer(rival, problem)
            judge = Judge(problem, wrenches)
            for contender, entry in contenders.items():
                tracks[_key(contender, n)] = entry.track(wrenches)
                judges[_key(contender, n)] = judge
        found[name] = _measure(tracks, judges, plan, seed, progress)
    return found


def _measure(
    tracks: Mapping[str, Track],
    judges: Mapping[str, Judge],
    plan: Plan,
    seed: int,
    progress: Callable[[], Any],
) -> dict[str, dict[str, Any]]:
    worst = {key: Accuracy() for key in tracks}
    times = measure(
        tracks,
        plan.repetitions,
        plan.least,
        plan.budget,
        seed,
        lambda key, answers: judges[key].judge(worst[key], answers),
        progress,
    )
    found: dict[str, dict[str, Any]] = {}
    for key in tracks:
        contender, n = key.split()
        base = times[_key(BASELINE, int(n))]
        found.setdefault(contender, {})[n] = {
            **figures(times[key], base),
            **worst[key].figures(),
        }
    return found


def _key(contender: str, n: int) -> str:
    return f'{contender} {n}'
