"""Print accuracy and time per call of OSQP, and of `exact` with and without a start at OSQP."""

import sys
import time

import numpy as np
import osqp

from ca_ros import AdmissibleSet, Vehicle, make_allocator
from ca_ros.allocation.osqp_program import osqp_program

VEHICLE = Vehicle.load(sys.argv[1] if len(sys.argv) > 1 else 'hexarotor')
ADMISSIBLE = AdmissibleSet(VEHICLE)
GAMMA = ADMISSIBLE.problem.gamma
LOW, HIGH = VEHICLE.thrust_min, VEHICLE.thrust_max


def plain_osqp(**settings):
    """Return OSQP on Eqs. (20)-(22), set up once: a function from a wrench to thrusts, or None."""
    _, solve = osqp_program(ADMISSIBLE.problem, **settings)

    def answer(u):
        found = solve(u)
        return found.x if found.info.status_val == osqp.SolverStatus.OSQP_SOLVED else None

    return answer


def exact(**options):
    """Return the exact allocator as a function from a wrench to thrusts."""
    allocator = make_allocator('exact', VEHICLE, **options)
    return lambda u: allocator.allocate(u).thrusts


METHODS = {
    'OSQP, defaults': plain_osqp(),
    'OSQP, eps 1e-8': plain_osqp(eps_abs=1e-8, eps_rel=1e-8),
    "exact, solver='osqp'": exact(solver='osqp'),
    "exact, solver='newton'": exact(),
}

rng = np.random.default_rng(0)
inside = ADMISSIBLE.sample(rng, 1000)
boundary = np.array([ADMISSIBLE.scale(10.0 * u - 9.0 * ADMISSIBLE.center) for u in inside])

print('| method | wrenches | without an answer | worst error of the wrench '
      '| worst excess over a bound [N] | median [us] | p99 [us] |')
print('|---|---|---|---|---|---|---|')
for load, wrenches in (('inside', inside), ('on the boundary', boundary)):
    for name, solve in METHODS.items():
        error, excess, unanswered = 0.0, 0.0, 0
        times = []
        for u in wrenches:
            start = time.perf_counter()
            thrusts = solve(u)
            times.append(1e6 * (time.perf_counter() - start))
            if thrusts is None:
                unanswered += 1
                continue
            error = max(error, float(np.linalg.norm(GAMMA @ thrusts - u)))
            excess = max(excess, float((thrusts - HIGH).max()), float((LOW - thrusts).max()))
        print(f'| {name} | {load} | {unanswered} | {error:.1e} | {max(excess, 0.0):.1e} | '
              f'{np.median(times):.0f} | {np.quantile(times, 0.99):.0f} |')
