"""A flight over ROS: starts the nodes, sends the waypoint and records until the end."""

import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import Any

from rclpy.executors import SingleThreadedExecutor

from ca_ros.bringup.bag import Bag
from ca_ros.bringup.options import FAILURES, Plan
from ca_ros.bringup.recorder import Recorder
from ca_ros.bringup.scenario import Scenario
from ca_ros.errors import CaRosError
from ca_ros.nodes.fault_proxy import PREFIX
from ca_ros.nodes.link_faults import LINK_NAMES
from ca_ros.nodes.topics import ANNOUNCED_HEALTH, SPEEDS
from ca_ros.parameter_files import DECLARED
from ca_ros.process.diagnostics import Reports
from ca_ros.process.processes import Deadline, Processes
from ca_ros.settings import table
from ca_ros.simulation.record import Flight
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.vehicle.settings import MovingVehicleSettings
from ca_ros.vehicle.vehicle import Vehicle
from ca_ros_cli import NODES

PROGRESS_TIMEOUT = 60.0  # time without progress after which a start or flight is given up [s]
NOTICE = 10.0  # period of the lines that say what a flight waits for [s]
VEHICLE = table(MovingVehicleSettings)
REFERENCES = ('allocator', 'controller', 'simulator')  # of two values that of the first counts
Parameters = Mapping[str, Mapping[str, Any]]  # values by node and name

CUTTING = 'controller', 'allocator'  # the nodes that may not serve a demand in full

LOOK_AROUND = 0.5  # time to discover other nodes before the start, and between later checks [s]


@dataclass(frozen=True)
class Flown:
    """A finished flight, and the time that it took [s].

    `respawned` and `timeouts` count those of each node that had some.  `faults` counts the
    messages that the fault proxy received, and those with each fault.  `parameters` are those of
    the nodes by name, see `agreed`, and `vehicle` and `failures` are theirs.  `stops` tells
    whether the timeout action of a node is to stop the rotors.  `detected` are the times of flight
    at which the monitor found failures [s], by rotor, from 1, and `withheld` those that it let
    nobody act on.  `wrenches` are those of `ca_ros.bringup.recorder.DEMANDED`, by the time of
    flight [ns], and `limits` says for each axis that was cut what limited it.
    """

    flight: Flight
    wall: float
    respawned: Counter[str]
    timeouts: Counter[str]
    faults: Counter[str]
    parameters: dict[str, Any]
    vehicle: Vehicle
    wrenches: Mapping[str, Mapping[int, tuple[float, ...]]]
    failures: RotorFailures = field(default_factory=RotorFailures)
    stops: bool = False
    detected: Mapping[int, float] = field(default_factory=dict)
    limits: Mapping[str, str] = field(default_factory=dict)
    withheld: Collection[int] = ()


class EndedEarlyError(CaRosError):
    """A flight has begun and ended early; `flown` is what was flown until then."""

    def __init__(self, message: str, flown: Flown) -> None:
        super().__init__(message)
        self.flown = flown


