"""The monitor over DDS, and the nodes that heed it."""

import signal
from itertools import cycle

import numpy as np
import pytest
import sensor_msgs.msg as sensor_msgs
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.msg import Log
from std_msgs.msg import Float64MultiArray, Header
from std_srvs.srv import Trigger

import ca_ros
from ca_ros.control.waypoint import Waypoint
from ca_ros.detection.detector_settings import ImuSettings
from ca_ros.nodes import messages, topics
from ca_ros.nodes.messages import fill_imu, speeds_message, speeds_stamp, stamp, state_messages
from ca_ros.nodes.topics import STANDING
from ca_ros.simulation.closed_loop import fly
from ca_ros.simulation.plant import Plant
from ca_ros.simulation.plant_settings import PlantSettings
from ca_ros.simulation.rigid_body import RigidBody, velocity_in_body
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from ca_ros.testing import Diagnostics, wrench
from nodes import fly_over_ros, host

HOVER = (0.0, 0.0, 9.81, 0.0, 0.0, 0.0)
INSTANT = 'detector.motor_time_constant:=0.0'
ALONE = 'states have stopped: imu serves alone'


SERVOS = [
    f'{part}.{name}' for part in ('simulator', 'detector')
    for name in ('motor_time_constant:=0.02', 'servo_time_constant:=0.03', 'servo_rate:=6.0')
]
NOISE = [
    f'{part}.{name}' for part in ('simulator', 'detector')
    for name in ('velocity_noise:=0.1', 'angular_velocity_noise:=0.05')
]


IMU_POSITION = 'detector.imu_position:=[0.05, 0.0, 0.02]'
IMU = [IMU_POSITION, 'simulator.state_delay:=0.01']


@pytest.mark.slow
@pytest.mark.parametrize(('vehicle', 'changes', 'failure'), [
    pytest.param('hexarotor_realistic', [], '2@1.5', marks=pytest.mark.long),
    pytest.param('hexarotor_tilting', SERVOS, '2@1.5', marks=pytest.mark.long),
    ('hexarotor_tilting', SERVOS, '2@1.5=0.6rad'),
    # Its loss is not acted on.
    pytest.param('quadrotor', NOISE, '2@1.5', marks=pytest.mark.long),
    # At first its arm alone is named.
    ('x8', NOISE, '2@1.5'),
    ('hexarotor_realistic', IMU, '2@1.5'),
])
def test_a_flight_in_lockstep_is_the_one_offline_to_the_last_bit(
        graph, tmp_path, vehicle, changes, failure):
    case = Case.load(vehicle, changes)
    failures = RotorFailures((RotorFailure.parse(failure),), None)
    detection = case.detection('exact')
    offline = fly(
        case.controller(), case.allocator('exact'), case.plant(), Waypoint.of(1, 1, 1, np.pi / 4),
        1.8, detection=detection, failures=failures)
    offline.write_csv(tmp_path / 'offline.csv')
    flown = fly_over_ros(
        graph, tmp_path, case, 1.8, '--fail', failure, '--announce', 'never', '--detect')
    assert 1.5 < detection.found[0][0] / 1e9 < 1.6
    assert detection.found[0][2].arms == (((1, 2),) if vehicle == 'x8' else ())
    assert detection.detector.health.tolist()[:3] == [1.0, 0.0, 1.0]
    assert flown.read_bytes() == (tmp_path / 'offline.csv').read_bytes()


def health_message(*health):
    return Float64MultiArray(data=[float(share) for share in health])


class Allocator:
    """An allocator, and a publisher in place of the monitor."""

    def __init__(self, graph):
        self.graph, self.sent = graph, 0
        self.health = graph.node.create_publisher(Float64MultiArray, 'rotor_health', STANDING)
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        self.speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
        self.diagnostics = Diagnostics(graph)

    def start(self):
        process = self.graph.start('allocator', '--vehicle', 'hexarotor')
        self.parameters = self.graph.connect('allocator')
        return process

    def commands(self, condition, what):
        """Send the wrench of hover until the speeds that answer it meet a condition."""

        def met():
            self.sent += 1
            self.command.publish(wrench(HOVER, self.sent * 10**9, 'base_link'))
            return self.speeds and condition(np.array(self.speeds[-1].data))

        self.graph.spin_until(met, what)


