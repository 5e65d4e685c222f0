"""The plant on which the detector is counted: laws of motion, of rotors, air and ground."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.detection import own_plant, reallocation, tables
from benchmarks.detection.__main__ import main
from benchmarks.detection.conditions import (
    CALM,
    CONTACTS,
    FLOWN,
    LOSSES,
    NOTHING,
    PUSHES,
    Condition,
)
from benchmarks.detection.flights import (
    Count,
    Outcome,
    Setup,
    failing,
    healthy,
    landed,
    namings,
    outcome_of,
    rng_of,
)
from benchmarks.detection.plant import (
    DESCENDING,
    FAILURES,
    GROUNDED,
    HEIGHT,
    PERIOD,
    RADIUS,
    STEP,
    Mission,
    Plant,
    Truth,
    fill,
)
from benchmarks.detection.reallocation import AFTERWARDS, acting, fly_on
from ca_ros.detection.detector_settings import DetectorSettings
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.detection.kernel_detector import make_detector
from ca_ros.detection.lag_check import LagCheck
from ca_ros.simulation.drag import Drag
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.studies.cases import Case
from ca_ros.vehicle.state import rotation_matrix
from strategies import length, rk4

SETUP = Setup.load('x8')
MODEL, N = SETUP.model, SETUP.vehicle.n
HOVER = np.sqrt(MODEL.mass * MODEL.gravity / (N * MODEL.thrust))
STILL = np.array([0, 0, 5, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0], float)


def started(state=STILL, mission=None, model=MODEL, **changes):
    """Return a plant without mismatch, sensors' errors, air and ground, but for changes."""
    ones = np.ones(N)
    ideal = {
        'mass_factor': 1.0, 'inertia_factor': np.ones(3), 'thrust_factor': ones,
        'torque_factor': ones, 'lag': 0.05 * ones, 'braking': 1.0, 'dropped': 1e9,
    }
    truth = fill(Truth(), **{**ideal, **changes})
    given = fill(Mission(), **{**CALM, **(mission or {})})
    return Plant(model, truth, given, 1, np.asarray(state, float))


def thrust(plant, seconds=2.0):
    """Return the specific force along z and the acceleration of yaw, after some time in hover."""
    plant.drift(np.full(N, HOVER), round(seconds / STEP))
    row, _ = plant.sense()
    before = plant.state[0][12]
    plant.drift(np.full(N, HOVER), 1)
    return row['specific_force'][2], (plant.state[0][12] - before) / STEP


def heavy():
    """Return a vehicle without weight, and a truth in which no force moves it."""
    model = type(MODEL).from_buffer_copy(MODEL)
    model.gravity = 1e-9
    return {'model': model, 'mass_factor': 1e6, 'inertia_factor': np.full(3, 1e6)}


def test_momentum_and_energy_without_forces():
    state = STILL.copy()
    state[3:6], state[10:] = (1.0, -2.0, 3.0), (4.0, -3.0, 6.0)
    plant = started(state, thrust_factor=np.zeros(N), torque_factor=np.zeros(N))
    inertia = np.array(MODEL.inertia)

    def found():
        now, _ = plant.state
        turned = rotation_matrix(now[6:10]) @ (inertia * now[10:])
        energy = 0.5 * now[3:6] @ now[3:6] + MODEL.gravity * now[2]
        return now[3:5], turned, energy, 0.5 * (inertia * now[10:]) @ now[10:]

    before = found()
    plant.drift(np.zeros(N), round(1.0 / STEP))
    for old, new in zip(before, found(), strict=True):
        np.testing.assert_allclose(new, old, rtol=2e-3, atol=1e-9)
    fallen = plant.state[0]
    assert fallen[2] == pytest.approx(5.0 + 3.0 - MODEL.gravity / 2.0, abs=1e-9)


