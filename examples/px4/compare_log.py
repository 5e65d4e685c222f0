"""Reproduce the motors of a log of PX4: python compare_log.py sample_px4_events.ulg"""

import sys

import numpy as np
from pyulog import ULog

from ca_ros import Vehicle, make_allocator
from ca_ros.arrays import Array
from ca_ros.px4 import frames as px4
from ca_ros.px4.parameters import from_px4

log = ULog(sys.argv[1])
given = {name: value for name, value in log.initial_parameters.items() if name[:3] == 'CA_'}
with open('logged.yaml', 'w') as file:  # k_f = 1 kg m: thrusts are the shares in the log
    file.write(from_px4(given, mass=0.1, speeds=(0.0, 1.0), thrust_coefficient=1.0))
vehicle = Vehicle.load('logged.yaml')
allocator, unit = make_allocator('sequential_desaturation', vehicle), px4.units(vehicle)


def rows(topic: str, name: str, count: int) -> tuple[Array, Array]:
    data = log.get_dataset(topic).data
    return data['timestamp_sample'], np.column_stack([data[f'{name}[{i}]'] for i in range(count)])


sent, torques = rows('vehicle_torque_setpoint', 'xyz', 3)
_, thrusts = rows('vehicle_thrust_setpoint', 'xyz', 3)
answered, motors = rows('actuator_motors', 'control', 4)
at = np.searchsorted(sent, answered)
u = [px4.wrench(thrusts[i], torques[i], unit)[2:] for i in at]
print(np.abs(allocator.allocate_batch(np.array(u)).thrusts - motors).max(axis=1).max())
