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

from ca_ros import Vehicle
from ca_ros.flight.record import Flight
from ca_ros.flight.rigid_body import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    NULL_STATE,
    POSITION,
    VELOCITY,
    RigidBody,
)
from ca_ros.vehicle.files import shipped_vehicles
from strategies import FLEET, build, ring
from test_bringup import read

mujoco = pytest.importorskip('mujoco')

FOLDER = Path(__file__).resolve().parent.parent / 'examples' / 'mujoco'
if not FOLDER.is_dir():
    pytest.skip('examples/ is not beside the tests', allow_module_level=True)

mjcf = runpy.run_path(str(FOLDER / 'model.py'))['mjcf']

SHIPPED = {name: Vehicle.load(path) for name, path in shipped_vehicles().items()}

FULL_INERTIA = build(ring(6), 'PNPNPN', {'vehicle.inertia': [
    0.015, 0.002, -0.001, 0.002, 0.018, 0.003, -0.001, 0.003, 0.025]})

CENTRAL = build([*ring(4), [0.0, 0.0, 0.0]], 'PNPNP')

VEHICLES = {
    **FLEET, **{f'shipped {name}': vehicle for name, vehicle in SHIPPED.items()},
    'full inertia': FULL_INERTIA, 'central rotor': CENTRAL}


def model_and_data(vehicle, time_step=0.01):
    """Return the MuJoCo model of a vehicle, and its state."""
    model = mujoco.MjModel.from_xml_string(mjcf(vehicle, time_step))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize('name', VEHICLES)
def test_accelerations_are_those_of_the_rigid_body(name):
    vehicle = VEHICLES[name]
    body, (model, data) = RigidBody(vehicle), model_and_data(vehicle)
    rng = np.random.default_rng(0)
    for _ in range(20):
        state = rng.normal(size=13)
        state[ATTITUDE] /= np.linalg.norm(state[ATTITUDE])
        speeds = rng.uniform(vehicle.speed_min, vehicle.speed_max)
        data.qpos[:] = *state[POSITION], *np.roll(state[ATTITUDE], 1)
        data.qvel[:] = *state[VELOCITY], *state[ANGULAR_VELOCITY]
        data.ctrl[:] = vehicle.thrusts(speeds)
        mujoco.mj_forward(model, data)
        expected = body.derivative(state, speeds)[[3, 4, 5, 10, 11, 12]]
        np.testing.assert_allclose(
            data.qacc, expected, rtol=0.0, atol=1e-12 * max(1.0, np.abs(expected).max()))


def test_euler_steps_converge_to_its_motion_with_order_one():
    vehicle, rng = SHIPPED['hexarotor_tilted'], np.random.default_rng(1)
    commands = rng.uniform(250.0, 280.0, (50, 6))
    model, data = model_and_data(vehicle)
    for speeds in commands:
        data.ctrl[:] = vehicle.thrusts(speeds)
        mujoco.mj_step(model, data)
    body, errors = RigidBody(vehicle), []
    for steps in (4, 8, 16):
        state = NULL_STATE
        for speeds in commands:
            for _ in range(steps):
                state = body.step(state, speeds, 0.01 / steps)
        errors.append([
            np.linalg.norm(state[POSITION] - data.qpos[:3]),
            np.linalg.norm(state[ATTITUDE] - np.roll(data.qpos[3:], -1))])
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 2.0, rtol=0.05)


def fly(graph, folder, *arguments):
    """Fly for 12 s in lockstep with the plant in place of the simulator; return output, flight."""
    flight = graph.start_silent(
        'bringup', '--plant', f"'{sys.executable}' '{FOLDER / 'plant.py'}'", '--mode', 'lockstep',
        '--duration', '12', '--out', str(folder), *arguments)
    out, err = graph.outlive(flight)
    assert flight.returncode == 0, out + err
    assert 'bringup: ' not in err
    return out, read(folder)


def distance(flight):
    """Return the distance from the waypoint at each sample [m]."""
    return np.linalg.norm(np.column_stack([flight[axis] for axis in 'xyz']) - 1.0, axis=1)


def test_the_hexarotor_loses_a_rotor_and_reaches_its_waypoint(graph, tmp_path):
    out, flight = fly(graph, tmp_path, '--fail', '1@2')
    assert 'rotor 1 lost; lost axes: yaw' in out
    assert distance(flight)[-1] < 1e-3
    # Announced 0.1 s after the loss.
    assert (flight['speed_1'][flight['t'] < 2.0995] >= 40.0).all()
    assert (flight['speed_1'][flight['t'] > 2.0995] == 0.0).all()
    assert flight['tilt'].max() > np.radians(5.0)


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


@pytest.mark.skipif('CA_ROS_LONG' not in os.environ, reason='a minute; CA_ROS_LONG=1 runs it')
@pytest.mark.parametrize('name', SHIPPED)
def test_each_shipped_vehicle_reaches_its_waypoint_faster_than_in_real_time(graph, tmp_path, name):
    out, flight = fly(graph, tmp_path, '--vehicle', name)
    assert distance(flight)[-1] < 1e-3
    wall = float(out.partition(' samples, in ')[2].partition(' s)')[0])
    assert wall < flight['t'][-1]
