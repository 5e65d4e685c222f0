"""Fly PX4 alone on its simulator SIH, with its own loops, and leave logs for `ca_ros replay`.

    pip install pymavlink pyulog
    python log_flights.py --px4 ~/PX4-Autopilot/build/px4_sitl_default --out flights
    ca_ros replay flights/hex_1.ulg sih_hex.yaml --throttle linear

A log has nine flights: take-off, steps of velocity or position in offboard mode or a hover, and
landing.  `benchmarks.detection.px4_flights` counts what the detector names in such logs.
"""

import argparse
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Self

import numpy as np
from sitl import Sitl, parsed

os.environ['MAVLINK20'] = '1'
from pymavlink import mavutil

TOPICS = (
    'actuator_motors', 'vehicle_acceleration', 'vehicle_angular_velocity', 'vehicle_attitude',
    'vehicle_local_position', 'vehicle_land_detected',
)
PARAMETERS = {
    'SDLOG_MODE': 2,  # one log, from the start to the end
    'MIS_TAKEOFF_ALT': 4.0,  # [m]
}
PORTS = 19450, 19410  # of the first PX4's link to displays of SIH: its own, and theirs
POSITION = 'LOCAL_POSITION_NED'
RATE = 50  # of position and set-points [Hz]
FLIGHTS = 9  # of a log
FAR = 25.0  # velocities point home from here on [m]

# What a set-point leaves out, see POSITION_TARGET_TYPEMASK of MAVLink.
POSITION_AND_YAW, VELOCITY_AND_YAW_RATE = 0b1001_1111_1000, 0b0101_1100_0111