def test_without_effects_it_moves_as_the_rigid_body_of_the_package():
    rng = np.random.default_rng(5)
    state = rng.normal(size=13)
    state[6:10] /= np.linalg.norm(state[6:10])
    speeds, wind = HOVER * rng.uniform(0.8, 1.1, N), np.array([3.0, -1.0, 0.5])
    plant = started(state, lag=np.zeros(N), flapping=5e-4, wind=wind)
    plant.drift(speeds, 80)
    body, expected = RigidBody(SETUP.vehicle, Drag(rotor=5e-4)), state
    for _ in range(80):
        expected = body.step(expected, speeds, STEP, wind, rk4)
    np.testing.assert_allclose(plant.state[0], expected, rtol=1e-3, atol=1e-3)


def test_hover_is_at_rest_and_the_controller_stays_there():
    plant = started()
    plant.drift(np.full(N, HOVER), round(1.0 / STEP))
    np.testing.assert_allclose(plant.state[0], STILL, atol=1e-9)
    there = {'stiffness': 1.0, 'reach': 0.0, 'low': 5.0, 'high': 5.0, 'turn': 0.0}
    rows = started(mission=there).fly(10.0)
    np.testing.assert_allclose(rows['position'][-1], STILL[:3], atol=1e-3)
    np.testing.assert_allclose(rows['command'][-1, :N], HOVER, rtol=1e-3)


def test_the_lag_is_of_first_order():
    plant = started()
    plant.drift(np.full(N, HOVER + 50.0), round(0.05 / STEP))
    np.testing.assert_allclose(plant.state[1][:N], HOVER + 50.0 * (1.0 - np.exp(-1.0)), rtol=1e-9)


@pytest.mark.parametrize('climb', [-1.0, 0.0, 3.0])
def test_inflow_follows_momentum_theory(climb):
    """In a steady climb V: T = k s^2 (1 + b (1 - (v + V) / v_0)) = 2 rho A v (v + V)."""
    state = STILL.copy()
    state[5] = climb
    force, _ = thrust(started(state, inflow=0.5, **heavy()))
    got = force * 1e6 * MODEL.mass / N
    area = 2.0 * 1.225 * np.pi * RADIUS**2
    still = HOVER * np.sqrt(MODEL.thrust / area)
    lift = MODEL.thrust * HOVER**2
    # A quadratic equation in v.
    b = climb + 0.5 * lift / still / area
    c = lift * (1.5 - 0.5 * climb / still) / area
    v = (-b + np.sqrt(b * b + 4.0 * c)) / 2.0
    assert got == pytest.approx(area * v * (v + climb), rel=2e-3)


def test_a_lost_propeller_has_neither_thrust_nor_drag():
    state = STILL.copy()
    state[3] = 5.0  # m/s forward; rotor 1 is front left
    fast = {'flapping': 5e-4, **heavy()}
    failure = {'failure': FAILURES['loss'], 'rotor': 0, 'left': 0.0, 'time': 0.0}
    sound, turning = thrust(started(state, **fast))
    plant = started(state, failure, **fast)
    plant.sense()
    lost, turned = thrust(plant)
    assert sound * 1e6 == pytest.approx(MODEL.gravity, rel=1e-6)
    assert lost / sound == pytest.approx(1.0 - 1.0 / N, rel=1e-6)
    yaw = (turned - turning) * 1e6 * MODEL.inertia[2]
    drag = 5e-4 * HOVER * 5.0 * SETUP.vehicle.arms[0, 1]
    own = MODEL.torque * HOVER**2 * MODEL.spin[0]
    assert yaw == pytest.approx(-drag - own, rel=1e-3)


def test_legs_carry_the_weight_and_take_energy():
    state = STILL.copy()
    state[2:6] = HEIGHT + 0.05, 0.5, 0.0, 0.0
    legs = {'sink': 0.003, 'damping': 0.5, 'friction': 0.5}
    plant = started(state, thrust_factor=np.zeros(N), torque_factor=np.zeros(N), **legs)
    stiffness = MODEL.mass * MODEL.gravity / 0.003

    def energy():
        now, _ = plant.state
        turned = 0.5 * (np.array(MODEL.inertia) * now[10:]) @ now[10:]
        depth = np.array([HEIGHT - now[2], 0.0]).max()
        still = MODEL.mass * (0.5 * now[3:6] @ now[3:6] + MODEL.gravity * now[2]) + turned
        return still + 0.5 * stiffness * depth**2

    found = []
    for _ in range(200):
        plant.drift(np.zeros(N), round(0.01 / STEP))
        found.append(energy())
    assert max(new - old for old, new in pairwise(found)) < 2e-3
    now, _ = plant.state
    np.testing.assert_allclose(now[2], HEIGHT - 0.003, atol=1e-6)
    np.testing.assert_allclose(now[3:6], 0.0, atol=1e-6)
    slid = 0.5**2 / (2.0 * 0.5 * MODEL.gravity)  # from the first contact on, with 0.5 m/s
    assert 0.5 * slid < now[0] - 0.5 * 0.1 < 1.5 * slid


