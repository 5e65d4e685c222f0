"""The parameters of the nodes, the table that each node declares, and all that a file may have."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ca_ros.allocation.parameters import ALLOCATION, PRIORITIES, own_parameters
from ca_ros.flight import parameters as flight
from ca_ros.schema import Parameter, ParameterError, Value, check_given, complete
from ca_ros.vehicle.files import find, read
from ca_ros.vehicle.parameters import ALLOCATED, SIMULATED, VEHICLE

NODE = {
    'mode': Parameter(
        'realtime: the simulator follows the clock; lockstep: it steps once per command',
        str,
        default='realtime',
        choices=('realtime', 'lockstep'),
    ),
    'command_timeout': Parameter(
        'time without a valid command after which the timeout action begins [s]',
        default=0.1,
        positive=True,
        mutable=True,
    ),
    'timeout_action': Parameter(
        'rotor speeds until commands return. idle: the speeds within the bounds that are nearest '
        'to zero; stop: zero; hold: the last speeds',
        str,
        default='idle',
        choices=('idle', 'stop', 'hold'),
        mutable=True,
    ),
    'command_frame': Parameter(
        'frame_id of wrenches and body velocities; messages with another frame_id are dropped, '
        'those with an empty frame_id are used',
        str,
        default='base_link',
        mutable=True,
    ),
    'world_frame': Parameter(
        'frame_id of poses and waypoints; messages with another frame_id are dropped, those '
        'with an empty frame_id are used',
        str,
        default='map',
        mutable=True,
    ),
    'command_age_max': Parameter(
        'greatest difference between the stamp of a wrench and ROS time; wrenches beyond it are '
        'dropped; 0: no limit [s]',
        default=0.0,
        minimum=0.0,
        mutable=True,
    ),
    'command_order': Parameter(
        'wrenches whose stamps are out of order. any: serve them; newer: drop them',
        str,
        default='any',
        choices=('any', 'newer'),
        mutable=True,
    ),
    'simulator.real_time_factor': Parameter(
        'simulated time per second of real time, in mode realtime; at values other than 1, stamps '
        'deviate from the clock [s/s]',
        default=1.0,
        minimum=0.01,
        maximum=10.0,
    ),
    'simulator.publish_clock': Parameter(
        'enabled: publish the simulated time on /clock, for nodes with use_sim_time',
        str,
        default='disabled',
        choices=('disabled', 'enabled'),
    ),
    'simulator.publish_odometry': Parameter(
        'enabled: publish pose and velocity also as one message on local_position/odometry',
        str,
        default='disabled',
        choices=('disabled', 'enabled'),
    ),
    'simulator.hold_at': Parameter(
        'simulated time at which the simulator waits in mode lockstep, until this parameter is '
        'set to a later time; 0: never [s]',
        default=0.0,
        minimum=0.0,
        mutable=True,
    ),
}
"""The parameters of the nodes alone; a change of these does not rebuild an allocator."""

PARAMETERS = {**VEHICLE, **ALLOCATION, **flight.CONTROL, **flight.SIMULATION, **NODE}
"""All parameters that the file of a vehicle may have."""


def _node(*names: str) -> dict[str, Parameter]:
    return {name: NODE[name] for name in ('mode', 'command_timeout', 'command_frame', *names)}


ALLOCATOR = {
    **ALLOCATED,
    **ALLOCATION,
    **_node('timeout_action', 'command_age_max', 'command_order'),
}

CONTROLLER = {**VEHICLE, **PRIORITIES, **flight.CONTROL, **_node('world_frame')}

SIMULATOR = {
    **SIMULATED,
    **flight.SIMULATION,
    **_node('timeout_action', 'world_frame'),
    **{name: NODE[name] for name in NODE if name.startswith('simulator.')},
}

DECLARED = {'allocator': ALLOCATOR, 'controller': CONTROLLER, 'simulator': SIMULATOR}
"""The parameters that each node declares, by the name of the node."""


def load(
    vehicle: str | Path, node: str | None = None, table: Mapping[str, Parameter] = PARAMETERS
) -> dict[str, Value]:
    """Read and check the parameter file of a vehicle.

    Parameters
    ----------
    vehicle, node
        As in `ca_ros.vehicle.files.read`.
    table : mapping, optional
        The parameters to return; the others in the file are checked, too.

    Returns
    -------
    dict
        A value for each name in `table`; with ``allocation.method``, also for the parameters of
        one's own method.

    Raises
    ------
    ParameterError
        As in `read`, or if a name or a value is wrong; the message names the file, the key and the
        fault.
    """
    given = read(vehicle, node)
    try:
        own = own_parameters(given.get('allocation.method'))
        check_given(given, {**PARAMETERS, **own})
        if 'allocation.method' in table:
            table = {**table, **own}
        return complete(given, table)
    except ParameterError as error:
        raise ParameterError(f'{find(vehicle)}: {error}') from None
