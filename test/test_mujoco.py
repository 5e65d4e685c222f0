"""The plant of examples/mujoco: it moves as our rigid body does, and flies with our nodes."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from ca_ros import Vehicle, make_allocator
from ca_ros.control.controller import Controller
from ca_ros.control.waypoint import Waypoint
from ca_ros.parameter_files import load
from ca_ros.simulation import closed_loop
from ca_ros.simulation.drag import Drag
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.simulation.record import Flight
from ca_ros.simulation.rigid_body import RigidBody, euler
from ca_ros.vehicle.files import shipped_vehicles
from ca_ros.vehicle.state import ATTITUDE, NULL_STATE
from nodes import ended, read
from strategies import FLEET, build, length, ring, rk4

mujoco = pytest.importorskip('mujoco')

FOLDER = Path(__file__).resolve().parent.parent / 'examples' / 'mujoco'
if not FOLDER.is_dir():
    pytest.skip('examples/ is not beside the tests', allow_module_level=True)

MujocoBody = runpy.run_path(str(FOLDER / 'body.py'))['MujocoBody']

SHIPPED = {name: Vehicle.load(path) for name, path in shipped_vehicles().items()}

FULL_INERTIA = build(ring(6), 'PNPNPN', {'vehicle.inertia': [
    0.015, 0.002, -0.001, 0.002, 0.018, 0.003, -0.001, 0.003, 0.025]})

CENTRAL = build([*ring(4), [0.0, 0.0, 0.0]], 'PNPNP')

VEHICLES = {
    **FLEET, **{f'shipped {name}': vehicle for name, vehicle in SHIPPED.items()},
    'full inertia': FULL_INERTIA, 'central rotor': CENTRAL}


@pytest.mark.parametrize('drag', [None, Drag(np.array([0.2, 0.3, 0.4]), 1e-4, 0.02)])
@pytest.mark.parametrize('name', VEHICLES)
def test_accelerations_are_those_of_the_rigid_body(name, drag):
    vehicle = VEHICLES[name]
    rigid = RigidBody(vehicle, drag)
    body = MujocoBody(rigid)
    rng = np.random.default_rng(0)
    for _ in range(10):
        state, wind = rng.normal(size=13), rng.normal(size=3)
        state[ATTITUDE] /= np.linalg.norm(state[ATTITUDE])
        speeds = rng.uniform(vehicle.speed_min, vehicle.speed_max)
        body.set(state, speeds, wind)
        mujoco.mj_forward(body.model, body.data)
        expected = rigid.derivative(state, speeds, wind)[[3, 4, 5, 10, 11, 12]]
        np.testing.assert_allclose(
            body.data.qacc, expected, rtol=0.0, atol=1e-12 * max(1.0, np.abs(expected).max()))


def test_a_motion_that_diverges_raises(tmp_path, monkeypatch):
    # MuJoCo writes its log there.
    monkeypatch.chdir(tmp_path)
    vehicle = SHIPPED['hexarotor']
    with pytest.raises(FloatingPointError, match='MuJoCo diverges'):
        MujocoBody(RigidBody(vehicle)).step(NULL_STATE, np.full(6, 1e9), 0.01)


def fly_offline(name, duration, kind=lambda rigid: rigid, integrate=euler):
    """Return a flight without ROS to the default waypoint; `kind` makes the body of a plant."""
    settings = load(name)
    vehicle, plant = Vehicle.load(name), settings.simulator
    plant = Plant(kind(body_of(vehicle, plant)), plant, integrate=integrate)
    return closed_loop.fly(
        Controller.from_settings(vehicle, settings), make_allocator('exact', vehicle), plant,
        Waypoint.of(1.0, 1.0, 1.0, np.radians(45.0)), duration)


# hexarotor_realistic has lag, gusts and noise, with which flights differ by more.
@pytest.mark.slow
@pytest.mark.parametrize(
    'name', length(['hexarotor'], sorted(SHIPPED.keys() - {'hexarotor_realistic'})))
def test_flights_differ_by_the_errors_of_the_integrators(name):
    flight = fly_offline(name, 12.0, MujocoBody)
    assert np.linalg.norm(flight.position[-1] - 1.0) < 1e-3
    euler_steps = fly_offline(name, 12.0)
    assert np.linalg.norm(euler_steps.position - flight.position, axis=1).max() < 8e-3
    rk4_steps = fly_offline(name, 12.0, integrate=rk4)
    assert np.linalg.norm(rk4_steps.position - flight.position, axis=1).max() < 1e-5


def fly(graph, folder, *arguments):
    """Fly for 12 s in lockstep with the plant in place of the simulator; return output, flight."""
    flight = graph.start(
        'bringup', '--figures', 'none',
        '--plant', f"'{sys.executable}' '{FOLDER / 'plant.py'}'", '--mode', 'lockstep',
        '--duration', '12', '--out', str(folder), *arguments)
    out, err = ended(graph, flight, 0)
    assert 'bringup: ' not in err
    return out, read(folder)


def distance(flight):
    """Return the distance from the waypoint at each sample [m]."""
    return np.linalg.norm(np.column_stack([flight[axis] for axis in 'xyz']) - 1.0, axis=1)


@pytest.mark.long
def test_the_hexarotor_loses_a_rotor_and_reaches_its_waypoint(graph, tmp_path):
    out, flight = fly(graph, tmp_path, '--fail', '1@2')
    assert 'rotor 1 lost; lost axes: yaw' in out
    assert distance(flight)[-1] < 1e-3
    # Announced 0.1 s after the loss.
    assert (flight['speed_1'][flight['t'] < 2.0995] >= 40.0).all()
    assert (flight['speed_1'][flight['t'] > 2.0995] == 0.0).all()
    assert flight['tilt'].max() > np.radians(5.0)


@pytest.mark.long
def test_a_flight_is_rendered_without_a_display(tmp_path):
    rest = np.zeros((2, 3))
    speeds = np.full((2, 6), 300.0)
    speeds[1, 0] = 0.0
    Flight(np.array([0.0, 0.1]), rest, np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)), rest, rest, speeds
           ).write_csv(tmp_path / 'flight.csv')
    run = subprocess.run(
        [sys.executable, str(FOLDER / 'render.py'), 'flight.csv', '--out', 'flight.gif'],
        cwd=tmp_path, capture_output=True, text=True, env=os.environ | {'MUJOCO_GL': 'egl'})
    if run.returncode and re.search('EGL|OpenGL', run.stderr):
        pytest.skip('no EGL on this machine')
    assert run.returncode == 0, run.stderr
    with Image.open(tmp_path / 'flight.gif') as animation:
        pictures = [
            np.array(each.convert('RGB'), dtype=int) for each in ImageSequence.Iterator(animation)]

    def count(color):
        """Return how many pixels of each picture have about this color."""
        return [(np.abs(picture - color).max(axis=-1) < 60).sum() for picture in pictures]

    blue, orange = count([25, 90, 240]), count([240, 115, 0])
    assert min(blue) > 200
    assert orange[0] == 0
    assert orange[1] > 200


# Gusts keep hexarotor_realistic away from the very waypoint.
@pytest.mark.long
@pytest.mark.parametrize('name', sorted(SHIPPED.keys() - {'hexarotor_realistic'}))
def test_each_shipped_vehicle_reaches_its_waypoint(graph, tmp_path, name):
    _, flight = fly(graph, tmp_path, '--vehicle', name)
    assert distance(flight)[-1] < 1e-3
