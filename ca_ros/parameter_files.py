"""The settings of the nodes, and all that a file may have."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

from ca_ros.allocation.settings import (
    AllocatedVehicleSettings,
    MethodSettings,
    VehicleAllocation,
    VehicleMethodSettings,
    own_methods,
    with_methods,
)
from ca_ros.control.controller_settings import ControlSettings
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.settings import (
    Numbers,
    ParameterError,
    Settings,
    check_given,
    group,
    read,
    setting,
    table,
    with_groups,
)
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.vehicle import files
from ca_ros.vehicle.settings import (
    MovingBodySettings,
    MovingVehicleSettings,
    RotorSettings,
    VehicleSettings,
)


@dataclass(frozen=True, kw_only=True)
class NodeSettings(Settings):
    """What all nodes of the loop have."""

    mode: Literal['realtime', 'lockstep'] = setting(
        'realtime',
        'realtime: the simulator follows the clock; lockstep: it steps once per command')
    command_timeout: float = setting(
        0.1, 'time without a valid command after which the timeout action begins', unit='s',
        positive=True, mutable=True, rebuild=False)
    command_frame: str = setting(
        'base_link',
        'frame_id of wrenches and body velocities; messages with another frame_id are dropped, '
        'those with an empty frame_id are used', mutable=True, rebuild=False)


@dataclass(frozen=True, kw_only=True)
class TimeoutSettings(Settings):
    """What a node does without commands."""

    timeout_action: Literal['idle', 'stop', 'hold'] = setting(
        'idle',
        'rotor speeds until commands return. idle: the speeds within the bounds that are nearest '
        'to zero; stop: zero; hold: the last speeds', mutable=True, rebuild=False)


@dataclass(frozen=True, kw_only=True)
class WorldSettings(Settings):
    """What nodes with poses have."""

    world_frame: str = setting(
        'map',
        'frame_id of poses and waypoints; messages with another frame_id are dropped, those with '
        'an empty frame_id are used', mutable=True, rebuild=False)


@dataclass(frozen=True, kw_only=True)
class SimulationSettings(PlantSettings):
    """The simulated vehicle, and the clock of its node."""

    real_time_factor: float = setting(
        1.0,
        'simulated time per second of real time, in mode realtime; at values other than 1, stamps '
        'deviate from the clock', unit='s/s', minimum=0.01, maximum=10.0)
    publish_clock: bool = setting(
        False, 'publish the simulated time on /clock, for nodes with use_sim_time')
    publish_odometry: bool = setting(
        False, 'publish pose and velocity also as one message on local_position/odometry')
    hold_at: float = setting(
        0.0,
        'simulated time at which the simulator waits in mode lockstep, until this parameter is '
        'set to a later time; 0: never', unit='s', minimum=0.0, mutable=True, rebuild=False)


@dataclass(frozen=True, kw_only=True)
class HealthSettings(Settings):
    """What nodes that heed the monitor have."""

    await_health: bool = setting(
        False, 'in mode lockstep, answer a state only with the rotor_health of its stamp')
    battery_timeout: float = setting(
        5.0, 'time without a sound voltage on battery after which a warning begins; the last one '
        'holds; 0: no warning. Only with rotors.speed_max_per_volt', unit='s', minimum=0.0,
        mutable=True, rebuild=False)


@dataclass(frozen=True, kw_only=True)
class CommandSettings(TimeoutSettings, NodeSettings):
    """Which wrenches an allocator serves."""

    command_age_max: float = setting(
        0.0,
        'greatest difference between the stamp of a wrench and ROS time; wrenches beyond it are '
        'dropped; 0: no limit', unit='s', minimum=0.0, mutable=True, rebuild=False)
    command_order: Literal['any', 'newer'] = setting(
        'any', 'wrenches whose stamps are out of order. any: serve them; newer: drop them',
        mutable=True, rebuild=False)


@dataclass(frozen=True, kw_only=True)
class AllocatorSettings(CommandSettings, HealthSettings, AllocatedVehicleSettings):
    """The settings of the allocator node."""

    publish_throttle: bool = setting(
        False, 'publish the throttles on command/throttle, see rotors.thrust_curve')
    publish_pwm: bool = setting(
        False, 'publish the pulse widths on command/pwm, see rotors.thrust_curve')


@dataclass(frozen=True, kw_only=True)
class ProblemSettings(CommandSettings):
    """The settings of the allocator node of a problem without a vehicle."""

    problem: str = setting(description='file of the problem, or the name of a shipped one')
    allocation: MethodSettings = group(with_methods(MethodSettings))


@dataclass(frozen=True, kw_only=True)
class ControllerNodeSettings(WorldSettings, HealthSettings, NodeSettings, ControlSettings):
    """The settings of the controller node."""


@dataclass(frozen=True, kw_only=True)
class SimulatorSettings(WorldSettings, TimeoutSettings, NodeSettings):
    """The settings of the simulator node."""

    vehicle: MovingBodySettings
    rotors: RotorSettings
    simulator: SimulationSettings


@dataclass(frozen=True, kw_only=True)
class MonitorSettings(WorldSettings, NodeSettings, MovingVehicleSettings):
    """The settings of the monitor node."""

    detector: DetectorSettings


@dataclass(frozen=True, kw_only=True)
class ViewerSettings(WorldSettings, NodeSettings, VehicleSettings):
    """The settings of the viewer node."""


@dataclass(frozen=True, kw_only=True)
class Px4Settings(Settings):
    """What ca_ros is to PX4, and what PX4 gets."""

    interface: Literal['mode', 'offboard', 'setpoints'] = setting(
        'mode',
        'what ca_ros is to PX4. mode: an external mode with a controller of yours; offboard: the '
        'same in offboard mode; setpoints: the allocator of its own loops, in simulation')
    simulation: bool = setting(
        False, 'whether PX4 flies in simulation; interface: setpoints is for nothing else')
    output: Literal['thrust', 'throttle'] = setting(
        'thrust',
        'what PX4 gets. thrust: the share of the greatest thrust, of which PX4 makes its output '
        'by THR_MDL_FAC; throttle: the control whose output is the throttle')
    order: Numbers = setting(
        0.0, "for each of PX4's motors the rotor that it is, from 1; 0: the same order",
        minimum=0.0)
    thrust_factor: float = setting(
        0.0, 'THR_MDL_FAC as it is set in PX4, for output: throttle', minimum=0.0, maximum=1.0)


@dataclass(frozen=True, kw_only=True)
class Px4NodeSettings(WorldSettings, NodeSettings, VehicleSettings):
    """The settings of the bridge to PX4."""

    px4: Px4Settings = Px4Settings()


@dataclass(frozen=True, kw_only=True)
class FileSettings(WorldSettings, AllocatorSettings, ControlSettings):
    """All settings that the file of a vehicle may have."""

    vehicle: MovingBodySettings
    allocation: VehicleMethodSettings = group(VehicleAllocation)
    simulator: SimulationSettings
    detector: DetectorSettings
    px4: Px4Settings = Px4Settings()


DECLARED: dict[str, type[NodeSettings]] = {
    'allocator': AllocatorSettings, 'controller': ControllerNodeSettings,
    'simulator': SimulatorSettings,
}
"""The settings of each node, by the name of the node."""

K = TypeVar('K', bound=Settings)


def with_own_methods(kind: type[K], *methods: str) -> type[K]:
    """Return a class of settings that also has those of methods ``module:Class``, if it has any.

    Raises a ParameterError if there is no such class.
    """
    if 'allocation.method' not in table(kind) or not (own := own_methods(*methods)):
        return kind
    groups = {'allocation': with_methods(VehicleMethodSettings, own)}
    return with_groups(kind, groups, (with_own_methods, (kind, *own)))


def load(vehicle: str | Path, node: str | None = None) -> FileSettings:
    """Read and check the parameter file of a vehicle; see `load_for`."""
    return load_for(FileSettings, vehicle, node)


def load_for(kind: type[K], vehicle: str | Path, node: str | None = None) -> K:
    """Return the settings of a class, and of one's own method, in a file; check the others, too.

    `vehicle` and `node` are those of `ca_ros.vehicle.files.read`.  Raises a ParameterError that
    names the file, the setting and the fault.
    """
    given = files.read(vehicle, node)
    try:
        method = str(given.get('allocation.method'))
        check_given(given, table(with_own_methods(FileSettings, method)))
        return read(with_own_methods(kind, method), given)
    except ParameterError as error:
        raise ParameterError(f'{files.find(vehicle)}: {error}') from None