def test_turbulence_has_the_spectrum_of_dryden():
    """MIL-F-8785C: the intensity up is a tenth of the wind at 6 m, the time constant L / V."""
    wind = {'wind': [6.0, 0.0, 0.0], 'turbulence': 6.0}
    rows = started(mission={'low': 5.0, 'high': 5.0, 'reach': 0.0}, **wind).fly(600.0)
    gusts = rows['wind'] - [6.0, 0.0, 0.0]
    shape = 0.177 + 0.000823 * 5.0 / 0.3048
    expected = 0.6 * np.array([shape**-0.4, shape**-0.4, 1.0])
    np.testing.assert_allclose(gusts.std(axis=0), expected, rtol=0.2)
    one_second = np.corrcoef(gusts[:-100, 2], gusts[100:, 2])[0, 1]
    # Of (1 + sqrt(3) T s) / (1 + T s)^2 after t: exp(-t/T) (1 - t/2T).
    away = 6.0 / 5.0
    assert one_second == pytest.approx(np.exp(-away) * (1.0 - away / 2.0), abs=0.1)


def test_the_same_seed_gives_the_same_flight_and_every_landing_ends_on_the_feet():
    def flown(seed):
        truth, mission = FLOWN['landings'].draw(MODEL, np.random.default_rng(seed), 45.0)
        return Plant(MODEL, truth, mission, seed).fly(45.0)

    rows, again = flown(3), flown(3)
    assert rows.tobytes() == again.tobytes()
    found = list(landed(rows))
    assert len(found) == 3
    for begin, end in found:
        assert rows['mode'][begin] == DESCENDING
        assert rows['mode'][end - 1] == GROUNDED
        assert rows['feet'][end - 1] >= 3
        np.testing.assert_allclose(rows['speeds'][end - 1, :N], MODEL.slowest, rtol=0.1)
    begin, end = found[1]
    count = Count()
    count.add(rows, list(namings(Fake({begin, end - 1, end}, 2), rows, N)))
    assert (count.alarms, count.landings, count.landing_alarms) == (2, 3, 1)


class Fake:
    """A detector that names a rotor in each of some states."""

    failed_arms = ()

    def __init__(self, states, rotor, vehicle=SETUP.vehicle):
        self.states, self.rotor, self.count, self.vehicle = states, rotor, -1, vehicle
        self.health = np.ones(vehicle.n)

    @property
    def order(self):
        """The only name is the first."""
        return [int(share < 1.0) for share in self.health]

    def observe(self, *_):
        """Name the rotor in its states."""
        self.count += 1
        self.health[self.rotor] = 0.0 if self.count in self.states else 1.0
        return self.count in self.states

    def command(self, *_):
        """Nothing depends on commands."""

    def reset(self):
        """Forget."""
        self.health[:] = 1.0


@pytest.mark.parametrize('make', [FailureDetector, make_detector])
def test_a_rotor_that_is_lost_within_a_push_is_named_soon_after_it(make):
    # The push ends 0.26 s after the loss.
    setup = Setup.load('hexarotor', make=make)
    condition = Condition({**PUSHES, 'pushes': 10.0, 'low': 40.0, 'high': 50.0})
    rng = rng_of(7, 'hexarotor', 'pushes', 'total')
    loss = {**LOSSES['total'], 'rotor': 1, 'time': 9.61}
    truth, mission = condition.draw(setup.model, rng, 17.0, loss)
    rows = Plant(setup.model, truth, mission, int(rng.integers(2**63))).fly(11.7)
    outcome = outcome_of(setup, rows, 1)
    assert outcome.right
    assert outcome.after < 1.0