def test_a_reset_gives_back_what_was_found_but_not_what_is_announced(graph):
    monitor = graph.start('monitor', '--vehicle', 'hexarotor')
    parameters = graph.connect('monitor')
    vehicle = Vehicle(graph)
    stopped, reports = [1, 0, 1, 1, 1, 1], vehicle.reports
    graph.spin_until(
        lambda: vehicle.fly(stopped, lambda health: health == stopped), 'rotor 2 is lost')
    parameters.set({'rotors.health': [1.0, 1.0, 1.0, 1.0, 0.5, 1.0]})
    diagnostics = Diagnostics(graph)

    def knows(health, *failed):
        diagnostics.wait(
            'monitor', lambda *status: status[2]['health'] == health, f'health {health}')
        found = [0.0 if i + 1 in failed else 1.0 for i in range(6)]
        graph.spin_until(lambda: list(reports[-1].data) == found, f'{failed} is found')

    knows('1, 0, 1, 1, 0.5, 1', 2)
    reset(graph)
    knows('1, 1, 1, 1, 0.5, 1')
    announced = graph.node.create_publisher(
        Float64MultiArray, 'rotor_health/announced', STANDING)
    for health in ([0, 1, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1]):
        announced.publish(health_message(*health))
        # This is known, but it is not found.
        knows(f'{health[0]}, 1, 1, 1, 0.5, 1')
    assert monitor.poll() is None


def reset(graph, name='monitor'):
    """Reset a monitor."""
    client = graph.node.create_client(Trigger, f'{name}/reset')
    assert client.wait_for_service(10.0)
    answer = client.call_async(Trigger.Request())
    graph.spin_until(answer.done, 'reset')
    assert answer.result().success
    graph.node.destroy_client(client)


