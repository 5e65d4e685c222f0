"""The simulator node: rotor speeds in, the vehicle's state out."""

from functools import partial
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from ca_ros.arrays import Array
from ca_ros.nodes import messages, topics
from ca_ros.nodes.diagnostics import OK, STALE, WARN, Diagnostics, Level
from ca_ros.nodes.executable import run
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.stream import STEADY, Streams
from ca_ros.nodes.topics import DEPTH
from ca_ros.nodes.watchdog import CommandWatch, fallback
from ca_ros.parameter_files import SimulatorSettings
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.simulation.rigid_body import velocity_in_body
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.vehicle.command_bounds import CommandBounds
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, POSITION
from ca_ros.vehicle.vehicle import Vehicle

STATE_REPEAT = 0.2  # time after which the node publishes an unanswered state again [s]

BACKLOG = DEPTH // 4  # answered states after which it waits for its subscribers
CATCH_UP_MAX = 2.0  # longest wait for the subscribers [s]: one that was killed never acknowledges

BEHIND_MAX = 0.5  # greatest lag behind the clock that is caught up with in real time [s]


class SimulatorNode(Node):
    """Moves the plant step by step.

    The vehicle rests until the first command.  Where the clock counts, the node then takes its
    steps by the steady clock times a factor, with the last command; if it cannot keep up, the
    stamps skip ahead and the motion does not.  Otherwise it takes one step for each command that
    answers its present state.  Rotors fail by `simulator.failures`.

    The arguments are those of `rclpy.node.Node`.  Raises a ParameterError if a parameter is
    missing or wrong.
    """

    declared = SimulatorSettings

    def __init__(self, node_name: str = 'simulator', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        self.parameters = Parameters(self, self.declared)
        settings = self.parameters.settings
        self._mode, self._resting = self.parameters.mode, True
        self._repeats, self._discarded, self._fault = 0, '', ''
        vehicle = Vehicle.from_settings(settings.vehicle, settings.rotors)
        body = body_of(vehicle, settings.simulator)
        self.plant = Plant(body, settings.simulator, imu=settings.detector)
        self.parameters.on_change(self._read_failures, self._set_failures)
        self.diagnostics = Diagnostics(self, 'simulation', str(settings.vehicle.name))
        self._counts = self.diagnostics.counts
        self.watchdog = CommandWatch(
            self, self.parameters, self.diagnostics, fall_back=self._fall_back)
        self.streams = Streams(self, self._mode, self.diagnostics.drop, self._counts)
        clocked = self._mode.clocked
        self._command, self._n = self.plant.speeds, vehicle.n
        self._step_ns = self.plant.time_step_ns
        self._period_ns = round(self._step_ns / settings.simulator.real_time_factor)
        publish = self.streams.publish
        if self.plant.specific_force is not None:
            topic = topics.imu()
            self._imu, self._imu_message = publish(topic), topic.kind()
            self._imu_message.orientation_covariance[0] = -1.0  # it has no orientation
        self._pose, self._velocity = map(publish, (topics.POSE, topics.VELOCITY))
        clock = settings.simulator.publish_clock
        self._odometry = publish(topics.ODOMETRY)
        self._ticks = publish(topics.CLOCK) if clock else None
        self._speeds = publish(topics.SPEEDS)
        self._measured = publish(topics.MEASURED_SPEEDS)
        self.create_service(Trigger, '~/reset', self._reset)
        self._angles = [publish(topic) for topic in topics.needed(
            (topics.SPEEDS, topics.TILTS), len(vehicle.servos))[1:]]
        self.streams.subscribe_commands(self._receive, CommandBounds(vehicle))
        period = self._period_ns / 1e9 if clocked else STATE_REPEAT
        turn = self._catch_up if clocked else self._repeat
        self._time = self.get_clock().now().nanoseconds if clocked else 0
        # A step is due a quarter of a period before a call of the timer, so a late call, too,
        # takes one step, and a state is published when its stamp comes.
        self._due = STEADY.now().nanoseconds + self._period_ns * 3 // 4
        self._timer = self.create_timer(period, turn, clock=STEADY)
        self.diagnostics.start(
            lambda: self.watchdog.levels(self._state), lambda: self._counts, self.streams,
            self.watchdog.watch)

    def _read_failures(self, settings: SimulatorSettings) -> RotorFailures:
        """Return the failures that the settings name; a ParameterError if they cannot happen."""
        return self.plant.checked(RotorFailures.read(settings.simulator.failures))

    def _set_failures(self, failures: RotorFailures) -> None:
        """Let these rotors fail, and no others, from the next step on."""
        self.plant.failures = failures

    def _state(self) -> Level:
        if self._fault:
            return WARN, self._fault
        return (STALE, 'no command yet') if self._resting else (OK, 'in flight')

    def _fall_back(self, action: str) -> None:
        self._command = fallback(action, self.plant.body.vehicle, self._command)

    def _receive(self, command: Float64MultiArray, numbers: Array) -> None:
        if self._mode.clocked:
            if self._resting:
                if messages.answers_nothing(command):
                    self.diagnostics.drop('rest', 'a timeout action before the first command')
                    return
                self._skip(STEADY.now().nanoseconds)
            self._follow(numbers)
        elif messages.speeds_stamp(command) == self._time:
            self._follow(numbers)
            self._repeats, self._discarded, self._fault = 0, '', ''
            self._step()
            if self._time % (BACKLOG * self._step_ns) == 0:
                # Wait until the subscribers have acknowledged what was published.
                limit = Duration(seconds=CATCH_UP_MAX)
                all(publisher.wait_for_all_acked(limit) for publisher in self.streams.publishers)
            self._timer.reset()
        else:
            # Mostly a second answer to a state that was published again.
            self._counts['repeated'] += 1
            if not messages.answers_nothing(command):
                found = messages.speeds_stamp(command)
                self._discarded = 'no stamp' if found is None else f'stamp {found}'

    def _follow(self, command: Array) -> None:
        self._command, self._resting = command, False
        self.watchdog.feed()
        self._counts['served'] += 1

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Put the vehicle in its initial state, at rest until the next command.

        Without a clock the time starts at zero again.  Rotors fail again, at their times.
        """
        self.plant = self.plant.restarted()
        self._command = self.plant.speeds
        self._resting = True
        self.watchdog.sleep()
        if not self._mode.clocked:
            self._time = 0
        self._repeat()
        response.success, response.message = True, 'at rest in the initial state'
        return response

    def _repeat(self) -> None:
        """Publish an unanswered state again, for nodes that started late."""
        # What arrived before the first repetition may have answered an earlier state.
        if self._repeats and self._discarded:
            self._fault = (
                f'rotor speeds with {self._discarded} are discarded: expected stamp {self._time}; '
                'wrench and speeds must carry the stamp of the state that they answer'
            )
            self.diagnostics.warn('stamp', self._fault)
        self._repeats, self._discarded = self._repeats + 1, ''
        if self._resting:
            self._publish_command()
        self._publish()

    def _catch_up(self) -> None:
        """Take the steps that are due."""
        now = STEADY.now().nanoseconds
        behind = now - self._due
        if self._resting:
            if self._skip(now + self._period_ns):
                self.plant.measure()
                self._repeat()
        elif behind > BEHIND_MAX * 1e9:
            self.get_logger().warning(
                f'{behind / 1e9:.1f} s behind the clock: the stamps catch up, the motion does not'
            )
            self.plant.elapsed += self._skip(now) * self._step_ns
        while not self._resting and self._due <= now:
            self._due += self._period_ns
            self._step()

    def _skip(self, now: int) -> int:
        """Skip the steps that are due, except for their stamps; return how many."""
        steps = max(0, (now - self._due) // self._period_ns)
        self._due += steps * self._period_ns
        self._time += steps * self._step_ns
        return steps

    def _step(self) -> None:
        self._publish_command()
        try:
            self.plant.step(self._command)
        except FloatingPointError as error:
            if self.diagnostics.may_log('diverged'):
                self.get_logger().error(f'{error}: the state is held')
        self._time += self._step_ns
        if self._measured.get_subscription_count():
            measured = self.plant.speeds[: self._n]
            self._measured.publish(messages.speeds_message(measured, self._time))
        self._publish()

    def _publish_command(self) -> None:
        speeds, angles = np.split(self._command, [self._n])
        for publisher in self._angles:
            publisher.publish(messages.speeds_message(angles, self._time, messages.TILT_ANGLE))
        self._speeds.publish(messages.speeds_message(speeds, self._time))

    def _publish(self) -> None:
        state, time = self.plant.measured, messages.stamp(self._time)
        parts = state[POSITION], state[ATTITUDE], velocity_in_body(state), state[ANGULAR_VELOCITY]
        frames = self.parameters.settings.world_frame, self.parameters.settings.command_frame
        pose, velocity = messages.state_messages(*parts, time, *frames)
        # The clock comes first: nodes that use it must not see stamps of the future.
        if self._ticks is not None:
            self._ticks.publish(Clock(clock=time))
        if self.plant.specific_force is not None:
            measured = parts[-1], self.plant.specific_force
            self._imu.publish(messages.fill_imu(self._imu_message, velocity.header, *measured))
        self._pose.publish(pose)
        self._velocity.publish(velocity)
        if self._odometry.get_subscription_count():
            odometry = Odometry(header=pose.header, child_frame_id=velocity.header.frame_id)
            odometry.pose.pose, odometry.twist.twist = pose.pose, velocity.twist
            self._odometry.publish(odometry)


ABOUT = 'Simulate: command/motor_speed to pose and velocity.'
main = partial(run, 'simulator', SimulatorNode, ABOUT)
