"""Landings on the contacts of MuJoCo: rotors, air, sensors and controller of `plant.c`."""

import ctypes
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks.detection.plant import FEET_ANGLE, PERIOD, ROW, STEP, Plant, Rows

mujoco: Any = import_module('mujoco')

MJCF = """
<mujoco>
  <option gravity="0 0 -{gravity}" timestep="{step}" integrator="implicitfast" cone="elliptic"/>
  <default><geom friction="{friction} 0.005 0.0001" solref="{stiffness} {damping}"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body pos="0 0 {height}">
      <freejoint/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia}"/>
      {feet}
    </body>
  </worldbody>
</mujoco>
"""
"""The origin of the body is the centre of mass."""

FOOT = '<geom type="sphere" size="0.01" pos="{x:.9f} {y:.9f} {z:.9f}"/>'


def mjcf(vehicle: Any, truth: Any) -> str:
    """Return the MuJoCo model of what the plant is told: believed vehicle and truth.

    The sink of the legs becomes the time constant of the contact.  Raises a ValueError for a
    payload, whose loss would change the model.
    """
    if truth.payload > 0.0:
        raise ValueError('the body in MuJoCo carries no payload')
    centre = np.array(truth.centre)
    angles = FEET_ANGLE + np.pi / 2.0 * np.arange(4)
    ring = vehicle.foot * np.column_stack([np.cos(angles), np.sin(angles)])
    low = 0.01 - vehicle.height - np.array(truth.uneven)
    places = np.column_stack([ring, low]) - centre
    return MJCF.format(
        gravity=vehicle.gravity, step=STEP, friction=truth.friction, damping=truth.damping,
        stiffness=max(np.sqrt(truth.sink / vehicle.gravity), 2.0 * STEP),
        height=vehicle.height + centre[2], mass=vehicle.mass * truth.mass_factor,
        inertia=' '.join(map(str, vehicle.inertia)),
        feet=''.join(FOOT.format(x=x, y=y, z=z) for x, y, z in places))


class MujocoPlant(Plant):
    """A `Plant` whose body and feet are moved by MuJoCo."""

    def __init__(self, vehicle: Any, truth: Any, mission: Any, seed: int) -> None:
        super().__init__(vehicle, truth, mission, seed)
        self.model = mujoco.MjModel.from_xml_string(mjcf(vehicle, truth))
        self.model.body_inertia[1] *= np.array(truth.inertia_factor)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)
        self._arrays = np.zeros(6), np.zeros(13), np.zeros(6)
        self._places = [each.ctypes.data_as(ctypes.c_void_p) for each in self._arrays]

    def fly(self, duration: float) -> Rows:
        """As `Plant.fly`."""
        rows = np.zeros(round(duration / PERIOD), ROW)
        answer, send = self._library.plant_answer, self._library.plant_send
        place, commands = rows.ctypes.data, rows['command'].ctypes.data - rows.ctypes.data
        for i in range(len(rows)):
            row = place + i * ROW.itemsize
            answer(self._memory, ctypes.c_void_p(row))
            for _ in range(send(self._memory, ctypes.c_void_p(row + commands))):
                self._step()
            _, x, y, _ = self.data.qpos[3:]
            if 1.0 - 2.0 * (x * x + y * y) < -0.2:
                return rows[:i + 1]
        return rows

    def _step(self) -> None:
        (wrench, state, accelerations), data = self._arrays, self.data
        self._library.plant_forces(self._memory, self._places[0])
        # Of a free joint the force is in the world frame, the torque in that of the body.
        data.qfrc_applied[:] = wrench
        mujoco.mj_step(self.model, data)
        accelerations[:] = data.qacc
        state[:3], state[3:6] = data.qpos[:3], data.qvel[:3]
        state[6:9], state[9], state[10:] = data.qpos[4:], data.qpos[3], data.qvel[3:]
        self._library.plant_place(
            self._memory, *self._places[1:], ctypes.c_double(data.ncon))
