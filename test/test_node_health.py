"""The health that an allocator obeys, under messages that come close together, and how soon."""

import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64MultiArray

from ca_ros import Exact, Vehicle, make_allocator
from ca_ros.allocation.reconfiguration import Reconfiguration
from ca_ros.nodes.messages import speeds_message
from ca_ros.nodes.rotors import Rotors
from ca_ros.nodes.topics import STANDING
from ca_ros.parameter_files import load
from ca_ros.problem.vehicle_problem import problem_of
from ca_ros.testing import Diagnostics, wrench
from ca_ros.vehicle.files import shipped_tilting, shipped_vehicles
from ca_ros.vehicle.settings import AXES
from strategies import LONG, length, sixteen_rotors

SIXTEEN = 'sixteen rotors'

SHIPPED = sorted({**shipped_vehicles(), **shipped_tilting()})

VEHICLES = length(
    ['hexarotor', 'hexarotor_tilting', SIXTEEN],
    ['hexarotor', 'rov', 'hexarotor_tilting', 'tricopter', 'omnidirectional_gimbals', SIXTEEN])
PAIRS = length(12, 60)
APART = 0.001, 0.002, 0.004  # time between two messages [s]
FLOOD = length(0.7, 10.0)  # time of a flood [s]
SETTLING = 5.0  # greatest time until a loaded machine has taken what was sent [s]
RATES = length([2000.0], [100.0, 500.0, 2000.0, 5000.0])  # of its messages, at most [Hz]

CHANGES = length(6, 30, 100)  # of which that time is measured

LATENCY_MAX = 0.005  # median from a message of health to the first command that obeys it [s]
BUILD_MAX = 0.003  # audit, set-up and first answer, median for each lost rotor [s]
AROUND = 0.05  # time before and after a message of health in which commands are watched [s]


def demand(vehicle):
    """Return a wrench (6,) near hover for which all rotors run: one that rests is lost."""
    problem = problem_of(vehicle)
    method, rng = Exact(problem), np.random.default_rng(0)
    while True:
        u = problem.reference + 0.1 * problem.extent * rng.uniform(-1.0, 1.0, len(problem.axes))
        if (method.allocate(u).speeds != 0.0).all():
            found = np.zeros(6)
            found[[AXES.index(axis) for axis in vehicle.axes]] = u
            return found


class Flown:
    """An allocator that is sent wrenches near hover, and the publisher of its health."""

    def __init__(self, graph, folder, vehicle, *words):
        self.graph, self.sent, self.answers = graph, 0, {}
        file = vehicle
        if vehicle == SIXTEEN:
            file = str(folder / 'sixteen.yaml')
            Path(file).write_text(yaml.safe_dump({'/**': {'ros__parameters': sixteen_rotors()}}))
        self.vehicle = Vehicle.load(file)
        self.demand, self.n = demand(self.vehicle), self.vehicle.n
        self.health = graph.node.create_publisher(Float64MultiArray, 'rotor_health', STANDING)
        self.command = graph.publisher(WrenchStamped, 'command/wrench')
        self.speeds = graph.listen(Float64MultiArray, 'command/motor_speed')
        self.diagnostics = Diagnostics(graph)
        self.process = graph.start('allocator', '--vehicle', file, *words)
        self.parameters = graph.connect('allocator')
        graph.spin_until(self.health.get_subscription_count, 'the health has a reader')
        self.setting = graph.node.create_client(SetParameters, 'allocator/set_parameters')
        asked = []
        # Before the node has discovered the client, an answer may be lost.
        graph.spin_until(
            lambda: any(each.done() for each in asked), 'an answer to the client',
            repeat=lambda: asked.append(self.set('rotors.health', 1.0)))

    def lose(self, *rotors):
        """Publish that these rotors are lost, and no others."""
        health = np.ones(self.n)
        health[np.array(rotors, int) - 1] = 0.0
        self.health.publish(Float64MultiArray(data=health.tolist()))

    def rest(self):
        """Send a wrench; return the rotors that stand still in the newest answer, from 1."""
        self.sent += 1
        message = wrench(self.demand, self.sent * 10**9, 'base_link')
        label = f'stamp {self.sent * 10**9}'
        self.graph.spin_until(
            lambda: self.speeds and self.speeds[-1].layout.dim[1].label == label,
            'an answer', repeat=lambda: self.command.publish(message))
        speeds = np.array(self.speeds[-1].data)
        return (np.flatnonzero(speeds == 0.0) + 1).tolist()

    def set(self, name, value):
        """Ask for a change of a parameter; return the future of the answer."""
        return self.setting.call_async(SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]))

    def settled(self, *rotors):
        """Tell whether after all that was sent exactly these rotors are lost."""
        end = time.monotonic() + SETTLING
        while time.monotonic() < end:
            if self.rest() == [*rotors]:
                return True
            time.sleep(0.02)
        return False


