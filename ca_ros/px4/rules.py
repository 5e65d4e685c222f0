"""What passes between PX4 and ca_ros, and when.

PX4 does not hold back motor commands of others: `ActuatorMotors` reaches the motors in each of its
modes, also while its own allocator commands them.  So this side keeps the rules, which are those
of PX4's commander, land_detector and uxrce_dds_client (1.15 to 1.17):

- PX4 gives its allocation up while `VehicleControlMode` says so: armed, allocation off, and the
  mode is ours.  Only then states go to the controller, and motors to PX4.
- PX4's fail-safe waits for silence.  Speeds that answer no command are not sent: neither a timeout
  action, nor the last commands of an allocator.
- The land detector reads `VehicleThrustSetpoint`, which PX4's allocation would leave as it was.
  It is sent beside the motors.
- PX4 sets time stamps of 0 to its own time, so the clock of this machine does not matter.

Messages are made and read by their names and fields.  The class needs neither rclpy nor px4_msgs.
"""

from collections import Counter
from collections.abc import Callable
from math import inf
from random import getrandbits
from time import monotonic
from typing import Any, NamedTuple, Protocol

import numpy as np

from ca_ros.arrays import Array
from ca_ros.parameter_files import Px4Settings
from ca_ros.px4 import frames
from ca_ros.px4.messages import HEARD, SENT, check_messages
from ca_ros.settings import ParameterError
from ca_ros.vehicle.vehicle import Vehicle

NAME = 'ca_ros'  # of the external mode, as QGroundControl shows it
NAME_SIZE = 25  # of RegisterExtComponentRequest.name

FRESH = 0.2  # longest time for which states may remain without a command [s]
LINK = 0.5  # longest time without a state in which PX4 may not have changed its mode unheard [s]
BEAT = 0.1  # period of OffboardControlMode [s]
AGAIN, AGAIN_ARMED = 1.0, 5.0  # between two requests to be registered; PX4 refuses them armed [s]
UNASKED = 2.0  # time without an arming check, every 0.3 s, after which PX4 has no such mode [s]
REFUSED = 10  # arming checks in a row that leave this mode out, after which PX4 has no such mode

REQUIREMENTS = 'angular_velocity', 'attitude', 'local_alt', 'local_position'
"""What PX4 has to estimate for a controller to fly: the fields `mode_req_*`."""


class Host(Protocol):
    """What the rules need of the node that speaks with PX4."""

    def send(self, name: str, message: Any) -> None:
        """Send a message to PX4, on ``fmu/in/NAME``."""

    def pass_state(self, state: frames.State, time: int) -> None:
        """Pass a state with its stamp [ns] on to the controller."""

    def pass_restart(self, time: int) -> None:
        """Say that the states from a stamp [ns] on do not continue those before."""

    def pass_wrench(self, wrench: Array, time: int) -> None:
        """Pass a set-point (6,) with its stamp [ns] on to the allocator [N, N m]."""

    def connected(self) -> bool:
        """Return whether somebody takes the states, and somebody commands rotor speeds."""

    def log(self, text: str) -> None:
        """Log what has changed."""


class Registration(NamedTuple):
    """What PX4 calls the mode, and its arming check."""

    mode: int
    check: int


