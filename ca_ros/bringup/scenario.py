"""What happens at given times of a flight: waypoints, rotor failures and their announcements."""

import sys
from collections.abc import Callable, Mapping
from typing import Any

from ca_ros.bringup.agreement import combined
from ca_ros.bringup.recorder import Recorder
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.errors import CaRosError
from ca_ros.process.processes import Deadline
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.vehicle.validation import repeated
from ca_ros.vehicle.vehicle import Vehicle
from ca_ros_cli import NODES

CHANGED = 'rotors.health', 'rotors.stuck_servos'  # what failures change

TIMEOUT = 60.0  # time limit for a node to accept a parameter [s]


class Timeline:
    """Sends the waypoints of a flight, fails rotors, and announces the failures.

    A rotor fails in the simulator; controller and allocator are told.  In lockstep the simulator
    waits at each time (`simulator.hold_at`) until the nodes have answered, so all flights are the
    same.  In real time it does not wait.

    The recorder sends the waypoints and sets the parameters; the parameters are by node
    and name.  Raises a CaRosError if the vehicle does not have the rotors and servos that
    fail, or the simulator lacks a parameter.
    """

    def __init__(
        self, recorder: Recorder, trajectory: Trajectory, failures: RotorFailures,
        parameters: Mapping[str, Mapping[str, Any]], vehicle: Vehicle,
    ) -> None:
        self._recorder, self._trajectory, self._failures = recorder, trajectory, failures
        common = combined(parameters)
        failures.check(vehicle)
        self._lockstep = common['mode'] == 'lockstep'
        self._times = sorted({*failures.times(), *trajectory.times[1:]})
        needed = ['rotors.health'] if failures.times() else []
        if any(each.angle is not None for each in failures.failures):
            needed.append('rotors.stuck_servos')
        if self._lockstep and self._times:
            needed += ['simulator.hold_at', 'simulator.time_step']
        if lacking := [name for name in needed if name not in parameters['simulator']]:
            raise CaRosError(
                f'the simulator does not declare {", ".join(lacking)}, which rotor failures and '
                'trajectories need'
            )
        self._health = {
            name: repeated('rotors.health', parameters[name]['rotors.health'], vehicle.n)
            for name in NODES if 'rotors.health' in parameters[name]
        }
        stuck = 'rotors.stuck_servos'
        self._stuck = {name: parameters[name].get(stuck, 0.0) for name in self._health}
        for name in (name for name in NODES if failures.times() and name not in self._health):
            text = f'the {name} does not declare rotors.health: it is not told of rotor failures'
            print(f'bringup: warning: {text}', file=sys.stderr)
        self._set_to = {name: self._values(name, -1) for name in self._health}
        self._ahead = round(common.get('simulator.time_step', 0.0) * 1e9) if self._lockstep else 0

    def update(self, elapsed: int | None, spin: Callable[[], None]) -> None:
        """Do what is due; raise a CaRosError if a node refuses, or does not answer.

        `elapsed` is the time of flight up to the last complete sample [ns], None before the
        flight; `spin` spins the node once.
        """
        # The simulator waits with the state that follows the last complete sample.
        now = 0 if elapsed is None else elapsed + self._ahead
        due = elapsed is None and bool(self._times)
        while self._times and self._times[0] <= now:
            due = True
            time = self._times.pop(0)
            if time in self._trajectory.times[1:]:
                self._send(self._trajectory.at(time), spin)
            for name in self._health:
                values = self._values(name, time)
                for parameter, value in values.items():
                    if value != self._set_to[name][parameter]:
                        self._set(name, parameter, value, spin)
                self._set_to[name] = values
        if due and self._lockstep:
            hold = self._times[0] / 1e9 if self._times else 0.0
            self._set('simulator', 'simulator.hold_at', hold, spin)

    def _values(self, name: str, time: int) -> dict[str, list[float]]:
        """Return the parameters of a node that failures change, at a time of flight [ns]."""
        given = self._health[name], self._stuck[name], time, name != 'simulator'
        return dict(zip(CHANGED, self._failures.values(*given), strict=True))

    def _send(self, waypoint: Waypoint, spin: Callable[[], None]) -> None:
        self._recorder.send(waypoint)
        if self._lockstep:
            fault = 'the controller does not receive the waypoint'
            _wait(lambda: self._recorder.delivered() or None, fault, spin)

    def _set(
        self, name: str, parameter: str, value: float | list[float], spin: Callable[[], None]
    ) -> None:
        call = self._recorder.parameter_clients[name].set({parameter: value})
        what = f'the {name} does not answer: {parameter} cannot be set'
        [result] = _wait(call.answer, what, spin)
        if not result.successful:
            raise CaRosError(f'the {name} refuses {parameter}: {result.reason}')


def _wait(answer: Callable[[], Any], fault: str, spin: Callable[[], None]) -> Any:
    """Spin until there is an answer, and return it; raise the fault after `TIMEOUT`."""
    limit = Deadline(TIMEOUT)
    while (found := answer()) is None:
        if limit.passed():
            raise CaRosError(fault)
        spin()
    return found