@pytest.mark.parametrize('vehicle', VEHICLES)
def test_of_two_messages_the_newer_one_holds_however_close_they_come(
        graph, tmp_path, vehicle):
    flown, older = Flown(graph, tmp_path, vehicle), []
    for pair in range(PAIRS):
        one, two = pair % flown.n + 1, (pair + 1) % flown.n + 1
        flown.lose(one)
        time.sleep(APART[pair % len(APART)])
        flown.lose(two)
        if not flown.settled(two):
            older.append(pair)
    assert older == []


def test_a_loss_that_comes_while_a_parameter_is_set_holds(graph, tmp_path):
    flown, lost = Flown(graph, tmp_path, 'hexarotor_tilting'), []
    for pair in range(PAIRS):
        rotor = pair % flown.n + 1
        asked = flown.set('allocation.exact.residual_slack', 1e-9 * (pair % 2 + 1))
        time.sleep(APART[pair % len(APART)])
        flown.lose(rotor)
        graph.spin_until(asked.done, 'an answer')
        if not flown.settled(rotor):
            lost.append(pair)
    assert lost == []


@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('vehicle', VEHICLES)
def test_a_flood_of_health_ends_no_node_and_the_last_message_holds(
        graph, tmp_path, vehicle, rate):
    """Beside changes of parameters, and for one vehicle of the voltage."""
    words = ['--ros-args', '-p', 'rotors.speed_max_per_volt:=25.0', '-p',
             'rotors.battery_voltage:=16.0'] if vehicle == 'hexarotor' else []
    flown, sent, asked = Flown(graph, tmp_path, vehicle, *words), 0, []
    battery = graph.publisher(BatteryState, 'battery')

    def send():
        nonlocal sent
        flown.lose(sent % flown.n + 1)
        battery.publish(BatteryState(voltage=15.0 + sent % 10 / 5.0))
        sent += 1
        if sent % 50 == 1:
            asked.append(flown.set('rotors.health', 1.0 - 0.001 * (sent % 3)))

    flood, end = graph.node.create_timer(1.0 / rate, send), time.monotonic() + FLOOD
    graph.spin_until(lambda: time.monotonic() > end, 'a flood')
    flood.cancel()
    flown.lose(2)
    assert flown.settled(2)
    assert flown.process.poll() is None
    graph.spin_until(lambda: any(each.done() for each in asked), 'an answer')
    if words:
        battery.publish(BatteryState(voltage=14.0))
        flown.diagnostics.wait(
            'allocator', lambda *status: status[2].get('voltage in use [V]') == '14',
            'the last voltage')


@pytest.mark.parametrize('vehicle', length(['hexarotor_tilting'], VEHICLES))
def test_in_lockstep_each_wrench_gets_the_answer_of_the_health_with_its_stamp(
        graph, tmp_path, vehicle):
    """Among older health, health that is no health, and wrenches that come twice or first."""
    flown = Flown(
        graph, tmp_path, vehicle, '--ros-args', '-p', 'mode:=lockstep', '-p', 'await_health:=true')
    sound, rng = make_allocator('exact', flown.vehicle), np.random.default_rng(0)
    rows = [AXES.index(axis) for axis in flown.vehicle.axes]
    for step in range(1, length(40, 1500)):
        time, health = step * 10**7, rng.choice([0.0, 0.5, 1.0], flown.n, p=[0.1, 0.2, 0.7])
        expected = sound.with_health(health).allocate(flown.demand[rows]).command[:flown.n]
        asked = wrench(flown.demand, time, 'base_link')
        told = speeds_message(health, time, 'rotor health')
        order = [flown.command.publish, flown.health.publish]
        others = [
            (order[1], speeds_message(rng.permutation(health), time - 10**7, 'rotor health')),
            (order[1], Float64MultiArray(data=[2.0] * flown.n)),
            (order[0], asked), (order[1], told)]
        for publish, message in [*(others[i] for i in rng.permutation(4)), (order[1], told)]:
            publish(message)
        label = f'stamp {time}'
        graph.spin_until(
            lambda label=label: flown.speeds and flown.speeds[-1].layout.dim[1].label == label,
            'an answer', repeat=lambda asked=asked: flown.command.publish(asked))
        answers = [each for each in flown.speeds if each.layout.dim[1].label == label]
        for each in answers:
            np.testing.assert_array_equal(each.data, expected)