def test_a_monitor_that_starts_again_gives_no_lost_rotor_back(graph):
    """It is told what was found, and tells an allocator that starts later."""
    monitor, *others = (
        graph.start(name, '--vehicle', 'hexarotor')
        for name in ('monitor', 'allocator', 'controller'))
    vehicle, diagnostics = Vehicle(graph), Diagnostics(graph)
    for name in ('monitor', 'allocator', 'controller'):
        graph.connect(name)
    reports = vehicle.reports

    def lost(rotors, words=''):
        for name in ('allocator', 'controller'):
            diagnostics.wait(
                name, lambda _, message, values: (
                    values['lost rotors'] == rotors and words in message), f'{rotors} lost')

    def found(*failed):
        turning = [0.0 if i + 1 in failed else 1.0 for i in range(6)]
        graph.spin_until(
            lambda: vehicle.fly(turning, lambda health: health == turning), f'{failed} found')

    found(2)
    lost('2')
    graph.end(monitor, signal.SIGKILL)
    reports.clear()
    graph.start('monitor', '--vehicle', 'hexarotor')
    graph.spin_until(lambda: reports, 'the new monitor')
    # It may have been told before its first word comes.
    assert list(reports[0].data) in ([1.0] * 6, [1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    lost('2', 'another monitor found, until monitor/reset: rotor 2 at 0')
    diagnostics.arrays.clear()
    diagnostics.wait(
        'monitor', lambda level, message, values: (
            level == b'\2' and 'rotor 2 at 0, found by another monitor' in message
            and values['health'] == '1, 0, 1, 1, 1, 1'), 'the new monitor knows')
    found(2, 4)
    lost('2, 4')
    for process in others:
        graph.end(process, signal.SIGKILL)
    diagnostics.arrays.clear()
    for name in ('allocator', 'controller'):
        graph.start(name, '--vehicle', 'hexarotor')
    lost('2, 4')
    reset(graph)
    lost('none')
    found(4)
    lost('4')


@pytest.mark.parametrize(('name', 'n', 'acted'), [
    ('quadrotor', 4, False), ('hexarotor', 6, True)])
def test_a_named_loss_is_acted_on_where_the_vehicle_still_hovers_level(graph, name, n, acted):
    """Elsewhere the monitor says why not; a loss that is announced counts in any case."""
    for node in ('monitor', 'allocator'):
        graph.start(node, '--vehicle', name)
    vehicle, diagnostics = Vehicle(graph), Diagnostics(graph)
    for node in ('monitor', 'allocator'):
        graph.connect(node)
    turning, sent = [1.0, 0.0, *[1.0] * (n - 2)], []

    def named():
        vehicle.fly(turning, bool)
        return any('rotor 2 lost' in message for _, message, _ in diagnostics.all('monitor'))

    graph.spin_until(named, 'rotor 2 is named')
    level, message, values = diagnostics.all('monitor')[-1]
    assert level == b'\2'
    assert ('not acted on: rotor 2' in message) != acted
    assert values['named, not acted on'] == ('none' if acted else '2')
    assert values['lost rotors'] == '2'
    assert list(vehicle.reports[-1].data) == (turning if acted else [1.0] * n)

    announced = graph.publisher(Float64MultiArray, 'rotor_health/announced', STANDING)
    command = graph.publisher(WrenchStamped, 'command/wrench')
    answers = graph.listen(Float64MultiArray, 'command/motor_speed')

    def turns(expected):
        def asked():
            sent.append(wrench(HOVER, (vehicle.sent + len(sent)) * 10**7, 'base_link'))
            command.publish(sent[-1])
            return answers and (answers[-1].data[1] > 0.0) == expected

        graph.spin_until(asked, f'rotor 2 turns: {expected}')

    turns(not acted)
    announced.publish(health_message(*turning))
    turns(False)


def test_a_reset_of_one_monitor_does_not_give_back_what_another_one_has_found(graph):
    start = 'monitor', '--vehicle', 'hexarotor'
    graph.start('allocator', '--vehicle', 'hexarotor')
    graph.start(*start)
    vehicle, diagnostics = Vehicle(graph), Diagnostics(graph)
    held = graph.listen(Float64MultiArray, 'rotor_health/held', STANDING)
    for name in ('monitor', 'allocator'):
        graph.connect(name)
    stopped = [1, 0, 1, 1, 1, 1]
    graph.spin_until(lambda: vehicle.fly(stopped, lambda health: health == stopped), 'found')
    graph.start(*start, '--ros-args', '-r', '__node:=second')

    def says(name, condition, what):
        diagnostics.arrays.clear()
        diagnostics.wait(name, condition, what)

    def told(*status):
        return 'rotor 2 at 0, found by another monitor' in status[1]

    says('second', told, 'the second one is told')
    for name, lost in (('second', '2'), ('monitor', 'none')):
        before = len(held)
        reset(graph, name)
        graph.spin_until(
            lambda before=before: any(
                messages.origin_of(each).startswith('reset') for each in held[before:]),
            f'the reset of {name} is known')
        says('allocator', lambda *status, lost=lost: status[2]['lost rotors'] == lost,
             f'{lost} after a reset of {name}')
    says('second', lambda *status: not told(*status), 'the second one has nothing to tell')


class Vehicle:
    """What a monitor hears of a vehicle in hover."""

    def __init__(self, graph):
        self.graph, self.sent = graph, 0
        self.reports = graph.listen(Float64MultiArray, 'rotor_health', STANDING)
        self.pose = graph.publisher(PoseStamped, 'local_position/pose')
        self.velocity = graph.publisher(TwistStamped, 'local_position/velocity_body')
        self.command = graph.publisher(Float64MultiArray, 'command/motor_speed')
        self.measured = graph.publisher(Float64MultiArray, 'motor_speed/measured')

    @property
    def time(self):
        return self.sent * 10_000_000

    def state(self, velocity=0.0, frames=('', ''), **attitude):
        pose, twist = (
            kind(header=Header(stamp=stamp(self.time), frame_id=frame))
            for kind, frame in zip((PoseStamped, TwistStamped), frames, strict=True))
        for name, number in attitude.items():
            setattr(pose.pose.orientation, name, number)
        twist.twist.linear.x = velocity
        self.pose.publish(pose)
        self.velocity.publish(twist)

    def fly(self, turning, condition):
        """Return whether a condition holds of the health, after a further step."""
        self.sent += 1
        self.state(w=1.0)
        self.command.publish(speeds_message(np.full(len(turning), 250.0), self.time))
        self.measured.publish(speeds_message(250.0 * np.array(turning), self.time))
        return bool(self.reports) and condition(list(self.reports[-1].data))


def test_in_lockstep_the_monitor_asks_again_for_a_command_that_it_has_not_got(graph):
    """The allocator's first command may be sent before the two know of each other."""
    graph.start('monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', 'mode:=lockstep')
    graph.connect('monitor')
    vehicle = Vehicle(graph)

    def told():
        return [speeds_stamp(report) for report in vehicle.reports]

    graph.spin_until(lambda: 0 in told(), 'the first state', repeat=lambda: vehicle.state(w=1.0))
    vehicle.sent = 1
    vehicle.state(w=1.0)
    before = len(told())
    graph.spin_until(
        lambda: 0 in told()[before:], 'its health again', repeat=lambda: vehicle.state(w=1.0))
    assert 10_000_000 not in told()
    vehicle.command.publish(speeds_message(np.full(6, 250.0), 0))
    graph.spin_until(lambda: told()[-1] == 10_000_000, 'the health of the next state')
    # Others may not wait for it: a later command says that the one before does not come.
    vehicle.sent = 2
    vehicle.state(w=1.0)
    vehicle.command.publish(speeds_message(np.full(6, 250.0), 20_000_000))
    vehicle.sent = 3
    vehicle.state(w=1.0)
    graph.spin_until(lambda: told()[-1] == 30_000_000, 'the health of a state after it')


def test_no_message_ends_or_blinds_the_monitor(graph):
    monitor = graph.start('monitor', '--vehicle', 'hexarotor')
    graph.connect('monitor')
    vehicle, diagnostics = Vehicle(graph), Diagnostics(graph)
    graph.spin_until(lambda: vehicle.fly(np.ones(6), lambda health: vehicle.sent > 20), 'flies')
    speeds, reasons = np.full(6, 250.0), ['length', 'numbers', 'sign', 'bounds', 'speeds', 'state']
    numbers = 1e5, 1e100, -1e300, np.nan, np.inf, -50.0
    labels = 2**63, 2**64 - 1, 10**18, 2**31 * 10**9 - 1
    wrong = cycle([
        *(speeds_message(np.array([number, *speeds[1:]]), 0) for number in numbers),
        *(speeds_message(speeds, label) for label in labels), Float64MultiArray(data=[1.0, 2.0]),
    ])
    states = cycle([(np.nan, 1.0), (1e300, 1.0), (-np.inf, 1.0), (0.0, 0.0), (0.0, 1e-320)])

    def all_wrong(*status):
        for topic in (vehicle.command, vehicle.measured):
            topic.publish(next(wrong))
        velocity, w = next(states)
        vehicle.sent += 1
        vehicle.state(velocity, w=w)
        return all(f'dropped: {reason}' in status[2] for reason in reasons)

    diagnostics.wait('monitor', all_wrong, 'all that is wrong is counted')
    stopped = np.array([1, 0, 1, 1, 1, 1])

    def old(*status):
        vehicle.fly(np.ones(6), bool)
        late = vehicle.time - 200_000_000
        vehicle.measured.publish(speeds_message(250.0 * stopped, late))
        return 'dropped: age' in status[2]

    diagnostics.wait('monitor', old, 'old speeds are counted')
    assert list(vehicle.reports[-1].data) == [1.0] * 6
    graph.spin_until(
        lambda: vehicle.fly(stopped, lambda health: health == stopped.tolist()), 'a loss is found')
    diagnostics.wait(
        'monitor', lambda *status: status[2]['lost rotors'] == '2', 'the values name the rotor')
    assert monitor.poll() is None


@pytest.mark.parametrize(('frames', 'words'), [
    (('odom', 'base_link'), "state in 'odom': expected map (parameter world_frame)"),
    (('map', 'map'), "state in 'map': expected base_link (parameter command_frame)"),
])
def test_the_monitor_drops_states_in_another_frame(graph, frames, words):
    graph.start('monitor', '--vehicle', 'hexarotor')
    parameters = graph.connect('monitor')
    vehicle, diagnostics = Vehicle(graph), Diagnostics(graph)
    log = graph.listen(Log, '/rosout')

    def told(*status):
        vehicle.sent += 1
        vehicle.state(frames=frames, w=1.0)
        dropped = any(words in line.msg for line in log)
        return dropped and 'no state yet' in status[1] and 'dropped: frame' in status[2]

    diagnostics.wait('monitor', told, 'dropped')
    parameters.set({'world_frame': frames[0], 'command_frame': frames[1]})

    def used(*status):
        vehicle.sent += 1
        vehicle.state(frames=frames, w=1.0)
        return 'on the ground' in status[1]

    diagnostics.wait('monitor', used, 'used')


class Imu:
    """A vehicle in hover, as a monitor hears it once it has started, in steps of 5 ms.

    - `sends_states`, `sends_imu`: whether it does; every fourth step has a state
    - `ahead`: by what the clock of the Imu is [ns]
    - `clock`: by what the stamps of all messages are ahead of the time of flight [ns]
    """

    def __init__(self, graph, sends_states=True):
        vehicle = ca_ros.Vehicle.load('hexarotor')
        imu = ImuSettings(imu_position=[0.05, 0.0, 0.02])
        self.plant = Plant(RigidBody(vehicle), PlantSettings(time_step=0.005), imu=imu)
        self.speeds = np.sqrt(vehicle.weight / 6 / vehicle.thrust_per_squared_speed)
        self.reading, self.clock, self.ahead = np.ones(3), 0, 0
        self.sends_states, self.sends_imu = sends_states, True
        self.graph, self.diagnostics = graph, Diagnostics(graph)
        self.imu = graph.publisher(sensor_msgs.Imu, 'imu')
        self.pose = graph.publisher(PoseStamped, 'local_position/pose')
        self.velocity = graph.publisher(TwistStamped, 'local_position/velocity_body')
        self.command = graph.publisher(Float64MultiArray, 'command/motor_speed')
        self.health = graph.listen(Float64MultiArray, 'rotor_health', STANDING)

    def start(self):
        """Wait until the monitor hears it; fly from then on."""
        self.graph.connect('monitor')
        self.graph.node.create_timer(0.005, self._fly)

    def _fly(self):
        state, time = self.plant.step(self.speeds), self.plant.elapsed + self.clock
        if self.sends_imu:
            header = Header(stamp=stamp(time + self.ahead))
            measured = self.reading * self.plant.specific_force
            self.imu.publish(fill_imu(sensor_msgs.Imu(), header, state[10:], measured))
        header = Header(stamp=stamp(time))
        if self.sends_states and time % 20_000_000 == 0:
            parts = state[:3], state[6:10], velocity_in_body(state), state[10:]
            pose, velocity = state_messages(*parts, header.stamp, '', '')
            self.pose.publish(pose)
            self.velocity.publish(velocity)
        self.command.publish(speeds_message(self.speeds, time))

    def wait(self, words, level=None):
        """Wait until the diagnostics of the monitor say some words, at a level."""
        return self.diagnostics.wait(
            'monitor', lambda *status: words in status[1] and level in (None, status[0]), words)

    def fly_for(self, seconds):
        """Wait until it has flown for a time; nothing is found."""
        begun = self.plant.elapsed
        self.graph.spin_until(
            lambda: self.plant.elapsed > begun + seconds * 1e9, f'{seconds} s of flight')
        assert not self.health or list(self.health[-1].data) == [1.0] * 6

    def lose_rotor(self):
        """Lose rotor 2; return after what time it is named, and no other [s].

        What it has left is not compared: a loaded machine loses messages.
        """
        failed = self.plant.elapsed / 1e9 + 0.01
        self.plant.failures = RotorFailures.read([f'2@{failed}'])

        def named():
            left = self.health[-1].data if self.health else ()
            return [each < 1.0 for each in left] == [False, True, *[False] * 4]

        self.graph.spin_until(named, 'rotor 2 is named')
        return speeds_stamp(self.health[-1]) / 1e9 - failed


@pytest.mark.parametrize('states', [False, True])
def test_an_imu_of_its_own_rate_serves_alone_or_beside_the_states(graph, states):
    monitor = graph.start(
        'monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', IMU_POSITION)
    vehicle = Imu(graph, sends_states=states)
    vehicle.start()
    vehicle.fly_for(0.5)
    assert 0.0 < vehicle.lose_rotor() < 0.5
    wrong = sensor_msgs.Imu()
    wrong.linear_acceleration.z = np.nan
    count = 'states without a specific force'

    def counted(least, most):
        def met(*status):
            vehicle.imu.publish(wrong)
            found = int(status[2].get(count, 0))
            return 'dropped: imu' in status[2] and least <= found < most

        return met

    # The first states may come before the two have found each other.
    vehicle.diagnostics.wait('monitor', counted(0, 10), 'most of 30 states have a force')
    if states:
        vehicle.sends_imu = False
        vehicle.diagnostics.wait('monitor', counted(10, np.inf), 'without the imu none has')
    assert monitor.poll() is None


@pytest.mark.parametrize(('ahead', 'words'), [
    (300_000_000, 'is ahead of the states by more than 100 ms: its clock is, or they come late'),
    (-300_000_000, 'is behind the states')])
def test_the_force_of_an_imu_with_another_clock_is_not_used_and_the_monitor_says_so(
        graph, ahead, words):
    graph.start('monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', IMU_POSITION)
    vehicle = Imu(graph)
    vehicle.ahead = ahead
    vehicle.start()
    _, message, _ = vehicle.wait(words, level=b'\1')
    assert 'clock' in message
    vehicle.fly_for(1.0)
    assert 0.0 < vehicle.lose_rotor() < 0.4


def test_the_monitor_says_that_an_imu_is_ahead_of_the_states_and_uses_it(graph):
    """Its clock may be ahead, or the states may come late."""
    graph.start('monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', IMU_POSITION)
    vehicle, log = Imu(graph), graph.listen(Log, '/rosout')
    words = 'imu is ahead of the states by more than 30 ms: its clock is, or they come late'

    def says(ahead, expected):
        def met(_, message, values):
            found = float(values.get('imu ahead of the states [ms]', -1.0))
            return (words in message) == expected and abs(found - ahead) <= 10

        vehicle.ahead = ahead * 1_000_000
        return vehicle.diagnostics.wait('monitor', met, f'{ahead} ms')

    vehicle.start()
    says(20, expected=False)
    _, message, values = says(50, expected=True)
    graph.spin_until(lambda: any(words in line.msg for line in log), 'a line in the log')
    assert sum(words in line.msg for line in log) == 1
    assert 'not used' not in message
    assert int(values['states without a specific force']) < 10


def test_an_imu_in_another_unit_is_not_used_and_the_monitor_says_so(graph):
    graph.start(
        'monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', IMU_POSITION, '-p', INSTANT)
    vehicle, words = Imu(graph), 'imu is not used: its specific force is'
    vehicle.reading /= 9.81
    vehicle.speeds *= 1.01  # it climbs: what does not move might stand
    vehicle.start()
    vehicle.wait(words, level=b'\1')
    vehicle.fly_for(0.7)
    assert 0.0 < vehicle.lose_rotor() < 0.2
    # It does not serve alone, either.
    vehicle.sends_states = False
    vehicle.wait(f'no state ({words}', level=b'\2')


def test_an_imu_serves_alone_after_states_have_stopped_until_they_return(graph):
    graph.start(
        'monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', IMU_POSITION,
        '-p', 'command_timeout:=5.0', '-p', INSTANT)
    vehicle = Imu(graph)
    vehicle.start()
    for _ in range(2):
        vehicle.sends_states = True
        vehicle.fly_for(0.1)
        vehicle.wait('on the ground')
        vehicle.sends_states = False
        vehicle.wait(ALONE)
    vehicle.fly_for(2.0)
    assert 0.0 < vehicle.lose_rotor() < 0.5


def test_the_log_says_that_states_have_returned_when_they_have_and_not_before(graph):
    graph.start(
        'monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', IMU_POSITION,
        '-p', 'command_timeout:=1.0', '-p', INSTANT)
    vehicle, log = Imu(graph), graph.listen(Log, '/rosout')
    returned = 'states have returned'

    def count(words):
        return sum(line.msg == words for line in log)

    vehicle.start()
    vehicle.fly_for(0.1)
    vehicle.wait('on the ground')
    vehicle.sends_states = vehicle.sends_imu = False
    graph.spin_until(lambda: count('no state for 1 s'), 'a timeout')
    vehicle.sends_imu = True
    vehicle.wait(ALONE)
    graph.spin_until(lambda: count(ALONE), 'a line in the log')
    assert count(returned) == 0
    # The imu stops, too, and returns.
    vehicle.sends_imu = False
    graph.spin_until(lambda: count('no state for 1 s') == 2, 'a second timeout')
    vehicle.sends_imu = True
    graph.spin_until(lambda: count(ALONE) == 2, 'a second line in the log')
    vehicle.sends_states = True
    vehicle.wait('on the ground')
    graph.spin_until(lambda: count(returned), 'a line in the log')
    assert (count(ALONE), count(returned)) == (2, 1)


def test_an_imu_that_comes_without_its_place_is_said_once(graph):
    log = graph.listen(Log, '/rosout')
    graph.start('monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', INSTANT)
    graph.connect('monitor')
    diagnostics, words = Diagnostics(graph), 'comes, but is not used: detector.imu_position'
    diagnostics.wait('monitor', lambda *status: 'imu' not in status[2], 'no imu')
    graph.publisher(sensor_msgs.Imu, 'imu')
    for _ in range(2):
        diagnostics.wait(
            'monitor', lambda *status: words in status[2].get('imu', ''), 'an imu comes')
    graph.spin_until(lambda: any(words in line.msg for line in log), 'a line in the log')
    assert sum(words in line.msg for line in log) == 1


@pytest.mark.parametrize(('given', 'times'), [([], 1), (['-p', INSTANT], 0)])
def test_a_monitor_without_a_lag_says_so_at_its_start_and_on_diagnostics(
        graph, given, times, capfd):
    diagnostics, words = Diagnostics(graph), 'detector.motor_time_constant: taken as 0; motors'
    node = host(graph, 'monitor', *given)
    level = b'\1' if times else b'\3'
    diagnostics.wait('monitor', lambda *status: status[0] == level, 'what it says')
    assert diagnostics.all('monitor')[-1].message.count(words) == times
    assert capfd.readouterr().err.count(words) == times
    node.destroy_node()


def test_the_monitor_says_when_no_rotor_is_tested(graph):
    graph.start(
        'monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', IMU_POSITION, '-p', INSTANT)
    vehicle = Imu(graph)
    vehicle.speeds *= 1.01  # it climbs: what does not move might stand
    vehicle.start()
    vehicle.wait('all rotors deliver their thrust', level=b'\0')
    vehicle.diagnostics.arrays.clear()
    reset(graph)
    vehicle.wait('no rotor is tested', level=b'\1')
    vehicle.wait('all rotors deliver their thrust', level=b'\0')


def test_a_clock_that_steps_back_long_after_a_restart_does_not_blind_the_monitor(graph):
    graph.start(
        'monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', IMU_POSITION, '-p', INSTANT)
    vehicle, restarts = Imu(graph), graph.publisher(Header, topics.STATE_RESTART.name)
    vehicle.speeds *= 1.01  # it climbs: what does not move might stand
    vehicle.clock = 1_000_000_000_000
    vehicle.start()
    vehicle.wait('all rotors deliver their thrust')
    restarts.publish(Header(stamp=stamp(vehicle.plant.elapsed + vehicle.clock)))
    vehicle.diagnostics.wait(
        'monitor', lambda *status: status[2].get('restarts') == '1', 'the restart is known')
    vehicle.wait('all rotors deliver their thrust')
    vehicle.clock -= 900_000_000_000
    for words in 'no rotor is tested', 'all rotors deliver their thrust':
        vehicle.diagnostics.arrays.clear()
        vehicle.wait(words)


def test_the_monitor_says_what_the_stamps_of_states_lack(graph):
    graph.start('monitor', '--vehicle', 'hexarotor', '--ros-args', '-p', INSTANT)
    vehicle, diagnostics = Vehicle(graph), Diagnostics(graph)
    graph.connect('monitor')

    def unequal(*status):
        vehicle.pose.publish(PoseStamped())
        vehicle.velocity.publish(TwistStamped(header=Header(stamp=stamp(5))))
        return status[1] == 'no pose and velocity with the same stamp yet'

    def unset(*status):
        vehicle.state(w=1.0)
        return status[1] == 'no state with a new stamp'

    diagnostics.wait('monitor', unequal, 'two stamps')
    diagnostics.wait('monitor', unset, 'one stamp')


def lost(*rotors):
    return lambda speeds: (np.flatnonzero(speeds == 0.0) + 1).tolist() == [*rotors]


def test_the_allocator_uses_the_least_health_and_knows_it_after_a_restart(graph):
    allocator = Allocator(graph)
    process = allocator.start()
    allocator.commands(lost(), 'six rotors turn')
    allocator.health.publish(health_message(1, 0, 1, 1, 1, 1))
    allocator.commands(lost(2), 'rotor 2 is lost')
    # Nonsense is refused, and what was sound before holds.
    def refused(count):
        return lambda *status: status[2].get('refused health') == str(count)

    for i, nonsense in enumerate(([1, 1], [1, 2, 1, 1, 1, 1], [1, np.nan, 1, 1, 1, 1])):
        allocator.health.publish(health_message(*nonsense))
        allocator.diagnostics.wait('allocator', refused(i + 1), 'refused')
    allocator.commands(lost(2), 'rotor 2 is still lost')
    # The parameter does not give it back.
    allocator.parameters.set({'rotors.health': [0.0, 1.0, 1.0, 1.0, 1.0, 1.0]})
    allocator.commands(lost(1, 2), 'rotors 1 and 2 are lost')
    allocator.health.publish(health_message(1, 1, 1, 1, 1, 1))
    allocator.commands(lost(1), 'rotor 1 is lost, which the parameter says')
    allocator.health.publish(health_message(1, 1, 0, 1, 1, 1))
    allocator.commands(lost(1, 3), 'rotor 3 is lost')
    process.terminate()
    graph.outlive(process)
    allocator.speeds.clear()
    graph.start('allocator', '--vehicle', 'hexarotor')
    allocator.commands(lost(3), 'a new allocator knows of rotor 3')
    graph.node.destroy_publisher(allocator.health)

    def warned(level, message, _):
        return level > b'\0' and 'the publisher of rotor_health has ended' in message

    allocator.diagnostics.wait('allocator', warned, 'a warning that the monitor has ended')
    allocator.commands(lost(3), 'rotor 3 is still lost')


def test_of_two_monitors_each_replaces_what_it_has_found_itself_until_a_reset(graph):
    allocator = Allocator(graph)
    allocator.start()

    def say(origin, *failed):
        health = np.array([0.0 if i + 1 in failed else 1.0 for i in range(6)])
        message = messages.health_message(health, (), origin)
        allocator.health.publish(messages.fill_speeds(message, health, None))

    for origin, failed, together in (
        ('start 1', [2], [2]), ('start 2', [], [2]), ('start 2', [3], [2, 3]),
        ('start 1', [4], [3, 4]), ('reset 3', [], []), ('start 2', [3], [3]),
        ('reset 3', [2], [2, 3]), ('reset 4', [6], [6]),
    ):
        say(origin, *failed)
        allocator.commands(lost(*together), f'{origin}: {failed}')


def test_an_arm_counts_no_more_where_a_later_monitor_tells_which_rotor_has_failed(graph):
    graph.start('allocator', '--vehicle', 'x8')
    publisher = graph.node.create_publisher(Float64MultiArray, 'rotor_health', STANDING)
    diagnostics, half = Diagnostics(graph), (0.5, 0.5)
    for origin, health, arms, together in (
        ('start 1', half, [(1, 2)], '0.5, 0.5'), ('start 2', (1, 1), [], '0.5, 0.5'),
        ('start 2', (0, 1), [], '0, 1'), ('start 2', (1, 0), [], '1, 0'),
        ('start 2', (0, 0), [], '0, 0'), ('start 1', (1, 1), [], '0, 0'),
        ('reset 3', (0, 1), [], '0, 1'), ('start 4', half, [(1, 2)], '0, 0.5'),
        ('reset 5', half, [(1, 2)], '0.5, 0.5'), ('start 6', half, [(1, 2)], '0.5, 0.5'),
        ('start 6', (0, 1), [], '0, 1'),
    ):
        said = np.array([*health, *[1.0] * 6])
        message = messages.health_message(said, arms, origin)
        publisher.publish(messages.fill_speeds(message, said, None))
        diagnostics.wait(
            'allocator', lambda *status, together=together: status[2].get(
                'health in use', '').startswith(f'{together}, 1, '), f'{origin}: {health}')


def test_an_allocator_that_starts_late_knows_what_each_of_two_monitors_has_found(graph):
    publishers = []
    for origin, health in (('start 1', [1, 0, 1, 1, 1, 1]), ('start 2', [1, 1, 0, 1, 1, 1])):
        publishers.append(
            graph.node.create_publisher(Float64MultiArray, 'rotor_health', STANDING))
        health = np.array(health, float)
        message = messages.health_message(health, (), origin)
        publishers[-1].publish(messages.fill_speeds(message, health, None))
    Allocator(graph).start()
    Diagnostics(graph).wait(
        'allocator', lambda *status: status[2]['lost rotors'] == '2, 3', 'both are lost')


def test_of_many_monitors_what_the_oldest_found_is_kept_together_until_a_reset(graph):
    allocator = Allocator(graph)
    allocator.start()

    def say(origin, *health):
        said = np.array(health, float)
        message = messages.health_message(said, (), origin)
        allocator.health.publish(messages.fill_speeds(message, said, None))

    say('start 1', 1, 0, 1, 1, 1, 1)
    allocator.commands(lost(2), 'the first is heard')
    for k in range(2, 21):
        say(f'start {k}', 1, 1, 1, 1, 1, 1 - k / 100)
        allocator.diagnostics.wait(
            'allocator', lambda *status, k=k: f', {1 - k / 100:.3g}' in status[2].get(
                'health in use', ''), f'start {k}')

    def kept(_, message, values):
        return message.count('another monitor found') == 7 and values['lost rotors'] == '2'

    allocator.diagnostics.wait('allocator', kept, 'seven beside the newest')
    say('reset 21', 1, 1, 1, 1, 1, 1)
    allocator.commands(lost(), 'none is lost')
