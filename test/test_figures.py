"""Figures of flights."""

import numpy as np
import pytest
from matplotlib import image
from matplotlib.colors import to_rgb

from ca_ros.controller import Waypoint
from ca_ros.figures import COLORS, draw_flight
from ca_ros.flight import Flight
from strategies import FLEET

WAYPOINT = Waypoint.of(1.0, 1.0, 1.0, np.radians(45.0))


def some_flight(vehicle):
    """Return a flight on which each rotor turns at a speed of its own."""
    time = np.arange(101) * 0.01
    shares = np.linspace(0.2, 0.9, vehicle.n) * (1.0 - 0.1 * np.cos(time[:, None]))
    return Flight(
        time, np.outer(time, [1.0, 0.7, 0.4]), np.tile(WAYPOINT.attitude, (101, 1)),
        np.ones((101, 3)), np.zeros((101, 3)),
        vehicle.speed_min + shares * (vehicle.speed_max - vehicle.speed_min))


def pixels_of(picture, color):
    """Count the pixels of a color."""
    return int((np.abs(picture[..., :3] - to_rgb(color)) < 0.02).all(axis=-1).sum())


@pytest.mark.parametrize('name', ['quadrotor', 'x8'])
def test_a_flight_becomes_a_png_with_a_line_for_each_rotor(tmp_path, name):
    vehicle = FLEET[name]
    draw_flight(tmp_path / 'flight.png', some_flight(vehicle), vehicle, WAYPOINT)
    assert (tmp_path / 'flight.png').read_bytes().startswith(b'\x89PNG\r\n\x1a\n')
    picture = image.imread(tmp_path / 'flight.png')
    height, width = picture.shape[:2]
    assert height >= 1000
    assert width >= 1000
    for i, color in enumerate(COLORS):
        drawn = pixels_of(picture, color)
        assert (drawn > 500) == (i < max(vehicle.n, 3)), color
