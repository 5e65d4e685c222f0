"""Fly ca_ros on PX4's simulator SIH.

    python fly.py hover --px4 ~/PX4-Autopilot/build/px4_sitl_default --agent MicroXRCEAgent

Each flight starts PX4, the agent and the nodes anew and leaves PX4's own log,
``SCENARIO_INTERFACE_NUMBER.ulg``; flight_table.py measures the logs.  px4_msgs of the same version
as PX4 has to be sourced.  SIH needs no Gazebo: ``make px4_sitl_default`` has it.
"""

import argparse
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import rclpy
from pilot import HOLD, OFFBOARD, Pilot
from rclpy.utilities import try_shutdown
from sitl import Sitl, parsed

from ca_ros.testing.domain import claim

HERE = Path(__file__).resolve().parent
HEIGHT = 4.0  # [m]
WATCHED = 12.0  # after what a scenario does [s]
KNOWN_AFTER = 0.1  # from the loss of a rotor to its announcement [s]


class Flight(NamedTuple):
    """A flight that is under way: PX4 with its nodes, its pilot, and its options."""

    sitl: Sitl
    pilot: Pilot
    options: argparse.Namespace

    def mark(self, *values: float) -> None:
        """Mark the moment from which the flight is measured; see flight_table.py."""
        self.pilot.mark(*values)


def hover(flight: Flight) -> None:
    """Hover."""
    flight.mark()
    flight.pilot.fly(15.0)


def takeover(flight: Flight) -> None:
    """The controller leaves for a place near the ground, and the pilot selects Hold."""
    flight.mark()
    flight.pilot.waypoint(10.0, 0.0, 0.5)
    flight.pilot.select(HOLD)
    flight.pilot.fly(WATCHED)


def killed(name: str) -> Callable[[Flight], None]:
    """Return a scenario in which a process is killed."""

    def scenario(flight: Flight) -> None:
        flight.mark()
        flight.sitl.kill(name)
        flight.pilot.fly(WATCHED)

    scenario.__doc__ = f'{name} is killed.'
    return scenario


def agent_back(flight: Flight) -> None:
    """The agent is killed, and back after 3 s; when it hovers in Hold, the mode is selected."""
    pilot = flight.pilot
    flight.mark()
    flight.sitl.kill('agent')
    pilot.fly(3.0)
    start_agent(flight.sitl, flight.options)
    pilot.status = None
    pilot.wait('PX4 heard again', lambda: pilot.status is not None)
    pilot.select(HOLD)
    pilot.fly(5.0)
    pilot.select(chosen(flight))
    flight.mark(1.0)
    pilot.fly(WATCHED)


def square(flight: Flight) -> None:
    """Four corners, 4 m apart, 7 s each."""
    for x, y in ((4.0, 0.0), (4.0, 4.0), (0.0, 4.0), (0.0, 0.0)):
        flight.pilot.waypoint(x, y, HEIGHT)
        flight.pilot.fly(7.0)
        flight.mark(2.0, x, y, HEIGHT)
    flight.pilot.fly(1.0)


def wind(flight: Flight) -> None:
    """A wind of 5 m/s from the south begins."""
    said = flight.sitl.shell('param', 'set', 'SIH_WIND_N', '5')
    if 'SIH_WIND_N' not in said or 'not found' in said:
        raise SystemExit('this SIH has no wind (SIH_WIND_N)')
    flight.mark()
    flight.pilot.fly(20.0)


def announced(rotor: int) -> Callable[[Flight], None]:
    """Return a scenario in which a rotor is lost, and announced after `KNOWN_AFTER`."""

    def scenario(flight: Flight) -> None:
        flight.mark(float(rotor))
        flight.pilot.lost.add(rotor)
        flight.pilot.fly(KNOWN_AFTER)
        flight.pilot.announce(6, rotor)
        flight.pilot.fly(WATCHED)

    scenario.__doc__ = f'Rotor {rotor} is lost, and announced after {KNOWN_AFTER:g} s.'
    return scenario


def named(rotor: int) -> Callable[[Flight], None]:
    """Return a scenario in which a rotor is lost, and the monitor has to find it."""

    def scenario(flight: Flight) -> None:
        flight.mark(float(rotor))
        flight.pilot.lost.add(rotor)
        flight.pilot.fly(WATCHED)

    scenario.__doc__ = f'Rotor {rotor} is lost, and the monitor names it.'
    return scenario


ROTORS, PROCESSES = range(1, 7), ('controller', 'allocator', 'px4_bridge', 'agent')
SCENARIOS: dict[str, Callable[[Flight], None]] = {
    'hover': hover, 'takeover': takeover, 'square': square, 'wind': wind,
    **{f'{name}-killed': killed(name) for name in PROCESSES},
    'agent-back': agent_back, 'clock-behind': hover,
    **{f'announced-{rotor}': announced(rotor) for rotor in ROTORS},
    **{f'named-{rotor}': named(rotor) for rotor in ROTORS},
}


def start_agent(sitl: Sitl, options: argparse.Namespace, behind: bool = False) -> None:
    """Start the agent; `behind`: the clock of the nodes is 2 s behind that of the agent."""
    ahead = ['env', 'FAKETIME_DONT_FAKE_MONOTONIC=1', 'faketime', '-f', '+2s'] * behind
    sitl.start('agent', [*ahead, options.agent, 'udp4', '-p', str(sitl.port)])