class Link:
    """Gives set-points to PX4 over MAVLink, and hears where it is.

    - `time`: since PX4 started [s]
    - `armed`: whether its motors turn
    - `position`: north, east, down [m]
    """

    def __init__(self, sitl: Sitl) -> None:
        self.sitl = sitl
        own, other = (str(port + int(sitl.instance)) for port in PORTS)
        self._mavlink: Any = mavutil.mavlink_connection(f'udpin:127.0.0.1:{other}')
        stream = 'stream', '-u', own, '-s', POSITION, '-r', str(RATE)
        for _ in range(100):
            sitl.shell('mavlink', *stream)
            if self._mavlink.recv_match(type=POSITION, blocking=True, timeout=0.3):
                break
        for other_stream in 'HIL_ACTUATOR_CONTROLS', 'HIL_STATE_QUATERNION':
            sitl.shell('mavlink', 'stream', '-u', own, '-s', other_stream, '-r', '0')
        self.time, self.armed = 0.0, False
        self.position = np.zeros(3)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._mavlink.close()

    @property
    def height(self) -> float:
        """Return the height that PX4 estimates [m]."""
        return -float(self.position[2])

    def hear(self) -> None:
        """Wait for the next position."""
        while True:
            message = self._mavlink.recv_match(
                type=[POSITION, 'HEARTBEAT'], blocking=True, timeout=20.0)
            if message is None:
                raise TimeoutError(f'PX4 says nothing: {self.sitl.folder}')
            if message.get_type() == POSITION:
                self.time = message.time_boot_ms / 1e3
                self.position = np.array([message.x, message.y, message.z])
                return
            self.armed = bool(message.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    def fly(self, seconds: float, mask: int = 0, values: Sequence[float] = (0.0,) * 8) -> None:
        """Let simulated time pass, with a set-point: position, velocity, yaw, yaw rate."""
        end = self.time + seconds
        while self.time < end:
            self.hear()
            if mask:
                self._send(mask, values)

    def _send(self, mask: int, values: Sequence[float]) -> None:
        self._mavlink.mav.set_position_target_local_ned_send(
            0, int(self.sitl.instance) + 1, 1, mavutil.mavlink.MAV_FRAME_LOCAL_NED, mask,
            *values[:6], 0.0, 0.0, 0.0, *values[6:])

    def wait(self, done: Callable[[], bool], limit: float) -> bool:
        """Wait until something is so, for a simulated time at most [s]; return whether it is."""
        end = self.time + limit
        while not done() and self.time < end:
            self.hear()
        return done()

    def offboard(self) -> None:
        """Select the offboard mode, with zero velocity."""
        self.fly(0.5, VELOCITY_AND_YAW_RATE)
        self.sitl.shell('commander', 'mode', 'offboard')


def steps_of_position(link: Link, random: np.random.Generator) -> None:
    """Fly 8 steps of up to 8 m along each axis."""
    link.offboard()
    for _ in range(8):
        north, east, up, yaw = random.uniform((-8.0, -8.0, 3.0, -3.0), (8.0, 8.0, 9.0, 3.0))
        target = north, east, -up, 0.0, 0.0, 0.0, yaw, 0.0
        link.fly(random.uniform(2.0, 5.0), POSITION_AND_YAW, target)


def steps_of_velocity(link: Link, random: np.random.Generator) -> None:
    """Fly 20 steps of velocity, up to 8 m/s, with up to 2 rad/s of yaw."""
    link.offboard()
    for _ in range(20):
        speed, course = random.uniform(0.0, 8.0), random.uniform(-np.pi, np.pi)
        if np.linalg.norm(link.position[:2]) > FAR:
            course = float(np.arctan2(-link.position[1], -link.position[0]))
        climb = random.uniform(-2.0, 2.0)
        if not 4.0 < link.height < 15.0:
            climb = 1.5 if link.height < 8.0 else -1.5
        velocity = speed * np.cos(course), speed * np.sin(course), -climb
        rate = random.choice((0.0, random.uniform(-2.0, 2.0)))
        link.fly(random.uniform(0.6, 2.5), VELOCITY_AND_YAW_RATE,
                 (0.0, 0.0, 0.0, *velocity, 0.0, rate))


def hold(link: Link, random: np.random.Generator) -> None:
    """Hold the position."""
    link.fly(10.0)


def land(link: Link, random: np.random.Generator) -> None:
    """Land in PX4's mode, at once or from a hover, or by a velocity in offboard mode."""
    kind = random.integers(3)
    if kind == 0:
        link.sitl.shell('commander', 'mode', 'auto:loiter')
        link.fly(4.0)
    elif kind == 1:
        link.offboard()
        down = 0.0, 0.0, 0.0, *random.uniform(-0.3, 0.3, 2), random.uniform(0.4, 1.2), 0.0, 0.0
        for _ in range(60):
            link.fly(0.5, VELOCITY_AND_YAW_RATE, down)
            if not link.armed:
                return
    link.sitl.shell('commander', 'mode', 'auto:land')
    if not link.wait(lambda: not link.armed, 60.0):
        raise TimeoutError(f'PX4 does not land: {link.sitl.folder}')


def take_off(link: Link) -> None:
    """Take off in PX4's mode."""
    for _ in range(60):
        link.sitl.shell('commander', 'takeoff')
        if link.wait(lambda: link.armed, 2.0):
            break
    ground = link.height
    if not link.wait(lambda: link.height > ground + 2.5, 30.0):
        raise TimeoutError(f'PX4 does not take off: {link.sitl.folder}')
    link.fly(4.0)


def fly(to: Path, model: str, seed: int, options: argparse.Namespace) -> None:
    """Fly, and copy the log to a file."""
    random = np.random.default_rng(seed)
    given = dict(entry.split('=') for entry in options.px4_parameter)
    with TemporaryDirectory(prefix='px4_') as folder, Sitl(
        options.px4, model, Path(folder, 'sitl'), options.speed, options.nice,
        {**PARAMETERS, **given}, options.instance, [f'{topic} 0 0' for topic in TOPICS],
    ) as sitl:
        try:
            with Link(sitl) as link:
                link.fly(15.0)
                for i in range(FLIGHTS):
                    take_off(link)
                    (steps_of_velocity, steps_of_position, hold)[i % 3](link, random)
                    land(link, random)
                    link.fly(3.0)
        finally:
            sitl.log(to)


def main() -> None:
    """Fly the logs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--model', choices=('hex', 'quadx'), default='hex')
    parser.add_argument('--logs', type=int, default=1, help='number of logs')
    parser.add_argument('--first', type=int, default=1, help='number and seed of the first log')
    parser.add_argument('--px4-parameter', action='append', default=[], metavar='NAME=VALUE')
    options = parsed(parser, speed=5.0)
    for number in range(options.first, options.first + options.logs):
        name = f'{options.model}_{number}.ulg'
        fly(options.out / name, options.model, number, options)
        print(name, flush=True)


if __name__ == '__main__':
    main()