def test_alarms_are_counted_once_a_landing_and_once_a_push():
    condition = Condition({**PUSHES, 'pushes': 20.0}, **NOTHING)
    truth, mission = condition.draw(MODEL, np.random.default_rng(0), 60.0)
    rows = Plant(MODEL, truth, mission, 0).fly(60.0)
    pushed = np.flatnonzero(rows['pushed'])
    count = Count()
    states = {0, int(pushed[0]) + 1, int(pushed[0]) + 2}
    count.add(rows, list(namings(Fake(states, 2), rows, N)))
    assert count.hours == pytest.approx(60.0 / 3600.0)
    assert (count.alarms, count.pushes, count.push_alarms) == (3, 3, 1)
    assert (count + count).names == {(2,): 6}
    assert len(rows) * PERIOD == 60.0


@pytest.mark.parametrize(('name', 'right'), [('hexarotor', 47), ('octorotor', 41)])
def test_a_rotor_lost_soon_after_a_take_off_is_named_at_once(name, right):
    # What the ground gives is no noise, and trim is not known before it has been flown.
    setup = Setup.load(name)
    found = failing(setup, 'landings', FLOWN['landings'], 'total', range(50))
    assert sum(each.right and each.after <= 0.2 for each in found) >= right


class Gaps:
    """A detector which messages do not reach: every 3 s for 0.1 to 0.8 s."""

    def __init__(self, detector, states):
        self.detector, self.states, self.off = detector, states, False

    def observe(self, time, *state):
        """Take a state, but in a gap."""
        number, phase = divmod(time, 3_000_000_000)
        self.off = phase < 100_000_000 * (1 + number % 8)
        return not (self.off and self.states) and self.detector.observe(time, *state)

    def command(self, *command):
        """Take a command, but in a gap."""
        if not self.off:
            self.detector.command(*command)

    def __getattr__(self, name):
        return getattr(self.detector, name)


@pytest.mark.parametrize('states', [False, True], ids=['commands', 'commands and states'])
@pytest.mark.parametrize('name', ['hexarotor', *length([], ['octorotor', 'x8'])])
def test_what_rotors_do_in_a_gap_of_messages_explains_nothing(name, states):
    quick, slow = (
        Setup.load(name, make=lambda *given, make=make: Gaps(make(*given), states))
        for make in (make_detector, FailureDetector))
    kind = 'aggressive', FLOWN['aggressive']
    assert healthy(quick, *kind, range(6)).alarms == 0
    found = failing(quick, *kind, 'total', range(8))
    same = length(3, 8)
    assert found[:same] == failing(slow, *kind, 'total', range(same))
    assert sum(each.arm for each in found) >= len(found) - 1
    assert not any(each.wrong or each.early for each in found)


@pytest.mark.parametrize(('name', 'condition', 'seed'), [
    ('octorotor', 'usual', 0), ('x8', 'usual', 0), ('octorotor', 'aggressive', 0)])
def test_disturbances_are_not_taken_for_another_lag(name, condition, seed):
    # One axis fits a lag of 10 ms by a third of its motion, where the lag is 40 or 60 ms.
    setup = Setup.load(name)
    rng = rng_of(seed, name, condition, 'lag')
    truth, mission = FLOWN[condition].draw(setup.model, rng, 40.0)
    rows = Plant(setup.model, truth, mission, seed).fly(40.0)
    check = LagCheck(setup.vehicle, DetectorSettings(motor_time_constant=0.05, delay=0.01))
    for time, rates, command in zip(
            *(rows[each] for each in ('time', 'rates', 'command')), strict=True):
        check.observe(int(time), rates, np.ones(setup.vehicle.n))
        check.command(int(time), command[:setup.vehicle.n])
    assert check.fault == ''


