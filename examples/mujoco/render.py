#!/usr/bin/env python3
"""Render a recorded flight with MuJoCo, also without a display.

    MUJOCO_GL=egl python3 examples/mujoco/render.py flight.csv --vehicle x8 --out flight.gif

`MUJOCO_GL=egl` needs libegl1, `MUJOCO_GL=osmesa` libosmesa6.  Blue arrows are thrusts; a rotor
that has stopped in flight is orange.  The sphere is where the flight ends.
"""

import argparse
import sys
from pathlib import Path

import mujoco
import numpy as np
from body import mjcf
from PIL import Image, ImageDraw

from ca_ros import ParameterError, Vehicle

SCENE = """
  <visual><headlight ambient="0.6 0.6 0.6" diffuse="0.3 0.3 0.3" specular="0 0 0"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="flat" rgb1="1 1 1" width="8" height="8"/>
    <texture name="floor" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0.85 0.85 0.85"
             width="100" height="100"/>
    <material name="floor" texture="floor" texrepeat="1 1" texuniform="true"/>
  </asset>
  <worldbody>
    <light directional="true" pos="0 0 6" dir="0 0 -1" diffuse="0.3 0.3 0.3" specular="0 0 0"/>
    <geom type="plane" pos="0 0 -0.4" size="0 0 0.1" material="floor"/>
    <geom type="sphere" size="0.04" pos="{end}" rgba="0.1 0.6 0.2 1"/>
  </worldbody>
</mujoco>
"""

SOUND, LOST, THRUST = (0.35, 0.35, 0.35, 1.0), (0.95, 0.45, 0.0, 1.0), (0.1, 0.35, 0.95, 1.0)

METRES_PER_NEWTON = 0.12

COLORS = 64


def add_arrow(scene: mujoco.MjvScene, start: np.ndarray, end: np.ndarray) -> None:
    """Add the arrow of a thrust to a scene."""
    geom = scene.geoms[scene.ngeom]
    kind = mujoco.mjtGeom.mjGEOM_ARROW
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(THRUST))
    mujoco.mjv_connector(geom, kind, 0.025, start, end)
    scene.ngeom += 1


def frames(flight: np.ndarray, vehicle: Vehicle, rate: float, size: tuple[int, int]):
    """Yield the pictures of a flight, `rate` per second."""
    end = ' '.join(str(flight[axis][-1]) for axis in 'xyz')
    scene = SCENE.format(end=end)
    model = mujoco.MjModel.from_xml_string(mjcf(vehicle).replace('</mujoco>', scene))
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = (0.6, 0.6, 0.5), 2.9
    camera.azimuth, camera.elevation = 160.0, -25.0
    renderer = mujoco.Renderer(model, size[1], size[0])
    state = np.column_stack([flight[name] for name in ('x', 'y', 'z', 'qw', 'qx', 'qy', 'qz')])
    speeds = np.column_stack([flight[f'speed_{i + 1}'] for i in range(vehicle.n)])
    turned = np.logical_or.accumulate(speeds != 0.0)
    for time in np.arange(0.0, flight['t'][-1] + 0.5 / rate, 1.0 / rate):
        k = np.abs(flight['t'] - time).argmin()
        data.qpos[:] = state[k]
        mujoco.mj_forward(model, data)
        lost = turned[k] & (speeds[k] == 0.0)
        for i in range(vehicle.n):
            model.geom(str(i)).rgba = LOST if lost[i] else SOUND
        renderer.update_scene(data, camera)
        for i, thrust in enumerate(vehicle.thrusts(speeds[k])):
            axis = data.body(1).xmat.reshape(3, 3) @ vehicle.rotor_axes[i]
            hub = data.site(str(i)).xpos
            if thrust:
                add_arrow(renderer.scene, hub, hub + METRES_PER_NEWTON * thrust * axis)
        picture = Image.fromarray(renderer.render())
        words = ''.join(f', rotor {i + 1} lost' for i in np.flatnonzero(lost))
        ImageDraw.Draw(picture).text((8, 6), f'{time:.1f} s{words}', fill='black', font_size=16)
        yield picture


def main() -> None:
    """Write the animation."""
    parser = argparse.ArgumentParser(description='Render a recorded flight with MuJoCo.')
    parser.add_argument('flight', type=Path, help='flight.csv of bringup')
    parser.add_argument('--vehicle', default='hexarotor', help='a shipped vehicle, or a file')
    parser.add_argument('--out', type=Path, default=Path('flight.gif'), help='GIF or PNG')
    parser.add_argument('--rate', type=float, default=12.5, help='pictures per second')
    parser.add_argument('--size', type=int, nargs=2, default=(480, 360), help='width and height')
    options = parser.parse_args()
    try:
        vehicle = Vehicle.load(options.vehicle)
        flight = np.genfromtxt(options.flight, delimiter=',', names=True)
        first, *others = frames(flight, vehicle, options.rate, options.size)
    except (OSError, ParameterError) as error:
        sys.exit(f'render: {error}')
    # One palette for all pictures, so that what does not move needs no space in the file.
    ends = Image.fromarray(np.hstack([first, others[-1]]))
    palette = ends.quantize(COLORS, Image.Quantize.MAXCOVERAGE)
    first, *others = (each.quantize(palette=palette, dither=0) for each in (first, *others))
    duration = round(1e3 / options.rate)
    first.save(options.out, save_all=True, append_images=others, loop=0, duration=duration)


if __name__ == '__main__':
    main()
