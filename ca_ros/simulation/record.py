"""A recorded flight."""

import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ca_ros.arrays import Array
from ca_ros.control.waypoint import Waypoint
from ca_ros.vehicle.state import difference, euler_angles, heading, tilt


def steps(duration: float, time_step: float) -> int:
    """Return the number of whole steps [s] in a duration [s]."""
    return int(duration / time_step + 1e-6)


@dataclass(frozen=True, eq=False)
class Flight:
    """K samples of a vehicle's state and rotor speeds.

    - `time` (K,): [s]
    - `position` (K, 3): world frame [m]
    - `attitude` (K, 4): quaternions x, y, z, w, body to world
    - `velocity` and `angular_velocity` (K, 3): body frame [m/s, rad/s]
    - `speeds` (K, n): rotor speeds from each sample to the next [rad/s]
    - `angles` (K, k): the same of the angles of servos [rad]
    - `measured` (K, n): rotor speeds that were measured at the samples, NaN where none was
      [rad/s]; empty without measurements
    - `specific_force` (K, 3): the same of an accelerometer [m/s^2]
    """

    time: Array
    position: Array
    attitude: Array
    velocity: Array
    angular_velocity: Array
    speeds: Array
    angles: Array = field(default_factory=lambda: np.zeros((0, 0)))
    measured: Array = field(default_factory=lambda: np.zeros((0, 0)))
    specific_force: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        for name in ('angles', 'measured', 'specific_force'):
            object.__setattr__(self, name, getattr(self, name).reshape(len(self.time), -1))

    @property
    def euler(self) -> Array:
        """Roll, pitch, yaw (K, 3) [rad], see `ca_ros.vehicle.state.euler_angles`."""
        return euler_angles(self.attitude)

    @property
    def heading(self) -> Array:
        """Heading (K,) [rad], see `ca_ros.vehicle.state.heading`."""
        return heading(self.attitude)

    @property
    def tilt(self) -> Array:
        """Angle (K,) between the body's z axis and the vertical [rad]."""
        return tilt(self.attitude)

    def missing(self, duration: float) -> int:
        """Return how many samples a flight of this duration [s] lacks, given its shortest step."""
        step = float(np.diff(self.time).min(initial=np.inf))
        return steps(duration, step) + 1 - len(self.time)

    def position_error(self, waypoint: Waypoint) -> float:
        """Return the final distance to a waypoint [m]."""
        return float(np.linalg.norm(self.position[-1] - waypoint.position))

    def heading_error(self, waypoint: Waypoint) -> float:
        """Return the final angle between the heading and that of a waypoint [rad]."""
        return abs(float(difference(self.heading[-1], waypoint.heading)))

    def attitude_error(self, waypoint: Waypoint) -> float:
        """Return the final angle of the rotation to the attitude of a waypoint [rad]."""
        return 2.0 * float(np.arccos(min(1.0, abs(self.attitude[-1] @ waypoint.attitude))))

    def columns(self) -> dict[str, Array]:
        """Return the columns of `write_csv` by name, (K,) each.

        They include those of a `ca_ros.vehicle.formats.recording.Recording`.
        """
        def numbered(name: str, table: Array) -> tuple[str, ...]:
            return tuple(f'{name}_{i + 1}' for i in range(table.shape[1]))

        tables = {
            ('t',): self.time[:, None], ('x', 'y', 'z'): self.position,
            ('roll', 'pitch', 'yaw'): self.euler, numbered('speed', self.speeds): self.speeds,
            ('heading', 'tilt'): np.column_stack([self.heading, self.tilt]),
            ('qx', 'qy', 'qz', 'qw'): self.attitude,
            numbered('angle', self.angles): self.angles, ('vx', 'vy', 'vz'): self.velocity,
            ('gyro_x', 'gyro_y', 'gyro_z'): self.angular_velocity,
            numbered('command', self.speeds): self.speeds,
            numbered('speed_measured', self.measured): self.measured,
            ('acc_x', 'acc_y', 'acc_z')[: self.specific_force.shape[1]]: self.specific_force,
        }
        pairs = tables.items()
        return {name: table[:, i] for names, table in pairs for i, name in enumerate(names)}

    def write_csv(self, path: Path) -> None:
        """Write one row per sample in SI units (angles in rad), with all digits of each number."""
        columns = self.columns()
        with path.open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow(columns)
            writer.writerows(np.column_stack(list(columns.values())).tolist())