def test_two_rotors_are_not_named_for_a_trim_that_is_not_known():
    # Rotors 1, 3 and 5 are lost soon after a take-off; two arms explained that and the trim.
    setup = Setup.load('x8')
    found = [each for seed in (2092, 2000, 2200) for each in failing(
        setup, 'landings', FLOWN['landings'], 'total', range(seed, seed + 1))]
    assert [each.arm for each in found] == [True, True, True]


def test_both_engines_name_the_same_where_states_stop():
    # The imu takes over after half a second, and the detector begins anew.
    each, other = (
        failing(Setup.load('hexarotor', make=make, force='stopped'), 'usual', FLOWN['usual'],
                'total', range(10, length(13, 16)))
        for make in (make_detector, FailureDetector))
    assert each == other
    assert all(found.right and not found.early for found in each)


def test_both_engines_name_the_same_after_a_take_off():
    each, other = (
        failing(Setup.load('hexarotor', make=make), 'landings', FLOWN['landings'], 'total',
                range(10))
        for make in (make_detector, FailureDetector))
    assert each == other


def test_an_octorotor_flies_on_if_a_loss_is_announced_and_a_quadrotor_does_not():
    for name, flies in (('octorotor', True), ('quadrotor', False)):
        _, (found,) = fly_on((name, 'usual', 'announced', range(1), {}))
        assert found.flies is flies
        assert (found.drop > 20.0) is not flies


def test_gusts_do_not_take_the_sound_rotor_of_a_named_arm_away():
    # Rotor 6 is lost.  At odds of 200 a gust told after 0.4 s that it was rotor 5.
    _, (found,) = fly_on(('x8', 'turbulence', 'detected', range(53, 54), {}))
    assert found.named == found.without == (4, 5)
    assert found.flies


@pytest.mark.parametrize(('name', 'without'), [('hexarotor', 11.0), ('quadrotor', 0.0)])
def test_flights_that_act_on_names_count_names_and_seconds(name, without):
    setup = Setup.load(name)
    fake = Fake({100, 900}, 3, setup.vehicle)
    found = acting(replace(setup, make=lambda *_: fake), 'usual', 0, 12.0)
    assert (found.names, found.turned_over) == (1, 0)
    assert found.hours == pytest.approx(12.0 / 3600.0)
    assert found.without == pytest.approx(without)
    assert (found + found).without == 2.0 * found.without


@pytest.mark.parametrize('lost', [0, 3])
def test_after_a_loss_names_of_sound_rotors_are_counted(lost):
    setup = Setup.load('octorotor')
    fake = Fake({100, 900}, 3, setup.vehicle)
    found = acting(replace(setup, make=lambda *_: fake), 'usual', lost, 12.0, AFTERWARDS)
    assert found.names == 0  # since that before the loss
    fake = Fake({900}, 3, setup.vehicle)
    found = acting(replace(setup, make=lambda *_: fake), 'usual', lost, 12.0, AFTERWARDS)
    assert found.names == (lost != 3)
    assert found.hours == pytest.approx(4.0 / 3600.0, abs=0.02 / 3600.0)
    assert found.without == pytest.approx(3.0 * found.names)


def test_the_contacts_of_mujoco_carry_the_vehicle_and_give_as_many_landings():
    pytest.importorskip('mujoco')
    from benchmarks.detection.mujoco_body import MujocoPlant

    condition = CONTACTS['landings in MuJoCo']
    truth, mission = condition.draw(MODEL, np.random.default_rng(1), 20.0)
    rows = [kind(MODEL, truth, mission, 1).fly(20.0) for kind in (Plant, MujocoPlant)]
    assert [len(list(landed(each))) for each in rows] == [1, 1]
    own, foreign = (each[100:180] for each in rows)  # on the ground, before the first take-off
    for each in (own, foreign):
        assert (each['feet'] >= 3).all()
        np.testing.assert_allclose(each['position'][:, 2], HEIGHT, atol=0.01)
    np.testing.assert_allclose(
        foreign['specific_force'].mean(axis=0), own['specific_force'].mean(axis=0), atol=0.3)


def test_help_is_printed(capsys):
    with pytest.raises(SystemExit, match='0'):
        main(['--help'])
    said = capsys.readouterr().out
    assert '50 %' in said
    example = re.search('as in ([a-z_]+)=', ' '.join(said.split()))[1]
    assert example in DetectorSettings.__dataclass_fields__


