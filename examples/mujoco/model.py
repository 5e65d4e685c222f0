"""The MuJoCo model of a vehicle."""

from __future__ import annotations

import numpy as np

from ca_ros import ParameterError, Vehicle

MJCF = """
<mujoco>
  <option timestep="{step}" gravity="0 0 -{gravity}" integrator="RK4">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body gravcomp="{buoyancy}">
      <freejoint/>
      <inertial pos="0 0 0" mass="{mass}" fullinertia="{inertia}"/>
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


def mjcf(vehicle: Vehicle, time_step: float) -> str:
    """Return the MuJoCo model of a vehicle; the control of each actuator is a thrust [N]."""
    if vehicle.inertia is None:
        raise ParameterError('vehicle.inertia: missing')

    def text(numbers: object) -> str:
        return ' '.join(f'{number:.17g}' for number in np.ravel(numbers))

    inertia = vehicle.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
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
        step=text(time_step),
        gravity=text(vehicle.gravity),
        buoyancy=text(vehicle.buoyancy / (vehicle.mass * vehicle.gravity)),
        mass=text(vehicle.mass),
        inertia=text(inertia),
        rotors=''.join(ROTOR.format(**rotor) for rotor in rotors),
        motors=''.join(MOTOR.format(**rotor) for rotor in rotors),
    )
