"""The rules of the bridge against a fake PX4."""

import copy
from dataclasses import make_dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from ca_ros import Exact, ParameterError, Vehicle
from ca_ros.control.controller import Controller
from ca_ros.control.controller_settings import ControllerSettings
from ca_ros.control.waypoint import Waypoint
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.detection.kernel_detector import make_detector
from ca_ros.parameter_files import Px4Settings
from ca_ros.problem.audit import accept
from ca_ros.px4.messages import topic
from ca_ros.px4.rules import Rules
from ca_ros.simulation.plant import body_of
from ca_ros.simulation.plant_settings import PlantSettings
from fake_px4 import EXTERNAL1, HOLD, MESSAGES, OFFBOARD, RTL, FakePx4

TIMEOUT = 0.2  # command_timeout of the allocator [s]

HEXAROTOR = Vehicle.load('hexarotor')


class Loop:
    """PX4, the rules, and what stands for controller, allocator and monitor.

    `step` advances all of them; the rules have the time of PX4.
    """

    def __init__(self, interface='mode', vehicle=HEXAROTOR, height=2.0, integral=0.0, **plant):
        self.vehicle, self.interface = vehicle, interface
        self.px4 = FakePx4(vehicle, **plant)
        self.settings = ControllerSettings(integral_gain=integral)
        self.waypoint = Waypoint(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 0.0, 1.0]))
        self.controller_runs = self.allocator_runs = True
        self.detector = None
        self.use(vehicle)
        self.sent, self.states, self.restarts, self.texts = [], 0, [], []
        self.health_found = None
        self._wrench_time = -np.inf
        self.rules = self.make_rules()

    def make_rules(self):
        settings = Px4Settings(interface=self.interface)
        return Rules(MESSAGES, self.vehicle, settings, self, lambda: self.px4.time)

    def use(self, vehicle):
        """Use the health of a vehicle in controller and allocator."""
        self.controller = Controller(vehicle, self.settings)
        self.allocator = Exact(vehicle)

    # The host of the rules

    def send(self, name, message):
        self.sent.append((name, message))
        self.px4.receive(name, message)

    def pass_restart(self, time):
        self.restarts.append(self.px4.time)
        self.controller.restart()
        if self.detector:
            self.detector.interrupt()

    def pass_state(self, state, time):
        self.states += 1
        if self.detector and self.detector.observe(time, *state[1:]):
            self.health_found = self.detector.health
            self.use(accept(self.vehicle.with_health(self.health_found), 'drop').vehicle)
        if not self.controller_runs:
            return
        wrench = self.controller.wrench(*state, self.waypoint, time)
        self._wrench_time = self.px4.time
        if self.allocator_runs:
            speeds = self.allocator.allocate(wrench).speeds
            if self.detector:
                self.detector.command(time, speeds)
            self.command(speeds, True)

    def command(self, speeds, answers):
        self.rules.command(speeds, answers)

    def connected(self):
        return self.controller_runs and self.allocator_runs

    def log(self, text):
        self.texts.append(text)

    # The loop

    def step(self):
        for name, message in self.px4.step():
            self.rules.receive(name, message)
        self.rules.tick()
        self.time_out()

    def time_out(self):
        """Do the timeout action of the allocator."""
        if self.allocator_runs and self.px4.time - self._wrench_time > TIMEOUT:
            self.command(self.vehicle.idle_speeds, False)

    def run(self, seconds, until=lambda: False):
        """Advance by a time, or until something holds; return whether it did."""
        end = self.px4.time + seconds
        while self.px4.time < end:
            self.step()
            if until():
                return True
        return False

    @property
    def mode(self):
        return OFFBOARD if self.interface == 'offboard' else EXTERNAL1

    def take_off(self, seconds=6.0):
        """Take off to the waypoint in the mode in which the motors are ours."""
        assert self.run(4.0, lambda: self.px4.can_run(self.mode))
        assert self.px4.select(self.mode)
        assert self.px4.arm()
        self.run(seconds)
        assert abs(self.px4.height - self.waypoint.position[2]) < 0.1
        return self

    def lowest(self, seconds):
        """Advance by a time; return the least height in it [m]."""
        heights = []
        self.run(seconds, lambda: heights.append(self.px4.height))
        return min(heights)


@pytest.fixture(params=['mode', 'offboard'])
def loop(request):
    return Loop(request.param)


# In the mode