def chosen(flight: Flight) -> int:
    """Return the mode of PX4 in which ca_ros flies."""
    if flight.options.interface == 'mode':
        return flight.pilot.mode
    return OFFBOARD if flight.options.interface == 'offboard' else HOLD


def take_off(flight: Flight) -> None:
    """Take off in the mode of the interface, and hover."""
    pilot, interface = flight.pilot, flight.options.interface
    pilot.wait('PX4 heard', lambda: pilot.status is not None and pilot.odometry is not None)
    pilot.waypoint(0.0, 0.0, HEIGHT)
    if interface == 'setpoints':
        pilot.wait('PX4 ready', lambda: pilot.status.pre_flight_checks_pass)
        pilot.insist(
            'climbing', lambda: pilot.height > 0.3,
            lambda: print(flight.sitl.shell('commander', 'takeoff'), end=''),
        )
    else:
        if interface == 'mode':
            pilot.wait('the mode registered', lambda: pilot.mode > 0)
        pilot.select(chosen(flight))
        pilot.wait('PX4 ready', lambda: pilot.status.pre_flight_checks_pass)
        pilot.arm()
    pilot.wait('in the air', lambda: pilot.height > HEIGHT - 0.6, 30.0)
    pilot.fly(6.0)


@contextmanager
def started(scenario: str, options: argparse.Namespace) -> Iterator[Flight]:
    """Start what a scenario needs."""
    rotor = scenario.rpartition('-')[2].isdigit()
    model = 'hex' if rotor or options.hexarotor else 'quadx'
    vehicle = '--vehicle', str(HERE / f'sih_{model}.yaml'), '--ros-args'
    given = dict(entry.split('=') for entry in options.px4_parameter)
    parameters = {'MPC_TAKEOFF_ALT': HEIGHT, 'MIS_TAKEOFF_ALT': HEIGHT, **given}
    with TemporaryDirectory(prefix='px4_') as folder:
        simulated = Sitl(
            options.px4, model, Path(folder, 'sitl'), options.speed, options.nice, parameters,
            options.instance,
        )
        with simulated as sitl:
            start_agent(sitl, options, scenario == 'clock-behind')
            pilot = Pilot(sitl)
            try:
                bridge = ['-p', f'px4.interface:={options.interface}']
                if options.interface == 'setpoints':
                    bridge += ['-p', 'px4.simulation:=true']
                    # Before the bridge: the stop unadvertises what it publishes.
                    pilot.wait('PX4 heard', lambda: pilot.status is not None)
                    sitl.shell('control_allocator', 'stop')
                if rotor:
                    bridge += ['-r', Pilot.BROKEN]
                sitl.node('px4_bridge', *vehicle, *bridge)
                sitl.node('allocator', *vehicle)
                if options.interface != 'setpoints':
                    sitl.node('controller', *vehicle)
                if scenario.startswith('named'):
                    sitl.node('monitor', *vehicle)
                yield Flight(sitl, pilot, options)
            finally:
                pilot.close()
                if options.keep:
                    shutil.copytree(folder, options.keep, dirs_exist_ok=True)


def fly(scenario: str, number: int, options: argparse.Namespace) -> str:
    """Fly a scenario once; return what came of it."""
    to = options.out / f'{scenario}_{options.label or options.interface}_{number}.ulg'
    with started(scenario, options) as flight:
        try:
            take_off(flight)
            SCENARIOS[scenario](flight)
            said = 'flown'
        except TimeoutError as error:
            said = f'not flown: {error}'
            to = to.with_suffix('.failed.ulg')
        flight.sitl.log(to)
    return f'{to.name}: {said}'


def main() -> None:
    """Fly the scenarios that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('scenarios', nargs='+', choices=SCENARIOS, metavar='SCENARIO',
                        help=', '.join(SCENARIOS))
    parser.add_argument('--agent', type=Path, default=shutil.which('MicroXRCEAgent'),
                        help='the executable of the agent')
    parser.add_argument('--interface', choices=('mode', 'offboard', 'setpoints'),
                        default='mode', help='as px4.interface')
    parser.add_argument('--hexarotor', action='store_true', help='fly the hexarotor')
    parser.add_argument('--repeat', type=int, default=1, help='flights of each scenario')
    parser.add_argument('--first', type=int, default=1, help='number of the first flight')
    parser.add_argument('--px4-parameter', action='append', default=[], metavar='NAME=VALUE')
    parser.add_argument('--label', help='name of the flights, if not that of the interface')
    parser.add_argument('--keep', type=Path, help="folder for PX4's files and all output")
    options = parsed(parser, speed=1.0)
    failed = 0
    with claim() as domain:
        os.environ |= {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        rclpy.init()
        for scenario in options.scenarios:
            for number in range(options.first, options.first + options.repeat):
                said = fly(scenario, number, options)
                failed += 'not flown' in said
                print(said, flush=True)
        try_shutdown()
    sys.exit(failed > 0)


if __name__ == '__main__':
    main()