@pytest.mark.parametrize(('name', 'value'), [
    ('hours', 'nan'), ('hours', '-1'), ('losses', '-1'), ('jobs', '0')])
def test_numbers_that_cannot_be_are_refused(name, value, capsys):
    with pytest.raises(SystemExit, match='2'):
        main([f'--{name}', value])
    assert f'error: argument --{name}: ' in capsys.readouterr().err


def test_what_cannot_be_flown_or_written_is_refused_in_one_line(tmp_path, capsys):
    (tmp_path / 'file').touch()
    nothing = ['--hours', '0.001', '--losses', '0']
    for given, answer in (
            (['--out', str(tmp_path)], 'nothing to fly: expected --losses, or --hours of '),
            (['--out', str(tmp_path / 'file')], '[Errno 17] File exists')):
        assert main([*nothing, *given]) == 1
        [line] = capsys.readouterr().err.splitlines()
        assert line.startswith(f'detection: {answer}')


def test_a_setting_that_is_none_is_refused(capsys):
    with pytest.raises(SystemExit, match='2'):
        main(['--set', 'certainty=0.99'])
    assert re.search('certainty: no setting .* expected .* delay, ', capsys.readouterr().err)


def test_tables_know_arms_and_intervals():
    arm = Outcome(0, 1, 0, (0, 1), 0.1)
    assert (arm.arm, arm.right, arm.wrong) == (True, False, False)
    partner = Outcome(0, 1, 0, (1,), 0.2)
    assert (partner.arm, partner.same_arm, partner.wrong) == (False, True, True)
    assert tables.quantile([arm, partner], 0.9) == 'never'
    assert tables.rate(0, 3.0) == '0.0 [0.0, 1.2]'  # -ln(0.025) / 3
    assert tables.share(2, 2) == '2/2: 100.0 [15.8, 100.0]'  # sqrt(0.025)


@pytest.mark.parametrize('told', [2, 3])
def test_a_loss_on_our_own_plant_is_judged_by_the_rotor_that_is_said_to_fail(told):
    case = Case.load('hexarotor_realistic')
    right, wrong, after, flies = own_plant.flown(case, {told: '2@3.0'}, 1000)
    assert (right, wrong, flies) == (told == 2, told != 2, True)
    assert told != 2 or 0.0 < after < 0.15


@pytest.mark.parametrize('make', [make_detector, FailureDetector])
def test_a_rotor_that_was_named_for_its_partner_is_given_back(make):
    # The arm of rotors 3 and 4 is named, then 4, which is sound, then 3.
    setup = Setup.load('y6', make=make)
    flight = reallocation.flown(setup, FLOWN['turbulence'], 'detected', 56)
    assert flight.flies
    assert (flight.rotor, flight.without) == (2, (2,))


def test_both_engines_name_the_same_in_the_same_test():
    # A rotor is lost after 20 s; after it is named, its health is estimated for half a second,
    # whose end is reached to the last bit in both.
    setup = Setup.load('y6')
    rng = rng_of(3001, 'y6', 'aggressive')
    failure = {**LOSSES['total'], 'rotor': 1, 'time': 20.0}
    truth, mission = FLOWN['aggressive'].draw(setup.model, rng, 40.0, failure)
    rows = Plant(setup.model, truth, mission, int(rng.integers(2**63))).fly(27.0)
    settings = DetectorSettings(motor_time_constant=0.05, delay=0.01)
    both = make_detector(setup.vehicle, settings), FailureDetector(setup.vehicle, settings)
    changes = 0
    for row in rows:
        states = int(row['time']), row['attitude'], row['velocity'], row['rates']
        first, second = (each.observe(*states) for each in both)
        assert first == second
        changes += first
        for name in ('health', 'probabilities'):
            np.testing.assert_allclose(*(getattr(each, name) for each in both), atol=1e-9)
        for each in both:
            each.command(int(row['time']), row['command'][:6])
    assert changes
    assert both[1].since[1] > 20_000_000_000
