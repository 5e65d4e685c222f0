"""crazyflow 0.4.0 with its Mellinger controller: its own mixing beside `exact`.

    pip install crazyflow==0.4.0
    python examples/crazyflow/flights.py

flies ten upsets, and each rotor weakened to 60 % in a climb, of two Crazyflies; none can hover on
two rotors, so a lost one ends each flight.  The controller mixes and clips inside; here its limits
are lifted, so that the allocator gets the wrench before any clip.
"""

from functools import partial

import numpy as np
from crazyflow.control.core import load_fn_params
from crazyflow.control.mellinger import control
from crazyflow.control.transform import motor_force2rotor_vel
from crazyflow.drones import Drone
from crazyflow.dynamics.core import load_fn_params as load_dynamics
from crazyflow.dynamics.first_principles.dynamics import dynamics
from scipy.spatial.transform import Rotation

from ca_ros import Exact, Vehicle
from ca_ros.arrays import Array

STEP, DURATION, OUTER = 0.002, 6.0, 5  # [s]; the position is controlled every fifth step
FAILURE, TOLD = 1.0, 1.1  # when a rotor gets weak, and when the allocator is told [s]
WEAK = 0.6  # thrust that it keeps
K_F = 1e-8  # the allocator's thrusts count, so k_f is arbitrary [kg m]
LIFTED = 1e3  # factor of the controller's limits
CONTROL = (
    control.state2attitude, control.attitude2force_torque, control.force_torque2rotor_vel)


def vehicle_of(plant: dict[str, Array], limits: dict[str, Array]) -> Vehicle:
    """Return the vehicle of crazyflow's parameters."""
    mixing, arm = np.asarray(plant['mixing_matrix']), float(np.ravel(plant['L'])[0])
    return Vehicle(
        mass=float(plant['mass']), thrust_coefficient=K_F,
        torque_coefficient=K_F * float(limits['thrust2torque']),
        positions=np.column_stack([-arm * mixing[1], arm * mixing[0], np.zeros(4)]),
        spins=['cw' if sense > 0 else 'ccw' for sense in mixing[2]],
        speed_min=float(np.sqrt(limits['thrust_min'] / K_F)),
        speed_max=float(np.sqrt(limits['thrust_max'] / K_F)))


def fly(drone: Drone, seed: int, exact: bool, weak: int | None = None) -> float:
    """Return the greatest distance to the start in the last second [m]."""
    rng = np.random.default_rng(seed)
    limits, given, mixing = (load_fn_params(function, drone) for function in CONTROL)
    outer, mix = partial(CONTROL[0], **limits), partial(CONTROL[2], **mixing)
    if exact:
        given |= {'thrust_max': LIFTED * given['thrust_max'], 'pwm_max': LIFTED * given['pwm_max'],
                  'pwm_min': -LIFTED * given['pwm_max'], 'torque_pwm_max': np.full(3, np.inf)}
    inner = partial(CONTROL[1], **given)
    plant = load_dynamics(dynamics, drone)
    curve, drag = (np.tile(plant[name], (4, 1)) for name in ('rpm2thrust', 'rpm2torque'))
    allocator, hover = Exact(vehicle_of(plant, mixing)), float(plant['mass']) * 9.81 / 4.0
    rotors = motor_force2rotor_vel(np.full(4, hover), plant['rpm2thrust'])
    position, velocity, rates = np.zeros(3), np.zeros(3), np.zeros(3)
    turn = Rotation.identity()
    if weak is None:
        way, tilt = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(60.0, 170.0))
        turn = Rotation.from_rotvec(tilt * np.array([np.cos(way), np.sin(way), 0.0]))
        rates = rng.uniform(-1.0, 1.0, 3) * [8.0, 8.0, 3.0]
    goal = np.zeros(16)
    goal[[2, 12]] = 0.0 if weak is None else 1.0, 1.0
    wanted, sums, turned, before, away = np.zeros(4), None, None, rates, 0.0
    for step in range(round(DURATION / STEP)):
        if weak is not None and step == round(FAILURE / STEP):
            curve[weak] *= WEAK
            drag[weak] *= WEAK
        if weak is not None and step == round(TOLD / STEP):
            allocator = allocator.with_health(1.0 - (1.0 - WEAK) * np.eye(4)[weak])
        if step % OUTER == 0:
            wanted, sums = outer(position, turn.as_quat(), velocity, goal, sums)
        force, torque, turned = inner(turn.as_quat(), rates, wanted, before, turned)
        before = rates
        if exact:
            speeds = allocator.allocate([*force, *torque]).speeds
            command = motor_force2rotor_vel(K_F * speeds**2, plant['rpm2thrust'])
        else:
            command = mix(force, torque)
        _, _, gained, turning, spin = dynamics(
            position, turn.as_quat(), velocity, rates, command, rotors,
            **plant | {'rpm2thrust': curve, 'rpm2torque': drag})
        velocity = velocity + STEP * gained
        rates = rates + STEP * turning
        position, rotors = position + STEP * velocity, rotors + STEP * spin
        turn = turn * Rotation.from_rotvec(STEP * rates)
        if step * STEP > DURATION - 1.0:
            away = max(away, float(np.linalg.norm(position - goal[:3])))
    return away


if __name__ == '__main__':
    for drone in (Drone.cf2x_L250, Drone.cf2x_T350):
        for exact, name in ((False, "crazyflow's own mixing"), (True, 'exact')):
            upsets = [fly(drone, seed, exact) < 0.5 for seed in range(10)]
            weak = [fly(drone, 0, exact, rotor) < 0.5 for rotor in range(4)]
            print(f'{drone}, {name}: {sum(upsets)} of 10 upsets, {sum(weak)} of 4 weak rotors')