class Session:
    """The nodes of one flight as processes, and the recorder and the bag in this process.

    `commands` are the command lines of the nodes by name.  `interrupts` grows with the signals
    that arrive; one ends the flight.
    """

    def __init__(
        self, plan: Plan, commands: Mapping[str, Sequence[str]], interrupts: list[int],
        bag: Bag | None,
    ) -> None:
        self._plan, self._interrupts, self._bag = plan, interrupts, bag
        links = [*LINK_NAMES]
        if plan.faults is not None:
            links += [f'{PREFIX}{topic}' for topic in LINK_NAMES]
        self._recorder = Recorder(
            links, plan.replacements, measures=plan.detect, namespace=plan.namespace)
        self._reports = Reports(self._recorder)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._recorder)
        self._processes = Processes(commands)
        self._looked = time.monotonic()

    def fly(self) -> Flown:
        """Start the nodes, fly, and end them.

        Raises a CaRosError if there was no flight, or an EndedEarlyError.
        """
        try:
            # The bag closes after the nodes have ended, so it is complete.
            with closing(self._bag) if self._bag else nullcontext():
                began = time.monotonic()
                while time.monotonic() < began + LOOK_AROUND and not self._interrupts:
                    self._executor.spin_once(timeout_sec=0.05)
                self._check_alone(own=0)
                with self._processes:
                    return self._fly()
        finally:
            self._executor.shutdown()
            self._recorder.destroy_node()

    def _fly(self) -> Flown:
        recorder, bag, plan = self._recorder, self._bag, self._plan
        trajectory, duration = plan.trajectory, plan.duration
        if bag:
            bag.listen(plan.namespace)
        self._wait(lambda: recorder.missing() + (bag.missing() if bag else []))
        parameters = recorder.parameters
        common = agreed(parameters, plan.parameters)
        vehicle = Vehicle.from_parameters(common)
        recorder.samples.expect(vehicle.n, len(vehicle.servos))
        scenario = Scenario(
            recorder, trajectory, plan.failures, parameters['simulator'].get(FAILURES),
            common['mode'], vehicle,
            [name for name in ANNOUNCED_HEALTH.subscribers if name != 'monitor' or plan.detect])
        if plan.respawn and scenario.failures.failures:
            raise CaRosError(f'--respawn: not with {FAILURES}, since it restarts the flight')
        scenario.begin(self._spin)
        began = time.monotonic()
        try:
            self._follow(duration, scenario)
        except CaRosError as error:
            if not recorder.elapsed:
                raise
            flight, none = recorder.flight(duration), Counter[str]()
            wall = time.monotonic() - began
            counts = self._processes.respawned, none, none
            raise EndedEarlyError(
                str(error),
                Flown(flight, wall, *counts, common, vehicle, recorder.demanded(duration),
                      scenario.failures)) from None
        if bag:
            end = recorder.end(duration)
            self._wait(lambda: bag.behind(end))
        wall = time.monotonic() - began
        late = ['monitor'] * plan.detect + ['fault_proxy'] * (plan.faults is not None)
        if recorder.cut():
            late += [name for name in CUTTING if name not in plan.replacements]
        now = recorder.get_clock().now().nanoseconds
        self._wait(lambda: self._reports.missing(late, now))
        faults = self._reports.link_faults()
        flight = recorder.flight(duration)
        if common['mode'] == 'lockstep' and (lost := flight.missing(duration)):
            raise CaRosError(f'{lost} samples were lost: the recorder did not keep up')
        start, found = recorder.end(0.0), self._reports.detected()
        stops = any(own.get('timeout_action') == 'stop' for own in parameters.values())
        detected = {rotor: (time - start) / 1e9 for rotor, time in found.items()}
        counts = self._processes.respawned, self._reports.timeouts(), faults
        return Flown(
            flight, wall, *counts, common, vehicle, recorder.demanded(duration),
            scenario.failures, stops, detected, self._reports.limits(), self._reports.withheld())

    def _follow(self, duration: float, scenario: Scenario) -> None:
        """Fly until samples for the duration [s] have come; raise a CaRosError if they cease."""
        recorder, progress, patience = self._recorder, 0.0, Patience()
        while progress < duration:
            self._spin()
            scenario.update(recorder.elapsed)
            if recorder.waiting and not recorder.missing():
                recorder.send(self._plan.trajectory.first)
            if (elapsed := (recorder.elapsed or 0) / 1e9) != progress:
                progress, patience = elapsed, Patience()
                _show(progress, duration)
            patience.check(partial(self._stalled, progress))

    def _lacking(self, topics: list[str], seconds: float) -> str:
        faults = self._reports.faults_of_nodes()
        return f'after {seconds:g} s no node on {", ".join(topics)}{faults}'

    def _stalled(self, progress: float, seconds: float) -> str:
        what = f'stalled at {progress:.2f} s for {seconds:g} s'
        if self._recorder.elapsed is None:
            answers = f'no rotor speeds that answer a wrench on {SPEEDS.name}'
            what = f'not begun for {seconds:g} s: {answers}'
        return f'the flight has {what}{self._reports.faults_of_nodes()}'

    def _spin(self) -> None:
        """Serve the recorder and the bag once, and restart nodes that have ended."""
        self._executor.spin_once(timeout_sec=0.1)
        # Discovery may take 3 s.  After a respawn DDS still lists the killed node.
        if time.monotonic() > self._looked + LOOK_AROUND and not self._processes.respawned:
            self._looked = time.monotonic()
            self._check_alone(own=1)
        self._recorder.drain()
        if self._bag:
            self._bag.write()
        if self._interrupts:
            raise CaRosError(f'interrupted by {signal.Signals(self._interrupts[0]).name}')
        respawned = self._processes.respawn() if self._plan.respawn else {}
        if ended := self._processes.ended().items():
            codes = (f'the {name} ended with exit code {code}' for name, code in ended)
            raise CaRosError(', '.join(codes))
        for name, code in respawned.items():
            line = f'bringup: the {name} ended with exit code {code} and is started again'
            if name == 'simulator':
                # The vehicle must rest until the recorder is connected.
                self._processes.restart('controller')
                self._recorder.restart()
                line += ', and the controller too: the flight begins again, from rest'
            print(line, file=sys.stderr)

    def _wait(self, missing: Callable[[], list[str]]) -> None:
        """Spin until nothing is missing."""
        fewest, patience = inf, Patience()
        while topics := missing():
            self._spin()
            if len(topics) < fewest:
                fewest, patience = len(topics), Patience()
            patience.check(partial(self._lacking, topics))

    def _check_alone(self, own: int) -> None:
        if others := self._recorder.others(own):
            raise CaRosError(
                f'other nodes publish on {", ".join(others)} in ROS domain '
                f'{self._recorder.context.get_domain_id()}: end them, or choose another '
                '--namespace or ROS_DOMAIN_ID (DDS lists a node that was killed with -9 for 20 s)'
            )


