"""A trajectory: waypoints, each with the time of flight from which it counts."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from ca_ros.arrays import Array
from ca_ros.control.waypoint import Waypoint
from ca_ros.errors import message
from ca_ros.input_files import read_text
from ca_ros.settings import ParameterError

COLUMNS = ('t', 'x', 'y', 'z', 'heading')

QUATERNION = ('qx', 'qy', 'qz', 'qw')  # the columns of an attitude, which may replace the heading


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Waypoints in the order of their times.

    `times`: time of flight from which each waypoint counts, ascending from 0 [ns].
    """

    times: tuple[int, ...]
    waypoints: tuple[Waypoint, ...]

    @classmethod
    def to(cls, waypoint: Waypoint) -> Trajectory:
        """Return the trajectory that has a single waypoint."""
        return cls((0,), (waypoint,))

    @classmethod
    def read(cls, path: Path) -> Trajectory:
        """Read a CSV file with the columns t [s], x, y, z [m] and heading [rad].

        Without a heading, `QUATERNION` has the attitude, body to world.  Raises a ParameterError
        that names the file and the fault.
        """
        # Spreadsheets may begin a file with a byte order mark.
        text = StringIO(read_text(path, encoding='utf-8-sig', newline=''), newline='')
        try:
            rows = list(csv.DictReader(text, strict=True, skipinitialspace=True))
        except csv.Error as error:
            raise ParameterError(message(error, path)) from None
        posed = bool(rows) and 'heading' not in rows[0]
        names = (*COLUMNS[:4], *QUATERNION) if posed and 'qw' in rows[0] else COLUMNS
        try:
            table = np.array([[float(row[name]) for name in names] for row in rows])
        except (KeyError, TypeError, ValueError):
            raise ParameterError(
                f'{path}: expected a header and rows of numbers, {", ".join(names)}'
            ) from None
        if len(table) == 0 or not (np.isfinite(table).all() and np.abs(table).max() <= 1e6):
            raise ParameterError(f'{path}: expected at least one row, of numbers up to 1e6')
        times = np.round(table[:, 0] * 1e9).astype(int).tolist()
        if times[0] != 0 or sorted(set(times)) != times:
            raise ParameterError(f'{path}: expected times that begin at 0 and ascend')
        if names is COLUMNS:
            return cls(tuple(times), tuple(Waypoint.of(*row) for row in table[:, 1:].tolist()))
        sizes = np.linalg.norm(table[:, 4:], axis=1)
        if not sizes.all():
            raise ParameterError(f'{path}: expected attitudes other than 0, 0, 0, 0')
        attitudes = table[:, 4:] / sizes[:, None]
        return cls(tuple(times), tuple(map(Waypoint, table[:, 1:4], attitudes)))

    def __str__(self) -> str:
        """Return where the trajectory ends, in words."""
        x, y, z = self.last.position.tolist()
        end = f'({x:g}, {y:g}, {z:g}) m and a heading of {math.degrees(self.last.heading):.4g}°'
        return end if len(self.times) == 1 else f'{end}, by {len(self.times)} waypoints'

    @property
    def first(self) -> Waypoint:
        """The waypoint at the start."""
        return self.waypoints[0]

    @property
    def last(self) -> Waypoint:
        """The waypoint at the end."""
        return self.waypoints[-1]

    def at(self, time: int) -> Waypoint:
        """Return the waypoint that counts at a time of flight [ns]."""
        return self.waypoints[int(np.searchsorted(self.times, time, side='right')) - 1]

    def goals(self, time: Array) -> tuple[Array, Array]:
        """Return the wanted positions (K, 3) [m] and headings (K,) [rad] at times (K,) [s]."""
        due = [self.at(ns) for ns in np.round(time * 1e9).astype(int).tolist()]
        return np.array([each.position for each in due]), np.array([each.heading for each in due])