def test_it_hovers_and_px4_does_not_believe_that_it_has_landed(loop):
    loop.take_off(15.0)
    assert loop.px4.armed
    assert loop.px4.nav_state == loop.mode
    assert loop.px4.outside == 0
    names = [name for name, _ in loop.sent]
    assert names.count('actuator_motors') == names.count('vehicle_thrust_setpoint') > 600
    assert loop.rules.state() == ('OK', 'commands the motors')
    assert loop.rules.values()['motors'] == 'of ca_ros'


def test_without_the_thrust_this_px4_would_disarm_in_the_air(loop):
    """The fake tells the fault: what the test above sees is the set-point."""
    receive = loop.px4.receive
    loop.px4.receive = lambda name, message: (
        None if name == 'vehicle_thrust_setpoint' else receive(name, message))
    loop.take_off(4.5)
    loop.run(5.0)
    assert loop.px4.when('disarmed: landed')


def test_all_stamps_are_left_to_px4():
    """The clock of the host is behind by two seconds, which PX4 would take for a lost link."""
    for interface in ('mode', 'offboard'):
        loop = Loop(interface)
        loop.px4.clock_offset = -2.0
        loop.take_off()
        assert {message.timestamp for _, message in loop.sent} == {0}
        assert not loop.px4.failsafe


def test_the_pilot_takes_over(loop):
    loop.take_off()
    assert loop.px4.select(HOLD)
    assert loop.lowest(5.0) > 1.9
    assert loop.px4.outside == 0
    assert loop.rules.counts['states held back'] > 200
    # And gives back.
    before = len(loop.restarts)
    assert loop.px4.select(loop.mode)
    assert loop.lowest(5.0) > 1.9
    assert len(loop.restarts) == before + 1


def test_the_controller_is_killed(loop):
    loop.take_off()
    loop.controller_runs = False
    assert loop.run({'mode': 0.4, 'offboard': 1.4}[loop.interface], lambda: loop.px4.failsafe)
    assert loop.px4.height > 1.9
    loop.run(1.0)
    assert loop.rules.counts['timeout actions held back'] > 50
    # PX4 returns and lands, and nothing of ours interferes.
    assert loop.run(10.0, lambda: not loop.px4.armed)
    assert loop.px4.outside == 0


def test_a_mode_whose_controller_has_ended_is_not_entered_again_by_itself():
    loop = Loop()
    loop.take_off()
    loop.controller_runs, loop.connected = False, lambda: True
    assert loop.run(1.0, lambda: loop.px4.failsafe)
    # Nodes of a killed process remain in the graph for a while: PX4 would come and go.
    loop.run(1.0)
    assert [text for _, text in loop.px4.log].count('fail-safe') == 1
    assert loop.rules.state()[1].startswith('no commands: select another mode')
    loop.controller_runs = True
    assert loop.px4.select(HOLD)
    assert loop.run(1.0, lambda: loop.px4.select(loop.mode))
    assert loop.lowest(3.0) > 0.8
    assert loop.px4.nav_state == loop.mode


def test_the_allocator_ends(loop):
    loop.take_off()
    loop.allocator_runs = False
    for _ in range(5):
        loop.command(loop.vehicle.idle_speeds, False)
        loop.step()
    assert loop.run({'mode': 0.4, 'offboard': 1.4}[loop.interface], lambda: loop.px4.failsafe)
    assert loop.px4.height > 1.9
    assert loop.px4.outside == 0


def test_the_agent_is_killed_and_comes_back(loop):
    loop.take_off()
    loop.px4.linked = False
    assert loop.lowest(3.0) > 1.0
    assert loop.px4.failsafe
    loop.px4.linked = True
    loop.run(5.0)
    assert loop.px4.outside == 0
    # PX4 goes on in the mode that the pilot had selected, which it still knows.
    assert loop.px4.nav_state == loop.mode
    assert abs(loop.px4.height - 2.0) < 0.1
    assert loop.px4.received['register_ext_component_request'] == (loop.interface == 'mode')


def test_the_pilot_takes_over_while_the_agent_is_away(loop):
    loop.take_off()
    loop.px4.linked = False
    loop.run(0.7)
    assert loop.px4.select(HOLD)
    loop.run(0.1)
    loop.px4.linked = True
    assert loop.lowest(3.0) > 1.9
    assert loop.px4.outside == 0


def test_the_bridge_ends_in_flight():
    loop = Loop().take_off()
    ended = loop.px4.time
    loop.rules.close()
    loop.rules.tick = loop.rules.receive = lambda *_: None
    loop.controller_runs = loop.allocator_runs = False
    assert loop.run(1.0, lambda: loop.px4.failsafe)
    assert loop.px4.when('fail-safe') - ended < 0.1


