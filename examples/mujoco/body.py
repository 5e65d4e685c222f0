"""A vehicle as a rigid body in MuJoCo."""

import mujoco
import numpy as np

from ca_ros import ParameterError, Vehicle
from ca_ros.simulation.rigid_body import CALM, RigidBody
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, POSITION, VELOCITY, rotation_matrix

MJCF = """
<mujoco>
  <option gravity="0 0 -{gravity}" integrator="RK4">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body gravcomp="{buoyancy}">
      <freejoint/>
      <inertial pos="0 0 0" quat="{principal}" mass="{mass}" diaginertia="{moments}"/>
      {rotors}
    </body>
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>
"""
"""The origin of the body is the centre of mass; its buoyancy is given as a share of its weight."""

ROTOR = """
      <site name="{i}" pos="{arm}"/>
      {tube}
      <geom name="{i}" type="cylinder" size="{radius} 0.004" pos="{arm}" zaxis="{axis}"/>"""

TUBE = '<geom type="capsule" size="0.01" fromto="0 0 0 {arm}" rgba="0.25 0.25 0.25 1"/>'

MOTOR = '<motor site="{i}" gear="{axis} {torque}"/>'
"""The gear is force [N/N] and torque [N m/N] per thrust, at the rotor."""


def mjcf(vehicle: Vehicle) -> str:
    """Return the MuJoCo model of a vehicle; the control of each actuator is a thrust [N]."""
    if vehicle.inertia is None:
        raise ParameterError('vehicle.inertia: missing')

    def text(numbers: object) -> str:
        return ' '.join(f'{number:.17g}' for number in np.ravel(numbers))

    # MuJoCo before 3.17 would find the principal axes to 1e-9 only.
    moments, axes = np.linalg.eigh(vehicle.inertia)
    axes[:, 2] *= np.linalg.det(axes)
    principal = np.zeros(4)
    mujoco.mju_mat2Quat(principal, axes.ravel())
    reaction = vehicle.spins * vehicle.torque_coefficient / vehicle.thrust_coefficient
    # For pictures only: without mass and contacts.
    radius = text(0.3 * np.linalg.norm(vehicle.arms, axis=1).mean())
    rotors = [
        {
            'i': i,
            'arm': text(arm),
            'axis': text(axis),
            'torque': text(share * axis),
            'tube': TUBE.format(arm=text(arm)) if arm.any() else '',
            'radius': radius,
        }
        for i, (arm, axis, share) in enumerate(
            zip(vehicle.arms, vehicle.rotor_axes, reaction, strict=True)
        )
    ]
    return MJCF.format(
        gravity=text(vehicle.gravity),
        buoyancy=text(vehicle.buoyancy / (vehicle.mass * vehicle.gravity)),
        mass=text(vehicle.mass),
        moments=text(moments),
        principal=text(principal),
        rotors=''.join(ROTOR.format(**rotor) for rotor in rotors),
        motors=''.join(MOTOR.format(**rotor) for rotor in rotors),
    )


class MujocoBody:
    """Moves a vehicle as `ca_ros.simulation.rigid_body.RigidBody` does, but by MuJoCo.

    Parameters
    ----------
    rigid : RigidBody
        Its vehicle and its drag are used, not its motion.

    Attributes
    ----------
    vehicle : Vehicle
    """

    def __init__(self, rigid: RigidBody) -> None:
        self.vehicle, self.drag = rigid.vehicle, rigid.drag
        self.model = mujoco.MjModel.from_xml_string(mjcf(rigid.vehicle))
        self.data = mujoco.MjData(self.model)

    def with_vehicle(self, vehicle: Vehicle) -> 'MujocoBody':
        """Return the body of another vehicle in the same air."""
        return MujocoBody(RigidBody(vehicle, self.drag))

    def set(self, state: np.ndarray, speeds: np.ndarray, wind: np.ndarray) -> None:
        """Give MuJoCo a state (13,), rotor speeds (n,) [rad/s] and the wind (3,) [m/s]."""
        data, omega = self.data, state[ANGULAR_VELOCITY]
        data.qpos[:] = *state[POSITION], *np.roll(state[ATTITUDE], 1)
        data.qvel[:] = *state[VELOCITY], *omega
        data.ctrl[:] = self.vehicle.thrusts(speeds)
        if self.drag is not None:
            rotation = rotation_matrix(state[ATTITUDE])
            airspeed = (state[VELOCITY] - wind) @ rotation
            force, torque = self.drag.wrench(self.vehicle, airspeed, omega, speeds)
            # The force is in the world frame, the torque in the body frame.
            data.qfrc_applied[:] = *(rotation @ force), *torque

    def step(
        self,
        state: np.ndarray,
        speeds: np.ndarray,
        time_step: float,
        wind: np.ndarray = CALM,
        integrate: object = None,
    ) -> np.ndarray:
        """Return the state after a step of RK4; the drag is held during the step.

        Raises
        ------
        FloatingPointError
            If MuJoCo warns, as it does before it resets a motion that diverges.
        """
        self.set(state, speeds, wind)
        self.model.opt.timestep = time_step
        mujoco.mj_step(self.model, self.data)
        if self.data.warning.number.any():
            self.data.warning.number[:] = 0
            raise FloatingPointError('the motion in MuJoCo diverges')
        qpos, qvel = self.data.qpos, self.data.qvel
        return np.concatenate([qpos[:3], qvel[:3], np.roll(qpos[3:], -1), qvel[3:]])