class Rules:
    """What passes between PX4 and ca_ros by one interface, and when.

    Raises a ParameterError if the vehicle or the settings are wrong for the interface, or if
    px4_msgs lacks a message or a field.

    - `messages`: the classes of the messages by name, such as the module ``px4_msgs.msg``
    - `clock`: a steady time [s]
    - `sent`, `heard`: the classes of the messages by the name of their topic
    - `ours`: whether PX4 leaves the motors to this side
    - `counts`: of what was held back
    """

    def __init__(
        self, messages: Any, vehicle: Vehicle, settings: Px4Settings, host: Host,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._interface = interface = settings.interface
        if interface == 'setpoints' and not settings.simulation:
            raise ParameterError(
                'px4.interface: setpoints is for simulation alone, because no fail-safe of PX4 '
                'can take the motors back: set px4.simulation to true, or choose mode'
            )
        check_vehicle(vehicle)
        check_messages(messages, interface)
        self._units = frames.units(vehicle) if interface == 'setpoints' else np.zeros(6)
        self._messages, self._host, self._clock = messages, host, clock
        given = settings.order, settings.output, settings.thrust_factor
        self._motors = frames.Motors(vehicle, *given)
        self.sent = {
            name: getattr(messages, kind) for name, (kind, _) in SENT[interface].items()
        }
        self.heard = {name: getattr(messages, kind) for name, kind in HEARD[interface].items()}
        self.counts: Counter[str] = Counter()
        self._control_mode: Any = None
        self._status: Any = None
        self._registration: Registration | None = None
        self._request_id = getrandbits(63)
        self.ours = interface == 'setpoints'
        # Times of the steady clock: of the last state that came, that was sound, that was passed
        # on; of the last command; since when states come, and the motors are ours.
        self._came = self._sound = self._passed = self._commanded = -inf
        self._linked = self._opened = -inf
        self._request_time = self._asked = self._beat = -inf
        self._check_id, self._left_out = 0, 0
        self._failed = self._answered_no = False
        self._resets: int | None = None
        self._restart = True
        self._thrust: Any = None

    # What comes from PX4

    def receive(self, name: str, message: Any) -> None:
        """Take a message of PX4, from ``fmu/out/NAME``; raise a ValueError if it is dropped."""
        getattr(self, f'_receive_{name}')(message)

    def _receive_vehicle_odometry(self, message: Any) -> None:
        now = self._clock()
        if now - self._came > LINK:
            # The mode may have changed unheard.
            self._linked, self._control_mode = now, None
            self._decide()
            self._configure()
        self._came = now
        restarted = self._resets not in (None, message.reset_counter)
        self._resets = message.reset_counter
        self._restart = self._restart or restarted
        state, time = frames.state(message), message.timestamp_sample * 1000
        self._sound = now
        if not self.ours:
            self.counts['states held back'] += 1
            return
        if self._restart:
            self.counts['restarts'] += 1
            self._restart = False
            self._host.pass_restart(time)
        self._passed = now
        self._host.pass_state(state, time)

    def _receive_vehicle_control_mode(self, message: Any) -> None:
        self._control_mode = message
        self._decide()

    def _receive_vehicle_status(self, message: Any) -> None:
        self._status = message
        if not self._armed or message.nav_state_user_intention != self._nav_state:
            self._failed = False
        entered = self._registration is not None and message.nav_state == self._nav_state
        mode = self._control_mode
        if entered and mode is not None and mode.source_id != self._nav_state:
            # PX4 did not get the set-points of the mode, and flies in it with its own loops.
            self._configure()

    def _receive_register_ext_component_reply(self, message: Any) -> None:
        if message.request_id != self._request_id:
            return
        if not message.success:
            self._host.log('PX4 refuses to register the mode: it does so while it is armed')
            return
        found = Registration(message.mode_id, message.arming_check_id)
        if self._registration not in (None, found):
            self._unregister(found)
            return
        self._registration, self._left_out = found, 0
        self._asked = self._clock()
        self._host.log(f'PX4 has registered the mode {NAME} as {self._name(found.mode)}')
        self._configure()

    def _receive_arming_check_request(self, message: Any) -> None:
        self._asked, self._check_id = self._clock(), message.request_id
        if self._registration is None:
            return
        valid = getattr(message, 'valid_registrations_mask', -1) >> self._registration.check & 1
        self._left_out = 0 if valid else self._left_out + 1
        if self._left_out > REFUSED:
            self._unregister(self._registration)
            self._forget('PX4 no longer asks for the mode')
            return
        self._reply(self.ready)

    def _receive_vehicle_thrust_setpoint(self, message: Any) -> None:
        self._thrust = message

    def _receive_vehicle_torque_setpoint(self, message: Any) -> None:
        # As in PX4, each torque is allocated, with the newest thrust.
        time = message.timestamp_sample
        if self._thrust is None or abs(self._thrust.timestamp_sample - time) > frames.APART:
            raise ValueError(f'a torque without a thrust within {frames.APART / 1000:g} ms')
        wrench = frames.wrench(self._thrust.xyz, message.xyz, self._units)
        self._passed = self._came = self._clock()
        self._host.pass_wrench(wrench, time * 1000)

    # What goes to PX4

    def command(self, speeds: Array, answers: bool) -> None:
        """Take commanded rotor speeds (n,) [rad/s]; raise a ValueError if they are dropped.

        `answers`: whether they answer a command.  Those of a timeout action do not.
        """
        if not answers:
            self.counts['timeout actions held back'] += 1
            return
        control, thrust = self._motors.convert(speeds)
        if not self.ours:
            self.counts['commands held back'] += 1
            return
        self._commanded = self._clock()
        self._send('actuator_motors', timestamp=0, timestamp_sample=0, control=control)
        if 'vehicle_thrust_setpoint' in self.sent:
            self._send('vehicle_thrust_setpoint', timestamp=0, xyz=thrust)

    def tick(self) -> None:
        """Do what is due; call it every 20 ms."""
        now = self._clock()
        if self._interface == 'offboard' and now >= self._beat + BEAT and self.ready:
            self._beat = now
            self._send('offboard_control_mode', timestamp=0, direct_actuator=True)
        if self._interface != 'mode' or now - self._came > LINK:
            return
        if self._registration is None:
            again = AGAIN_ARMED if self._armed else AGAIN
            if now >= self._request_time + again:
                self._request_time = now
                self._register()
        elif now > max(self._asked, self._linked) + UNASKED:
            self._forget('PX4 has forgotten the mode')
        elif self.ours and self._unanswered and not self._answered_no:
            # PX4 takes an answer to its last request, and need not wait for the next one.
            self._reply(False)
        self._answered_no = self.ours and self._unanswered

    def close(self) -> None:
        """Leave PX4 to itself: a mode that ends in flight is a fail-safe at once."""
        if self._registration is not None:
            self._reply(False)
            self._unregister(self._registration)
            self._registration = None

    # What the diagnostics say

    @property
    def ready(self) -> bool:
        """Whether PX4 may arm in the mode, switch to it and go on in it.

        While the motors are ours, commands have to answer the states.  Before, PX4's state has to
        be known, and nodes have to be there that take states and command rotor speeds.  After a
        fail-safe for want of commands, the mode has to be left by the pilot, or by disarming.
        """
        if self._clock() - self._sound > LINK:
            return False
        if self.ours:
            return not self._unanswered
        return not self._failed and self._host.connected()

    def state(self) -> tuple[str, str]:
        """Return a level of the diagnostics, such as WARN, and a message."""
        if self._clock() - self._came > LINK:
            return 'STALE', 'no state of PX4' if self._interface != 'setpoints' else 'no set-point'
        if self._interface == 'setpoints':
            return 'OK', "allocates for PX4's own loops"
        if self.ours:
            if self._unanswered:
                return 'ERROR', 'PX4 waits for commands'
            return 'OK', 'commands the motors'
        if self._clock() - self._sound > LINK:
            return 'WARN', 'the state of PX4 is not known yet'
        if self._failed:
            return 'ERROR', 'no commands: select another mode before this one'
        if self._interface == 'mode' and self._registration is None:
            return 'WARN', 'PX4 has not registered the mode'
        if not self._host.connected():
            return 'STALE', 'no node takes the states, or none commands rotor speeds'
        return 'OK', 'PX4 has the motors'

    def values(self) -> dict[str, object]:
        """Return the values of the diagnostics by name."""
        status = self._status
        found: dict[str, object] = {'interface': self._interface}
        if status is not None:
            found |= {
                'mode of PX4': self._name(status.nav_state),
                'armed': 'yes' if self._armed else 'no',
                'fail-safe': 'yes' if status.failsafe else 'no',
            }
        if self._registration is not None:
            found['registered as'] = self._name(self._registration.mode)
        if self._interface != 'setpoints':
            found |= {'may arm and run': 'yes' if self.ready else 'no'}
            found |= {'motors': 'of ca_ros' if self.ours else 'of PX4'}
        return {**found, **self.counts}

    # Whose the motors are

    @property
    def _armed(self) -> bool:
        return self._status is not None and (
            self._status.arming_state == self._messages.VehicleStatus.ARMING_STATE_ARMED
        )

    @property
    def _nav_state(self) -> int:
        """What PX4 calls the mode in which the motors are ours; -1 if it does not know it."""
        if self._interface == 'offboard':
            return int(self._messages.VehicleStatus.NAVIGATION_STATE_OFFBOARD)
        return -1 if self._registration is None else self._registration.mode

    @property
    def _unanswered(self) -> bool:
        """Whether states were passed on for longer than `FRESH` without a command."""
        return self._passed - max(self._commanded, self._opened) > FRESH

    def _decide(self) -> None:
        """Decide whose the motors are."""
        if self._interface == 'setpoints':
            return
        mode, before = self._control_mode, self.ours
        self.ours = mode is not None and bool(
            mode.flag_armed
            and not mode.flag_control_allocation_enabled
            and not mode.flag_control_termination_enabled
            and (
                mode.flag_control_offboard_enabled if self._interface == 'offboard'
                else mode.source_id == self._nav_state
            )
        )
        if self.ours and not before:
            self._opened, self._restart = self._clock(), True
            self._host.log('PX4 leaves the motors to ca_ros')
        elif before and not self.ours:
            self._failed = self._unanswered
            why = ': there were no commands' if self._failed else ''
            self._host.log(f'PX4 has the motors{why}')

    # Registration of the mode

    def _register(self) -> None:
        kind = self.sent['register_ext_component_request']
        self._send(
            'register_ext_component_request', timestamp=0, request_id=self._request_id,
            name=mode_name(), px4_ros2_api_version=kind.LATEST_PX4_ROS2_API_VERSION,
            register_arming_check=True, register_mode=True,
        )

    def _unregister(self, registration: Registration) -> None:
        self._send(
            'unregister_ext_component', timestamp=0, name=mode_name(), mode_executor_id=-1,
            arming_check_id=registration.check, mode_id=registration.mode,
        )

    def _forget(self, why: str) -> None:
        self._registration, self._request_id = None, getrandbits(63)
        self._host.log(f'{why}: asks to register it again')
        self._decide()

    def _configure(self) -> None:
        """Turn all loops of PX4 off in the mode; PX4 answers with its control mode."""
        if self._registration is not None:
            mode = self._registration.mode
            self._send('config_control_setpoints', timestamp=0, source_id=mode)

    def _reply(self, ready: bool) -> None:
        assert self._registration is not None
        requirements = {f'mode_req_{name}': True for name in REQUIREMENTS}
        self._send(
            'arming_check_reply', timestamp=0, request_id=self._check_id,
            registration_id=self._registration.check, can_arm_and_run=ready, **requirements,
        )

    def _send(self, topic: str, /, **fields: Any) -> None:
        self._host.send(topic, self.sent[topic](**fields))

    def _name(self, nav_state: int) -> str:
        """Return PX4's name of a mode, such as AUTO_LOITER."""
        if self._registration is not None and nav_state == self._registration.mode:
            return f'{NAME} ({nav_state})'
        kind, begin = self._messages.VehicleStatus, 'NAVIGATION_STATE_'
        names = [name for name in dir(kind) if name.startswith(begin)]
        found = [name for name in names if getattr(kind, name) == nav_state]
        return found[0].removeprefix(begin) if found else str(nav_state)


def mode_name() -> Array:
    """Return the name of the mode as PX4's characters (25,)."""
    return np.frombuffer(NAME.encode().ljust(NAME_SIZE, b'\0'), dtype=np.uint8)


def check_vehicle(vehicle: Vehicle) -> None:
    """Raise a ParameterError if PX4 cannot have the rotors of a vehicle."""
    if vehicle.n > frames.CONTROLS:
        raise ParameterError(f'{vehicle.n} rotors, but PX4 has {frames.CONTROLS} motors at most')
    if (vehicle.speed_min < 0.0).any():
        raise ParameterError('rotors reverse (rotors.speed_min < 0), which is not supported')
    vehicle.servos.refuse('px4_bridge')