# Disarmed

def test_no_state_is_passed_on_while_px4_is_disarmed(loop):
    loop.run(5.0)
    assert loop.states == 0
    assert loop.rules.values()['armed'] == 'no'
    assert loop.px4.received['actuator_motors'] == 0


def test_nothing_winds_up_on_the_ground():
    loop = Loop(integral=1.0, mass_factor=1.2).take_off(8.0)
    assert loop.controller.disturbances.estimate[2] < -1.0
    assert loop.px4.select(HOLD)
    loop.px4._enter(RTL)
    loop.px4.intention = RTL
    assert loop.run(10.0, lambda: not loop.px4.armed)
    # Half a minute on the ground, with the waypoint above it.
    loop.run(30.0)
    loop.sent.clear()
    assert loop.px4.select(loop.mode)
    assert loop.px4.arm()
    assert loop.run(1.0, lambda: any(name == 'actuator_motors' for name, _ in loop.sent))
    assert not loop.controller.disturbances.estimate.any()
    first = next(message for name, message in loop.sent if name == 'actuator_motors')
    assert first.control[:6].max() < 0.8
    assert loop.lowest(6.0) > -0.01
    assert abs(loop.px4.height - 2.0) < 0.1


# Registration

def test_the_mode_is_registered_once_and_taken_leave_of():
    loop = Loop()
    loop.run(3.0)
    assert list(loop.px4.modes) == [EXTERNAL1]
    assert loop.px4.received['register_ext_component_request'] == 1
    assert 'PX4 has registered the mode ca_ros as ca_ros (23)' in loop.texts
    reply = loop.px4.modes[EXTERNAL1].reply
    assert reply.mode_req_attitude
    assert reply.mode_req_local_position
    loop.rules.close()
    assert not loop.px4.modes


def test_px4_restarts_and_the_mode_is_registered_again():
    loop = Loop()
    loop.run(3.0)
    loop.px4.reboot()
    assert loop.run(5.0, lambda: loop.px4.can_run(EXTERNAL1))
    assert list(loop.px4.modes) == [EXTERNAL1]
    loop.take_off()


def test_px4_refuses_to_register_while_it_is_armed():
    loop = Loop()
    loop.px4.arm()
    loop.run(12.0)
    assert loop.px4.received['register_ext_component_request'] in (2, 3)
    assert loop.rules.state() == ('WARN', 'PX4 has not registered the mode')
    loop.px4.disarm('by hand')
    assert loop.run(6.0, lambda: loop.px4.can_run(EXTERNAL1))


def test_a_second_registration_is_given_back():
    loop = Loop()
    loop.run(2.0)
    request = next(each for name, each in loop.sent if name == 'register_ext_component_request')
    # As if the first answer had been late, and the request had been repeated.
    loop.px4.receive('register_ext_component_request', request)
    assert len(loop.px4.modes) == 2
    loop.run(1.0)
    assert list(loop.px4.modes) == [EXTERNAL1]


def test_lost_set_points_of_the_mode_are_sent_again():
    loop = Loop()
    receive, lost = loop.px4.receive, []
    loop.px4.receive = lambda name, message: (
        lost.append(name) if name == 'config_control_setpoints' and not lost
        else receive(name, message))
    loop.take_off()
    assert lost == ['config_control_setpoints']


def test_without_nodes_the_mode_cannot_be_armed(loop):
    loop.controller_runs = False
    loop.run(3.0)
    assert not loop.px4.can_run(loop.mode)
    assert loop.rules.state()[0] == 'STALE'


def test_an_unknown_state_is_refused(loop):
    loop.run(3.0)
    message = loop.px4._odometry()
    message.q = np.full(4, np.nan, dtype=np.float32)
    with pytest.raises(ValueError, match='q is unknown'):
        loop.rules.receive('vehicle_odometry', message)


# Restarts and failures

def test_a_changed_reset_counter_is_a_restart(loop):
    loop.take_off()
    before = len(loop.restarts)
    loop.px4.resets = 1
    loop.run(1.0)
    assert len(loop.restarts) == before + 1
    assert loop.rules.values()['restarts'] == before + 1