def test_in_lockstep_a_wrench_that_waits_gets_no_answer_from_older_health(graph, tmp_path):
    flown = Flown(
        graph, tmp_path, 'hexarotor', '--ros-args', '-p', 'mode:=lockstep', '-p',
        'await_health:=true')
    for _ in range(5):
        flown.command.publish(wrench(flown.demand, 10**7, 'base_link'))
        flown.parameters.get('mode')
        flown.health.publish(speeds_message(np.ones(flown.n), 0, 'rotor health'))
        flown.parameters.get('mode')
    assert flown.speeds == []
    flown.health.publish(speeds_message(np.ones(flown.n), 10**7, 'rotor health'))
    graph.spin_until(lambda: flown.speeds, 'an answer')


def test_in_lockstep_health_that_comes_again_gets_the_answer_again(graph, tmp_path):
    """Its giver has not got it; without an answer there is none to give."""
    flown = Flown(
        graph, tmp_path, 'hexarotor', '--ros-args', '-p', 'mode:=lockstep', '-p',
        'await_health:=true')
    told = speeds_message(np.ones(flown.n), 0, 'rotor health')
    flown.health.publish(told)
    flown.health.publish(told)
    flown.parameters.get('mode')
    assert flown.speeds == []
    asked = wrench(flown.demand, 0, 'base_link')
    graph.spin_until(
        lambda: flown.speeds, 'an answer', repeat=lambda: flown.command.publish(asked))
    flown.parameters.get('mode')
    before = len(flown.speeds)
    flown.health.publish(told)
    graph.spin_until(lambda: len(flown.speeds) > before, 'the answer again')
    first, *_, last = flown.speeds
    assert first == last
    assert last.layout.dim[1].label == 'stamp 0'


@pytest.mark.parametrize('vehicle', length(['hexarotor_tilting'], SHIPPED))
def test_the_first_command_after_a_message_of_health_obeys_it_soon(
        graph, tmp_path, vehicle, record_property):
    flown, rate = Flown(graph, tmp_path, vehicle), 500.0
    came, delays, periods = [], [], []

    def receive(message):
        came.append((time.perf_counter(), np.array(message.data) == 0.0))

    def spin(duration):
        until = time.monotonic() + duration
        graph.spin_until(lambda: time.monotonic() > until, 'a while')

    graph.node.create_subscription(Float64MultiArray, 'command/motor_speed', receive, 10)
    stamps = count(1)
    timer = graph.node.create_timer(1.0 / rate, lambda: flown.command.publish(
        wrench(flown.demand, next(stamps) * 10**6, 'base_link')))
    graph.spin_until(lambda: len(came) > 100, 'commands')
    for k in range(CHANGES):
        lost = k % flown.n
        flown.lose()
        graph.spin_until(lambda: not came[-1][1].any(), 'all rotors run')
        spin(AROUND)
        came.clear()
        spin(AROUND)
        sent = time.perf_counter()
        flown.lose(lost + 1)
        graph.spin_until(
            lambda lost=lost: came and came[-1][1][lost], 'a command that obeys')
        spin(AROUND)
        assert not any(resting[lost] for at, resting in came if at < sent)
        delays.append(next(at for at, resting in came if resting[lost]) - sent)
        periods += np.diff([at for at, _ in came]).tolist()
    timer.cancel()
    assert max(delays) < 1.0
    for what, times in (
        ('from a message of health to the first command that obeys it', delays),
        ('period of the commands from 50 ms before to 50 ms after', periods),
    ):
        ranks = ' / '.join(f'{1e3 * np.percentile(times, rank):.1f}' for rank in (50, 99, 100))
        record_property(f'{vehicle}: {what}, p50 / p99 / worst [ms]', ranks)
    if LONG == 'soak':
        assert np.median(delays) < LATENCY_MAX


@pytest.mark.parametrize('vehicle', length(['tricopter'], SHIPPED))
def test_audit_set_up_and_first_answer_are_soon_done_for_each_lost_rotor(
        vehicle, record_property):
    """In a row, of the time of the processor: other work is not counted."""
    belief = Reconfiguration(load(vehicle), lambda settings, report, _: Rotors(settings, report))
    wrench_of_all, n = demand(belief.in_force.audit.vehicle), belief.in_force.built.n
    took = np.empty((length(1, 5, 40), n))
    for times in took:
        for rotor in range(n):
            begun = time.thread_time()
            assert belief.report('rotor_health', np.float64(np.arange(n) != rotor))
            made = belief.in_force.built
            command = made.method.allocate(wrench_of_all[made.rows]).command
            times[rotor] = time.thread_time() - begun
            assert command[rotor] == 0.0
    each = np.median(took, axis=0)
    record_property(f'{vehicle}: audit, set-up and first answer, worst rotor [ms]',
                    f'{1e3 * each.max():.2f} (rotor {each.argmax() + 1})')
    if LONG == 'soak':
        assert each.max() < BUILD_MAX