def agreed(parameters: Parameters, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of all nodes by name: those of the first node of `REFERENCES`.

    Raises a CaRosError if a node contradicts the options `asked` or the mode of another.  What
    cannot be compared, and two vehicles, are warnings: model mismatch is a common experiment.
    """
    common: dict[str, Any] = {}
    for node in reversed(REFERENCES):
        common |= parameters[node]
    if 'mode' not in common:
        raise CaRosError('no node declares the parameter mode: one of ours must be there')
    asked = {'mode': common['mode'], **asked}
    for node in NODES:
        own, names = parameters[node], (*asked, *VEHICLE)
        for name, value in asked.items():
            if (found := own.get(name, value)) != value:
                raise CaRosError(
                    f'{name} of the {node} is {found}, not {value}: see the parameter files and '
                    'the ROS arguments')
        lacks = [name for name in names if name in table(DECLARED[node]) and name not in own]
        differs = [name for name in VEHICLE if name in own and own[name] != common[name]]
        if not own:
            _warn(f'the {node} has no parameters: its mode and vehicle cannot be compared')
        elif lacks:
            _warn(f'the {node} does not declare {", ".join(lacks)}: these cannot be compared')
        if differs:
            _warn(f'the {node} has another vehicle than other nodes: see {", ".join(differs)}')
    return common


def _warn(text: str) -> None:
    print(f'bringup: warning: {text}', file=sys.stderr)


class Patience:
    """A limit on the time without progress, and notices until then."""

    def __init__(self) -> None:
        self._limit, self._notice, self._notices = Deadline(PROGRESS_TIMEOUT), Deadline(NOTICE), 0

    def check(self, what: Callable[[float], str]) -> None:
        """Print what is waited for every `NOTICE` seconds, of which `what` makes the text [s].

        Raises a `CaRosError` at the limit.
        """
        if self._limit.passed():
            raise CaRosError(what(PROGRESS_TIMEOUT))
        if self._notice.passed():
            self._notices += 1
            print(
                f'bringup: {what(self._notices * NOTICE)}; waiting up to {PROGRESS_TIMEOUT:g} s',
                file=sys.stderr)
            self._notice = Deadline(NOTICE)


def _show(progress: float, duration: float) -> None:
    """Show on a terminal how far the flight is [s]; the next line that is printed replaces it."""
    if sys.stderr.isatty():
        print(
            f'flight: {min(progress, duration):.1f} of {duration:.1f} s',
            end='\r', file=sys.stderr, flush=True)