@pytest.mark.parametrize('make', [FailureDetector, make_detector])
def test_a_reset_of_the_estimator_is_no_disturbance_and_no_failure(make):
    loop = Loop(integral=1.0, step=0.01)
    loop.detector = make(HEXAROTOR, motor_time_constant=0.0)
    loop.take_off()
    before = loop.controller.disturbances.estimate[2]
    # Half a metre per second in ten milliseconds: as if the thrust had fallen by fifty newton.
    loop.px4.resets, loop.px4.jump = 1, np.array([0.0, 0.0, 0.5])
    loop.run(0.02)
    assert abs(loop.controller.disturbances.estimate[2] - before) < 0.05
    loop.run(1.0)
    assert loop.detector.health.all()


@pytest.mark.parametrize('announced', [True, False])
def test_a_rotor_is_lost_in_flight(announced):
    loop = Loop(motor_time_constant=0.02, step=0.01)
    if not announced:
        loop.detector = FailureDetector(HEXAROTOR, motor_time_constant=0.0)
    loop.take_off(8.0)
    lost = HEXAROTOR.with_health([1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    loop.px4.plant.body = body_of(lost, PlantSettings())
    if announced:
        loop.use(accept(lost, 'drop').vehicle)
    assert loop.lowest(8.0) > 1.0
    assert abs(loop.px4.height - 2.0) < 0.2
    assert announced or loop.health_found[1] == 0.0
    last = next(each for name, each in loop.sent[::-1] if name == 'actuator_motors')
    # NaN stops a motor.
    assert np.isnan(last.control[:6]).tolist() == [False, True, False, False, False, False]
    assert loop.px4.outside == 0
    assert loop.px4.armed


# Refusals, set-points

def test_old_messages_are_refused():
    old = copy.copy(MESSAGES)
    names = ('position', 'velocity', 'acceleration', 'attitude', 'body_rate', 'actuator')
    old.OffboardControlMode = make_dataclass('OffboardControlMode', [
        (name, bool, False) for name in names])
    for interface in ('mode', 'offboard'):
        words = r'OffboardControlMode without direct_actuator: expected .* 1\.15 or newer'
        with pytest.raises(ParameterError, match=words):
            Rules(old, HEXAROTOR, Px4Settings(interface=interface), None)
    del old.RegisterExtComponentRequest
    old.OffboardControlMode = MESSAGES.OffboardControlMode
    with pytest.raises(ParameterError, match='no RegisterExtComponentRequest'):
        Rules(old, HEXAROTOR, Px4Settings(), None)
    Rules(old, HEXAROTOR, Px4Settings(interface='offboard'), None)


def test_topics_have_the_version_of_their_message():
    assert topic('out', 'vehicle_status', MESSAGES.VehicleStatus) == 'fmu/out/vehicle_status_v2'
    motors = topic('in', 'actuator_motors', MESSAGES.ActuatorMotors)
    assert motors == 'fmu/in/actuator_motors'


@pytest.mark.parametrize(('vehicle', 'words'), [
    ('rov', 'rotors reverse'), ('tricopter', 'takes fixed rotors only')])
def test_what_px4_cannot_have_is_refused(vehicle, words):
    with pytest.raises(ParameterError, match=words):
        Rules(MESSAGES, Vehicle.load(vehicle), Px4Settings(), None)


def test_set_points_are_for_simulation():
    with pytest.raises(ParameterError, match=r'set px4\.simulation to true'):
        Rules(MESSAGES, HEXAROTOR, Px4Settings(interface='setpoints'), None)
    sent, wrenches = [], []
    host = SimpleNamespace(
        send=lambda *given: sent.append(given), pass_wrench=lambda *given: wrenches.append(given))
    settings = Px4Settings(interface='setpoints', simulation=True)
    rules = Rules(MESSAGES, HEXAROTOR, settings, host)
    torque = MESSAGES.VehicleTorqueSetpoint(timestamp_sample=5000)
    with pytest.raises(ValueError, match='a torque without a thrust'):
        rules.receive('vehicle_torque_setpoint', torque)
    xyz = np.float32([0.0, 0.0, -0.5])
    thrust = MESSAGES.VehicleThrustSetpoint(timestamp_sample=5000, xyz=xyz)
    rules.receive('vehicle_thrust_setpoint', thrust)
    rules.receive('vehicle_torque_setpoint', torque)
    [(wrench, time)] = wrenches
    # Half of all motors' thrust.
    assert wrench[2] == pytest.approx(0.5 * HEXAROTOR.thrust_max.sum())
    assert time == 5_000_000
    rules.command(np.full(6, 200.0), False)
    assert not sent
    rules.command(np.full(6, 200.0), True)
    # PX4's own loops publish the thrust.
    assert [name for name, _ in sent] == ['actuator_motors']
    for _ in range(2):
        rules.tick()
    assert len(sent) == 1
