"""The settings of the nodes, and all that the parameter file of a vehicle may have.

Each class lists what its node has; what several nodes have is declared once.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar

from ca_ros.allocation.settings import AllocationSettings, MethodSettings, own_methods
from ca_ros.control.controller_settings import ControllerSettings, check_attitude
from ca_ros.detection.detector_settings import DetectorSettings, ImuSettings
from ca_ros.problem.prioritization import PrioritizedAxesSettings
from ca_ros.setting_names import check_given
from ca_ros.settings import Numbers, ParameterError, Settings, read, setting, table
from ca_ros.simulation.plant_settings import PlantRotorSettings, PlantSettings
from ca_ros.vehicle import files
from ca_ros.vehicle.settings import AxesSettings, BodySettings, MovingBodySettings, RotorSettings

WORLD_FRAME = partial(
    setting, 'map',
    'frame_id of poses and waypoints; messages with another frame_id are dropped, those with an '
    'empty frame_id are used', mutable=True)

TIMEOUT_ACTION = partial(
    setting, 'idle',
    'rotor speeds until commands return. idle: the speeds within the bounds that are nearest to '
    'zero; stop: zero; hold: the last speeds', choices=['idle', 'stop', 'hold'], mutable=True)

COMMAND_AGE_MAX = partial(
    setting, 0.0,
    'greatest difference between the stamp of a wrench and ROS time; wrenches beyond it are '
    'dropped; 0: no limit', unit='s', minimum=0.0, mutable=True)

AWAIT_HEALTH = partial(
    setting, False, 'in mode lockstep, answer a state only with the rotor_health of its stamp')


@dataclass(frozen=True, kw_only=True)
class SimulationSettings(PlantSettings):
    """The simulated vehicle, and the clock of its node."""

    real_time_factor: float = setting(
        1.0,
        'simulated time per second of real time, in mode realtime; at values other than 1, stamps '
        'deviate from the clock', unit='s/s', minimum=0.01, maximum=10.0)
    publish_clock: bool = setting(
        False, 'publish the simulated time on /clock, for nodes with use_sim_time')


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
class NodeSettings(Settings):
    """What all nodes of the loop have."""

    mode: Literal['realtime', 'lockstep'] = setting(
        'realtime',
        'realtime: the simulator follows the clock; lockstep: it steps once per command')
    command_timeout: float = setting(
        0.1, 'time without a valid command after which the timeout action begins', unit='s',
        positive=True, mutable=True)
    command_frame: str = setting(
        'base_link',
        'frame_id of wrenches and body velocities; messages with another frame_id are dropped, '
        'those with an empty frame_id are used', mutable=True)


@dataclass(frozen=True, kw_only=True)
class AllocatorSettings(NodeSettings):
    """The settings of the allocator node."""

    vehicle: BodySettings
    rotors: RotorSettings
    allocation: AllocationSettings
    await_health: bool = AWAIT_HEALTH()
    timeout_action: str = TIMEOUT_ACTION()
    command_age_max: float = COMMAND_AGE_MAX()


@dataclass(frozen=True, kw_only=True)
class ProblemSettings(NodeSettings):
    """The settings of the allocator node of a problem without a vehicle."""

    problem: str = setting(description='file of the problem, or the name of a shipped one')
    allocation: MethodSettings
    timeout_action: str = TIMEOUT_ACTION()
    command_age_max: float = COMMAND_AGE_MAX()


@dataclass(frozen=True, kw_only=True)
class ControllerNodeSettings(NodeSettings):
    """The settings of the controller node."""

    vehicle: MovingBodySettings
    rotors: RotorSettings
    allocation: PrioritizedAxesSettings
    controller: ControllerSettings
    await_health: bool = AWAIT_HEALTH()
    world_frame: str = WORLD_FRAME()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_attitude(self.controller, self.allocation.axes)


@dataclass(frozen=True, kw_only=True)
class SimulatorSettings(NodeSettings):
    """The settings of the simulator node."""

    vehicle: MovingBodySettings
    rotors: PlantRotorSettings
    simulator: SimulationSettings
    detector: ImuSettings
    timeout_action: str = TIMEOUT_ACTION()
    world_frame: str = WORLD_FRAME()


@dataclass(frozen=True, kw_only=True)
class MonitorSettings(NodeSettings):
    """The settings of the monitor node."""

    vehicle: MovingBodySettings
    rotors: RotorSettings
    allocation: AxesSettings
    detector: DetectorSettings
    world_frame: str = WORLD_FRAME()


@dataclass(frozen=True, kw_only=True)
class ViewerSettings(NodeSettings):
    """The settings of the viewer node."""

    vehicle: BodySettings
    rotors: RotorSettings
    allocation: AxesSettings
    world_frame: str = WORLD_FRAME()


@dataclass(frozen=True, kw_only=True)
class Px4NodeSettings(NodeSettings):
    """The settings of the bridge to PX4."""

    vehicle: BodySettings
    rotors: RotorSettings
    allocation: AxesSettings
    px4: Px4Settings = Px4Settings()
    world_frame: str = WORLD_FRAME()


@dataclass(frozen=True, kw_only=True)
class FileSettings(AllocatorSettings):
    """All settings that the file of a vehicle may have."""

    vehicle: MovingBodySettings
    controller: ControllerSettings
    simulator: SimulationSettings
    detector: DetectorSettings
    px4: Px4Settings = Px4Settings()
    world_frame: str = WORLD_FRAME()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_attitude(self.controller, self.allocation.axes)


DECLARED: dict[str, type[NodeSettings]] = {
    'allocator': AllocatorSettings, 'controller': ControllerNodeSettings,
    'simulator': SimulatorSettings,
}
"""The settings of each node, by the name of the node."""

K = TypeVar('K', bound=Settings)


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
        own = own_methods(str(given.get('allocation.method')))
        check_given(given, table(FileSettings, own=own))
        return read(kind, given, own=own)
    except ParameterError as error:
        raise ParameterError(f'{files.find(vehicle)}: {error}') from None
