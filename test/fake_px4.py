"""A fake PX4: its commander, land detector and motors, with the project's plant.

What it does is written from PX4's sources (commander, land_detector, uxrce_dds_client; main of
March 2026), by its own conversions of frames.  Like PX4, it takes motor commands in every mode.
"""

from collections import Counter
from dataclasses import asdict, dataclass, field, fields, make_dataclass
from functools import partial
from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from ca_ros import Exact
from ca_ros.control.controller import Controller
from ca_ros.control.controller_settings import ControllerSettings
from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.simulation.rigid_body import velocity_in_body
from ca_ros.vehicle.state import ATTITUDE, POSITION, VELOCITY

HOLD, RTL, OFFBOARD, EXTERNAL1 = 4, 5, 14, 23
DISARMED, ARMED = 1, 2
LOST = 1.0  # COM_OF_LOSS_T [s]
DISARM_LAND = 2.0  # COM_DISARM_LAND [s]
DESCENT = 0.7  # MPC_LAND_SPEED [m/s]
STALE = 300_000  # age of a reply that the commander ignores [us]
WORLD = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # ENU from NED
BODY = np.diag([1.0, -1.0, -1.0])  # FLU from FRD


MOTORS, THREE, UNKNOWN, WORD = (
    partial(np.full, *given) for given in (
        (12, 0.0, np.float32), (3, 0.0, np.float32), (3, np.nan, np.float32), (25, 0, np.uint8)))


def flags(*names):
    return [(name, bool, False) for name in names]


@dataclass
class ActuatorMotors:
    timestamp: int = 0
    timestamp_sample: int = 0
    reversible_flags: int = 0
    control: np.ndarray = field(default_factory=MOTORS)


@dataclass
class VehicleThrustSetpoint:
    timestamp: int = 0
    timestamp_sample: int = 0
    xyz: np.ndarray = field(default_factory=THREE)


@dataclass
class VehicleTorqueSetpoint(VehicleThrustSetpoint):
    pass


OffboardControlMode = make_dataclass('OffboardControlMode', [('timestamp', int, 0), *flags(
    'position', 'velocity', 'acceleration', 'attitude', 'body_rate', 'thrust_and_torque',
    'direct_actuator')])

VehicleControlMode = make_dataclass('VehicleControlMode', [
    ('timestamp', int, 0), *flags('flag_armed', *(f'flag_control_{name}_enabled' for name in (
        'manual', 'auto', 'offboard', 'position', 'velocity', 'altitude', 'climb_rate',
        'acceleration', 'attitude', 'rates', 'allocation', 'termination'))),
    ('source_id', int, 0)])


@dataclass
class VehicleStatus:
    timestamp: int = 0
    arming_state: int = DISARMED
    nav_state: int = HOLD
    nav_state_user_intention: int = HOLD
    failsafe: bool = False


VehicleStatus.MESSAGE_VERSION = 2
VehicleStatus.ARMING_STATE_ARMED = ARMED
for name, number in (('AUTO_LOITER', HOLD), ('AUTO_RTL', RTL), ('OFFBOARD', OFFBOARD)):
    setattr(VehicleStatus, f'NAVIGATION_STATE_{name}', number)


@dataclass
class VehicleOdometry:
    timestamp: int = 0
    timestamp_sample: int = 0
    pose_frame: int = 0
    position: np.ndarray = field(default_factory=UNKNOWN)
    q: np.ndarray = field(default_factory=partial(np.full, 4, np.nan, np.float32))
    velocity_frame: int = 0
    velocity: np.ndarray = field(default_factory=UNKNOWN)
    angular_velocity: np.ndarray = field(default_factory=UNKNOWN)
    reset_counter: int = 0


@dataclass
class RegisterExtComponentRequest:
    timestamp: int = 0
    request_id: int = 0
    name: np.ndarray = field(default_factory=WORD)
    px4_ros2_api_version: int = 0
    register_arming_check: bool = False
    register_mode: bool = False


RegisterExtComponentRequest.MESSAGE_VERSION = 1
RegisterExtComponentRequest.LATEST_PX4_ROS2_API_VERSION = 1


