"""What the rotors served of the controller's demands in a flight, and what limited the rest."""

from dataclasses import dataclass

import numpy as np

from ca_ros.allocation.exact import Exact
from ca_ros.allocation.rates import PERIOD_MAX, WithinRates
from ca_ros.allocation.reconfiguration import Reconfiguration
from ca_ros.arrays import Array
from ca_ros.bringup.flight import Flown
from ca_ros.control.controller import Controller
from ca_ros.control.trajectory import Trajectory
from ca_ros.parameter_files import ControllerNodeSettings
from ca_ros.problem.audit import Audit
from ca_ros.problem.limits import shares
from ca_ros.settings import ParameterError, read, table
from ca_ros.vehicle.settings import AXES

SERVED = 1e-3
"""Residual, as a share of the range of an axis, that counts as none: samples may be lost."""


@dataclass(frozen=True, eq=False)
class Served:
    """The shares of the demands that were served, and a text for each axis that was cut.

    `shares` (K, m) has nan while an axis is given up.
    """

    axes: tuple[str, ...]
    shares: Array
    cuts: tuple[str, ...]


def served(flown: Flown, trajectory: Trajectory) -> Served | None:
    """Compute the demands of a flight anew from its samples, and compare them with its speeds.

    What limits an axis is that of `exact` at the sample where the share is smallest.  Return None
    if rotors tilt, or the nodes do not declare the parameters of our controller.
    """
    flight, vehicle = flown.flight, flown.vehicle
    given = {name: flown.parameters[name] for name in table(ControllerNodeSettings)
             if name in flown.parameters}
    try:
        settings = read(ControllerNodeSettings, given)
    except ParameterError:
        return None
    if len(vehicle.servos):
        return None
    found = np.full((len(flight.time), len(AXES)), np.nan)
    worst: dict[int, tuple[float, int, Controller, Array]] = {}
    known = Reconfiguration[Controller](settings, _controller)
    for i, time in enumerate(np.round(flight.time * 1e9).astype(int).tolist()):
        believed = _believed(flown, time)
        known.report('flight', believed)
        controller = known.in_force.made
        problem = controller.problem
        pose, motion = (flight.position[i], flight.attitude[i]), flight.velocity[i]
        demand = controller.wrench(
            *pose, motion, flight.angular_velocity[i], trajectory.at(time), time
        ) + controller.unallocated
        produced = problem.gamma @ problem.vehicle.thrusts(flight.speeds[i])
        for axis, share in zip(
            problem.axes, shares(problem, demand, produced, SERVED).tolist(), strict=True
        ):
            k = AXES.index(axis)
            found[i, k] = share
            if share < worst.get(k, (1.0,))[0]:
                worst[k] = share, i, controller, demand
    step = float(np.median(np.diff(flight.time))) if len(flight.time) > 1 else 0.0
    cuts = tuple(
        f'{AXES[k]} for {step * np.count_nonzero(found[:, k] < 1.0):.2f} s, at '
        f'{flight.time[i]:.2f} s to {100.0 * share:.0f} %, limited by '
        f'{_limit(flown, settings, i, by, demand, AXES[k])}'
        for k, (share, i, by, demand) in sorted(worst.items())
    )
    rows = [AXES.index(axis) for axis in vehicle.axes]
    return Served(vehicle.axes, found[:, rows], cuts)


def _controller(
    settings: ControllerNodeSettings, report: Audit, before: Controller | None
) -> Controller:
    return Controller.from_settings(report.vehicle, settings, before)


def _believed(flown: Flown, time: int) -> Array:
    """Return the health (n,) that the nodes know of at a time of flight [ns]."""
    health = flown.failures.known(flown.vehicle, time).health.copy()
    actual = flown.failures.after(flown.vehicle, time).health
    for rotor, found in flown.detected.items():
        if round(found * 1e9) <= time:
            health[rotor - 1] = actual[rotor - 1] if actual[rotor - 1] < 1.0 else 0.0
    return health


def _limit(
    flown: Flown, settings: ControllerNodeSettings, i: int, by: Controller, demand: Array,
    axis: str,
) -> str:
    """Return what limits an axis of a demand at a sample, in words."""
    exact = settings.allocation.exact
    allocator = Exact(by.problem, **{name: getattr(exact, name) for name in table(type(exact))})
    time, speeds = flown.flight.time, flown.flight.speeds
    last = speeds[i - 1] if i else by.vehicle.idle_speeds
    elapsed = time[i] - time[i - 1] if i else PERIOD_MAX
    answer = WithinRates(allocator).allocate(demand, last, round(1e9 * elapsed), 0)
    exact_flew = flown.parameters.get('allocation.method') == 'exact'
    other = 'a command that came late' if exact_flew else 'the method'
    if exact_flew and time[i] >= min(flown.detected.values(), default=np.inf):
        other = "the monitor's estimate of the health"
    return answer.explanation.limits.get(axis, other)
