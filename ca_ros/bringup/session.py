"""A flight over ROS: starts the nodes, sends the waypoint and records until the end."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from math import inf
from typing import Any

from rclpy.executors import SingleThreadedExecutor

from ca_ros.bringup.agreement import check, combined
from ca_ros.bringup.bag import Bag
from ca_ros.bringup.fault_proxy import PREFIX
from ca_ros.bringup.options import foreign, options_as_parameters
from ca_ros.bringup.recorder import LINK_NAMES, Recorder
from ca_ros.bringup.reports import Reports
from ca_ros.bringup.timeline import Timeline
from ca_ros.errors import CaRosError
from ca_ros.flight.record import Flight
from ca_ros.flight.trajectory import Trajectory
from ca_ros.process.deadline import Deadline
from ca_ros.process.processes import Processes
from ca_ros.vehicle.vehicle import Vehicle

PROGRESS_TIMEOUT = 60.0
"""Time without progress after which the start or the flight is given up [s]."""

LOOK_AROUND = 0.5
"""Time to discover other nodes before the start, and between later checks [s]."""


class Stopped(CaRosError):
    """The flight ended early."""


@dataclass(frozen=True)
class Flown:
    """A finished flight.

    Attributes
    ----------
    flight : Flight
    wall : float
        Time that the flight took [s].
    respawned : Counter of str
        How often each node was restarted.
    timeouts : Counter of str
        The timeouts of each node that had one.
    faults : Counter of str
        How many messages the fault proxy received, and how many had each fault; empty without it.
    parameters : dict
        The parameters of the nodes by name; where they differ, those of the allocator.
    """

    flight: Flight
    wall: float
    respawned: Counter[str]
    timeouts: Counter[str]
    faults: Counter[str]
    parameters: dict[str, Any]


class Session:
    """The nodes of one flight as processes, and the recorder and the bag in this process.

    Parameters
    ----------
    options : Namespace
        Of `ca_ros.bringup.options.parse`.
    commands : mapping of str to sequence of str
        The command line of each node by name.
    interrupts : list of int
        Signals that have arrived; one ends the flight.
    bag : Bag or None
    """

    def __init__(
        self,
        options: argparse.Namespace,
        commands: Mapping[str, Sequence[str]],
        interrupts: list[int],
        bag: Bag | None,
    ) -> None:
        self._options, self._interrupts, self._bag = options, interrupts, bag
        links = [*LINK_NAMES]
        if options.faults is not None:
            links += [f'{PREFIX}{topic}' for topic in LINK_NAMES]
        self._recorder = Recorder(links, foreign(options), namespace=options.namespace)
        self._reports = Reports(self._recorder)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._recorder)
        self._processes = Processes(commands)
        self._looked = time.monotonic()

    def fly(self, trajectory: Trajectory) -> Flown:
        """Start the nodes, fly a trajectory, and end the nodes.

        Raises
        ------
        CaRosError
            If the flight ended early.
        """
        try:
            # The bag closes after the nodes have ended, so it is complete.
            with self._bag or nullcontext():
                began = time.monotonic()
                while time.monotonic() < began + LOOK_AROUND and not self._interrupts:
                    self._executor.spin_once(timeout_sec=0.05)
                self._check_alone(own=0)
                with self._processes:
                    return self._fly(trajectory)
        finally:
            self._executor.shutdown()
            self._recorder.destroy_node()

    def _fly(self, trajectory: Trajectory) -> Flown:
        recorder, bag, duration = self._recorder, self._bag, self._options.duration
        if bag:
            bag.listen(self._options.namespace)
        self._wait(lambda: recorder.missing() + (bag.missing() if bag else []))
        check(recorder.parameters, options_as_parameters(self._options))
        parameters = recorder.parameters
        common = combined(parameters)
        vehicle = Vehicle.from_parameters(common)
        recorder.samples.expect(vehicle.n)
        lockstep = common['mode'] == 'lockstep'
        timeline = Timeline(recorder, trajectory, self._options.failures, parameters)
        self._wait(timeline.missing)
        timeline.update(None, self._spin)
        recorder.send(trajectory.first)
        began = time.monotonic()
        progress, deadline = 0.0, Deadline(PROGRESS_TIMEOUT)
        while progress < duration:
            self._spin()
            timeline.update(recorder.elapsed_ns, self._spin)
            if recorder.waiting and not recorder.missing():
                recorder.send(trajectory.first)
            if recorder.elapsed != progress:
                progress, deadline = recorder.elapsed, Deadline(PROGRESS_TIMEOUT)
                _show(progress, duration)
            elif deadline.passed():
                raise Stopped(
                    f'the flight has stalled at {progress:.2f} s for {PROGRESS_TIMEOUT:g} s'
                    f'{self._reports.faults_of_nodes()}'
                )
        if bag:
            end = recorder.end(duration)
            self._wait(lambda: bag.behind(end))
        wall = time.monotonic() - began
        faults: Counter[str] = Counter()
        if self._options.faults is not None:
            now = recorder.get_clock().now().nanoseconds
            self._wait(lambda: self._reports.missing(now))
            faults = self._reports.faults()
        flight = recorder.flight(duration)
        if lockstep and (lost := flight.missing(duration)):
            raise Stopped(f'{lost} samples were lost: the recorder did not keep up')
        respawned, timeouts = self._processes.respawned, self._reports.timeouts()
        return Flown(flight, wall, respawned, timeouts, faults, common)

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
            raise Stopped(f'interrupted by {signal.Signals(self._interrupts[0]).name}')
        respawned = self._processes.respawn() if self._options.respawn else {}
        if ended := self._processes.ended().items():
            raise Stopped(
                ', '.join(f'the {name} ended with exit code {code}' for name, code in ended)
            )
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
        fewest, deadline = inf, Deadline(PROGRESS_TIMEOUT)
        while topics := missing():
            self._spin()
            if len(topics) < fewest:
                fewest, deadline = len(topics), Deadline(PROGRESS_TIMEOUT)
            elif deadline.passed():
                raise Stopped(
                    f'after {PROGRESS_TIMEOUT:g} s no node on {", ".join(topics)}'
                    f'{self._reports.faults_of_nodes()}'
                )

    def _check_alone(self, own: int) -> None:
        if others := self._recorder.others(own):
            raise Stopped(
                f'other nodes publish on {", ".join(others)} in ROS domain '
                f'{self._recorder.context.get_domain_id()}: end them, or choose another '
                '--namespace or ROS_DOMAIN_ID (DDS lists a node that was killed with -9 for 20 s)'
            )


def _show(progress: float, duration: float) -> None:
    """Show on a terminal how far the flight is [s]; the next line that is printed replaces it."""
    if sys.stderr.isatty():
        text = f'flight: {min(progress, duration):.1f} of {duration:.1f} s'
        print(text, end='\r', file=sys.stderr, flush=True)