@dataclass
class RegisterExtComponentReply:
    request_id: int = 0
    success: bool = False
    arming_check_id: int = -1
    mode_id: int = -1


@dataclass
class UnregisterExtComponent:
    timestamp: int = 0
    name: np.ndarray = field(default_factory=WORD)
    arming_check_id: int = -1
    mode_id: int = -1
    mode_executor_id: int = -1


@dataclass
class ArmingCheckRequest:
    request_id: int = 0
    valid_registrations_mask: int = 0


ArmingCheckRequest.MESSAGE_VERSION = 1

ArmingCheckReply = make_dataclass('ArmingCheckReply', [
    ('timestamp', int, 0), ('request_id', int, 0), ('registration_id', int, 0),
    *flags('can_arm_and_run', *(f'mode_req_{name}' for name in (
        'angular_velocity', 'attitude', 'local_alt', 'local_position')))])

KINDS = (
    ActuatorMotors, ArmingCheckReply, ArmingCheckRequest, OffboardControlMode,
    RegisterExtComponentReply, RegisterExtComponentRequest, UnregisterExtComponent,
    VehicleControlMode, VehicleOdometry, VehicleStatus, VehicleThrustSetpoint,
    VehicleTorqueSetpoint)

MESSAGES = SimpleNamespace(**{kind.__name__: kind for kind in KINDS})
"""PX4's messages, as far as they are used; like the dataclasses, they know no other fields."""


def converted(message, messages):
    """Return a message as one of another set of classes, such as that of px4_msgs."""
    kind = getattr(messages, type(message).__name__)
    names = [each.name for each in fields(getattr(MESSAGES, type(message).__name__))]
    return kind(**{name: getattr(message, name) for name in names})


@dataclass
class Mode:
    """An external mode as the commander knows it."""

    check: int
    configured: VehicleControlMode | None = None
    reply: ArmingCheckReply | None = None
    answered: bool = True
    missed: int = 0
    unresponsive: bool = False


