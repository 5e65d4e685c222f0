"""What happens at given times of a flight: waypoints, rotor failures and their announcements."""

import sys
from collections.abc import Callable, Collection, Sequence
from functools import partial

from ca_ros.bringup.options import FAILURES
from ca_ros.bringup.recorder import Recorder
from ca_ros.control.trajectory import Trajectory
from ca_ros.errors import CaRosError
from ca_ros.nodes import topics
from ca_ros.nodes.topics import DEPTH
from ca_ros.process.processes import Deadline
from ca_ros.settings import ParameterError
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.vehicle.vehicle import Vehicle

HEARING = 5.0  # longest wait for the nodes that should hear announcements [s]
TIMEOUT = 60.0  # time limit for the receivers of a message [s]


class Scenario:
    """Sends the waypoints of a flight, and announces the failures of the simulator.

    In lockstep all is sent before the flight, with the stamps from which it holds, so all flights
    are the same.  In real time each message is sent when it is due, and holds at once.

    - `failures`: those of the simulator, with the delay of the announcements that are planned
    - `listeners`: the nodes that should hear announcements

    The recorder sends; `words` are the parameter `simulator.failures`, None if the simulator has
    none.  Raises a CaRosError if failures are planned that the simulator or the vehicle cannot
    have, or too many messages.
    """

    def __init__(
        self, recorder: Recorder, trajectory: Trajectory, planned: RotorFailures,
        words: Sequence[str] | None, mode: str, vehicle: Vehicle, listeners: Collection[str],
    ) -> None:
        self._recorder, self._trajectory = recorder, trajectory
        if words is None and planned.failures:
            raise CaRosError(f'the simulator does not declare {FAILURES}, which --fail needs')
        self.failures = failures = planned
        if words is not None:
            self.failures = failures = RotorFailures.read(words, planned.announce)
        if planned.words not in (failures.words, RotorFailures().words):
            raise CaRosError(f'{FAILURES} of the simulator is {words}, not {planned.words}')
        try:
            failures.check(vehicle)
        except ParameterError as error:
            raise CaRosError(f'{FAILURES}: {error}') from None
        self._lockstep = mode == 'lockstep'
        self._events: list[tuple[int, Callable[[int], None]]] = sorted([
            *((time, partial(self._send_waypoint, time)) for time in trajectory.times[1:]),
            *((time, partial(self._announce, vehicle.n, time))
              for time in failures.announced_times),
        ], key=lambda event: event[0])
        if self._lockstep and len(self._events) > DEPTH:
            raise CaRosError(
                f'{len(self._events)} waypoints and announcements after the start: expected up to '
                f'{DEPTH} in lockstep'
            )
        self._listeners = listeners if failures.announced_times else ()

    def begin(self, spin: Callable[[], None]) -> None:
        """Send what is sent before the flight; `spin` spins the node once.

        Raises a CaRosError if a node does not receive it.
        """
        limit = Deadline(HEARING)
        while (deaf := self._recorder.deaf(self._listeners)) and not limit.passed():
            spin()
        for name in deaf:
            print(
                f'bringup: warning: the {name} does not subscribe to '
                f'{topics.ANNOUNCED_HEALTH.name}: it does not learn of rotor failures',
                file=sys.stderr)
        if self._lockstep:
            for time, send in self._events:
                send(time)
            self._events.clear()
        # The first waypoint begins the flight.
        limit = Deadline(TIMEOUT)
        while not self._recorder.delivered():
            if limit.passed():
                raise CaRosError('the nodes do not receive waypoints and announcements')
            spin()
        self._recorder.send(self._trajectory.first)

    def update(self, elapsed: int | None) -> None:
        """Send what is due; `elapsed` is the time of flight [ns], None before the flight."""
        while self._events and elapsed is not None and self._events[0][0] <= elapsed:
            self._events.pop(0)[1](0)

    def _send_waypoint(self, time: int, stamp: int) -> None:
        self._recorder.send(self._trajectory.at(time), stamp)

    def _announce(self, n: int, time: int, stamp: int) -> None:
        self._recorder.announce(*self.failures.announced(n, time), stamp)
