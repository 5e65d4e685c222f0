"""Plots of flights: their content, and their files."""

import argparse
import time
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import image
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ca_ros import Vehicle
from ca_ros.bringup.report import draw_flight
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.figures import COLORS, FORMATS, formats, millimetres, rotor_lines, save
from ca_ros.simulation.record import Flight
from strategies import FLEET, length

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


@pytest.mark.slow
@pytest.mark.parametrize('name', length(['quadrotor'], ['quadrotor', 'x8']))
def test_a_flight_becomes_a_png_with_a_line_for_each_rotor(tmp_path, name):
    vehicle = FLEET[name]
    figure = draw_flight(some_flight(vehicle), vehicle, Trajectory.to(WAYPOINT))
    save(figure, tmp_path / 'flight', ['png'])
    assert (tmp_path / 'flight.png').read_bytes().startswith(b'\x89PNG\r\n\x1a\n')
    picture = image.imread(tmp_path / 'flight.png')
    height, width = picture.shape[:2]
    assert height >= 1000
    assert width >= 1000
    for i, color in enumerate(COLORS):
        drawn = pixels_of(picture, color)
        assert (drawn > 500) == (i < max(vehicle.n, 3)), color


@pytest.mark.parametrize(
    ('name', 'rings'), [('hexarotor_tilting', 1), ('omnidirectional_gimbals', 2)])
def test_a_flight_has_a_line_for_each_servo_in_the_colour_of_its_rotor(name, rings):
    vehicle = Vehicle.load(name)
    flight = replace(some_flight(vehicle), angles=np.zeros((101, rings * vehicle.n)))
    figure = draw_flight(flight, vehicle, Trajectory.to(WAYPOINT))
    *_, speeds, angles = figure.subfigs[0].axes if figure.subfigs else figure.axes
    rotors = [drawn.get_color() for drawn in speeds.lines[:vehicle.n]]
    servos = angles.lines[:rings * vehicle.n]
    assert [drawn.get_color() for drawn in servos] == np.repeat(rotors, rings).tolist()
    assert len({drawn.get_linestyle() for drawn in servos}) == rings


def test_twelve_rotors_have_twelve_colours():
    assert len({look['color'] for look in rotor_lines(12).values()}) == 12


@pytest.mark.slow
def test_a_plot_is_the_same_file_each_time(tmp_path, monkeypatch):
    written = []
    for day, folder in enumerate([tmp_path / 'a', tmp_path / 'b']):
        folder.mkdir()
        # What matplotlib would take for the date of the file.
        monkeypatch.setenv('SOURCE_DATE_EPOCH', str(day * 86_400 + int(time.time())))
        figure = Figure()
        axes = figure.add_subplot(xlabel='$t$ [s]')
        axes.fill_between(np.arange(3), np.arange(3), alpha=0.5)
        files = save(figure, folder / 'flight', list(FORMATS))
        assert [file.name for file in files] == ['flight.png', 'flight.svg', 'flight.pdf']
        written.append([file.read_bytes() for file in files])
    assert written[0] == written[1]
    _, svg, pdf = written[0]
    assert ElementTree.fromstring(svg).tag == '{http://www.w3.org/2000/svg}svg'
    assert pdf.startswith(b'%PDF-')
    assert b'/FontFile2' in pdf
    assert b'/Type3' not in pdf


def test_formats_are_a_list_of_known_ones():
    assert formats('none') == ()
    assert formats('svg, png,svg') == ('svg', 'png')
    for wrong in ('', 'gif', 'png,'):
        with pytest.raises(argparse.ArgumentTypeError, match='png, svg, pdf'):
            formats(wrong)


def test_a_width_is_a_name_or_millimetres():
    assert [millimetres(text) for text in ('column', 'page', '120.5')] == [88.0, 181.0, 120.5]
    for wrong in ('', 'wide', '79', '501', 'nan', '-100'):
        with pytest.raises(argparse.ArgumentTypeError, match='column, page or 80 to 500 mm'):
            millimetres(wrong)