class FakePx4:
    """PX4 in simulation: `step` advances it, `receive` takes what comes to ``fmu/in/NAME``.

    - `time`: [s]
    - `linked`: whether the agent runs; without it nothing comes and nothing goes
    - `nav_state`, `intention`: the mode, and what the pilot selected
    - `motors` (n,): controls that the motors have
    - `log`: what happened, as pairs of time and text
    - `resets`, `jump`: how often the estimator was reset, and the velocity that it adds [m/s]
    - `outside`: how many motor commands came while PX4 had the motors
    """

    def __init__(self, vehicle, step=0.02, clock_offset=0.0, **plant):
        self.vehicle = vehicle
        settings = PlantSettings(time_step=step, ground='flat', **plant)
        self.plant = Plant(body_of(vehicle, settings), settings)
        self._loops = Controller(vehicle, ControllerSettings()), Exact(vehicle)
        self.step_time, self._steps = step, 0
        # What the agent adds to PX4's time, so that ROS sees the time of its own machine.
        self.clock_offset = clock_offset
        self.linked, self.armed, self.failsafe = True, False, False
        self.nav_state = self.intention = HOLD
        self.modes = {}
        self.motors, self.thrust = np.full(vehicle.n, np.nan), 0.0
        self.log, self.outside = [], 0
        self.resets, self.jump = 0, np.zeros(3)
        self.received = Counter()
        self._offboard = -np.inf
        self._request, self._asked = 0, -np.inf
        self._landed, self._flew, self._still, self._rested = True, False, 0.0, 0.0
        self._target = np.zeros(3)
        self._told, self._out = None, []

    # What a pilot and a test do

    @property
    def time(self):
        return self._steps * self.step_time

    @property
    def height(self):
        return float(self.plant.state[2])

    def select(self, mode):
        """Select a mode, as a pilot does; return whether PX4 accepts."""
        if not self.can_run(mode):
            return False
        self.intention = mode
        self._enter(mode)
        return True

    def arm(self):
        """Arm in the selected mode; return whether PX4 accepts."""
        if self.can_run(self.intention):
            self.armed, self._flew, self._rested = True, False, 0.0
            self._say('armed')
        return self.armed

    def disarm(self, why):
        self.armed, self.failsafe = False, False
        self._enter(self.intention)
        self._say(f'disarmed: {why}')

    def reboot(self):
        """Forget all modes, as after a restart on the ground."""
        self.modes.clear()
        self.nav_state = self.intention = HOLD

    def when(self, text):
        """Return when something was logged for the first time [s]."""
        return next((time for time, each in self.log if text in each), None)

    # The loop

    def step(self):
        """Advance by a step; return the messages (name, message) to ``fmu/out/NAME``."""
        self._steps += 1
        self._commander()
        mode = self._control_mode()
        if self.armed and mode.flag_control_allocation_enabled:
            self._fly()
        controls = np.nan_to_num(self.motors) if self.armed else np.zeros(self.vehicle.n)
        # The outputs set the thrust (THR_MDL_FAC is 0): the motors' thrust is c f_max.
        self.plant.step(np.sqrt(controls) * self.vehicle.speed_max)
        self._detect_landing(mode.flag_control_climb_rate_enabled)
        status = VehicleStatus(
            arming_state=ARMED if self.armed else DISARMED, nav_state=self.nav_state,
            nav_state_user_intention=self.intention, failsafe=self.failsafe)
        told = asdict(mode), asdict(status)
        if told != self._told or self._steps % round(0.5 / self.step_time) == 0:
            self._told = told
            self._send('vehicle_control_mode', mode)
            self._send('vehicle_status', status)
        self._send('vehicle_odometry', self._odometry())
        out, self._out = self._out, []
        return out if self.linked else []

    def receive(self, name, message):
        """Take a message, as the client of the agent does: it replaces stamps of 0 by now."""
        if not self.linked:
            return
        self.received[name] += 1
        now = round(self.time * 1e6)
        stamp = message.timestamp
        self._age = 0 if stamp == 0 else now - (stamp - round(self.clock_offset * 1e6))
        getattr(self, f'_receive_{name}')(message)

    def _send(self, name, message):
        self._out.append((name, message))

    def _say(self, text):
        self.log.append((self.time, text))

    def _enter(self, mode):
        if mode != self.nav_state:
            self._target = np.array(self.plant.state[POSITION])
            self._say(f'mode {mode}')
        self.nav_state = mode

    # Motors

    def _receive_actuator_motors(self, message):
        self.outside += not self.armed or self._control_mode().flag_control_allocation_enabled
        self.motors = np.array(message.control[: self.vehicle.n], dtype=float)
        assert np.isnan(message.control[self.vehicle.n:]).all()
        assert not (self.motors > 1.0).any()
        assert not (self.motors < 0.0).any()

    def _receive_vehicle_thrust_setpoint(self, message):
        self.thrust = -float(message.xyz[2])

    def _fly(self):
        """Hold the place, or land, with PX4's own loops and allocation."""
        if self.nav_state == RTL:
            # On the ground, the thrust goes to its least.
            self._target[2] -= DESCENT * self.step_time if self.height > 0.0 else 1.0
        controller, allocator = self._loops
        state = self.plant.measured
        pose = state[POSITION], state[ATTITUDE], velocity_in_body(state), state[10:13]
        heading = np.array([0.0, 0.0, 0.0, 1.0])
        wrench = controller.wrench(*pose, Waypoint(self._target, heading))
        answer = allocator.allocate(wrench)
        self.motors = answer.thrusts / self.vehicle.thrust_max
        self.thrust = float(answer.thrusts.sum() / self.vehicle.thrust_max.sum())

    # Commander

    def can_run(self, mode):
        if mode == OFFBOARD:
            return self.time - self._offboard < LOST
        if mode < EXTERNAL1:
            return True
        found = self.modes.get(mode)
        ready = found is not None and found.reply is not None and found.reply.can_arm_and_run
        return bool(ready and not found.unresponsive)

    def _commander(self):
        if self.time - self._asked > 0.3:
            self._asked = self.time
            for mode in self.modes.values():
                mode.missed = 0 if mode.answered else mode.missed + 1
                mode.unresponsive = mode.unresponsive or mode.missed > 3
                mode.answered = False
            self._request = (self._request + 1) % 256
            if self.modes:
                valid = sum(1 << m.check for m in self.modes.values() if not m.unresponsive)
                self._send('arming_check_request', ArmingCheckRequest(self._request, valid))
            if not self.armed:
                for number, mode in list(self.modes.items()):
                    if mode.unresponsive and number != self.intention:
                        del self.modes[number]
        if not self.armed:
            return
        if self.can_run(self.intention):
            self.failsafe = False
            self._enter(self.intention)
        elif not self.failsafe:
            self.failsafe = True
            self._say('fail-safe')
            self._enter(RTL)

    def _control_mode(self):
        own = {f'flag_control_{name}_enabled': True for name in (
            'auto', 'position', 'velocity', 'altitude', 'climb_rate', 'attitude', 'rates',
            'allocation')}
        mode = VehicleControlMode(**own)
        if self.nav_state == OFFBOARD:
            mode = VehicleControlMode(flag_control_offboard_enabled=True)
        elif self.nav_state in self.modes and self.modes[self.nav_state].configured:
            mode = VehicleControlMode(source_id=self.nav_state)
        mode.flag_armed = self.armed
        return mode

    def _receive_offboard_control_mode(self, message):
        if message.direct_actuator and self._age < LOST * 1e6:
            self._offboard = self.time

    def _receive_register_ext_component_request(self, message):
        reply = RegisterExtComponentReply(message.request_id)
        assert bytes(bytearray(message.name)).rstrip(b'\0') == b'ca_ros'
        if message.register_mode and message.register_arming_check and not self.armed:
            number = next(i for i in range(EXTERNAL1, 31) if i not in self.modes)
            checks = {mode.check for mode in self.modes.values()}
            check = next(i for i in range(8) if i not in checks)
            self.modes[number] = Mode(check)
            reply = RegisterExtComponentReply(message.request_id, True, check, number)
        self._send('register_ext_component_reply', reply)

    def _receive_unregister_ext_component(self, message):
        if not self.armed and message.mode_id in self.modes:
            del self.modes[message.mode_id]
            if self.intention == message.mode_id:
                self.intention = HOLD
                self._enter(HOLD)

    def _receive_config_control_setpoints(self, message):
        if message.source_id in self.modes:
            self.modes[message.source_id].configured = message
            self._told = None

    def _receive_arming_check_reply(self, message):
        for mode in self.modes.values():
            current = message.request_id == self._request and self._age < STALE
            if mode.check == message.registration_id and current:
                mode.answered, mode.unresponsive, mode.missed = True, False, 0
                mode.reply = message

    # Land detector

    def _detect_landing(self, climbs):
        velocity, rates = self.plant.state[VELOCITY], self.plant.state[10:13]
        hover = self.vehicle.weight / self.vehicle.thrust_max.sum()
        low = 0.12 + 0.1 * (hover - 0.12) if climbs else 0.09
        still = abs(velocity[2]) < 0.25 and np.hypot(*velocity[:2]) < 1.5
        still = still and np.hypot(*rates[:2]) < 0.35 and self.thrust <= low
        self._still = self._still + self.step_time if still else 0.0
        self._landed = not self.armed or self._still >= 1.0
        self._flew = self._flew or not self._landed
        self._rested = self._rested + self.step_time if self._landed else 0.0
        if self.armed and self._flew and self._rested > DISARM_LAND:
            self.disarm('landed')

    def _odometry(self):
        state, now = self.plant.measured, round((self.time + self.clock_offset) * 1e6)
        rotation = WORLD.T @ Rotation.from_quat(state[ATTITUDE]).as_matrix() @ BODY
        x, y, z, w = Rotation.from_matrix(rotation).as_quat()
        return VehicleOdometry(
            timestamp=now, timestamp_sample=now, pose_frame=1, velocity_frame=1,
            position=np.float32(WORLD.T @ state[POSITION]), q=np.float32([w, x, y, z]),
            velocity=np.float32(WORLD.T @ state[VELOCITY] + self.jump),
            angular_velocity=np.float32(BODY @ state[10:13]), reset_counter=self.resets)
