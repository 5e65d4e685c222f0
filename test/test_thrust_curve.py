"""Thrust curves: inverses, numbers by hand, refusals, the fit, and what uses them."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from ca_ros import Exact, ParameterError, Vehicle
from ca_ros.__main__ import main
from ca_ros.parameter_files import load
from ca_ros.simulation.plant import Plant, body_of
from ca_ros.studies.fit_thrust import summary
from ca_ros.vehicle.files import read
from ca_ros.vehicle.formats.thrust_stand import fit, read_stand
from ca_ros.vehicle.thrust_curve import ThrustCurve, to_thrust

CURVE = 'rotors.thrust_curve.'
POLYNOMIAL = {CURVE + 'polynomial': [2.0e-5, 1.5e-3, 0.1]}
TABLE = {
    CURVE + 'speeds': [50.0, 100.0, 200.0, 400.0], CURVE + 'thrusts': [0.06, 0.3, 1.2, 3.9],
    CURVE + 'throttles': [0.05, 0.2, 0.5, 1.0]}


def vehicle(*curves, name='hexarotor'):
    """Return a shipped vehicle with other settings."""
    given = read(name)
    for curve in curves:
        given |= curve
    return Vehicle.from_parameters(given)


# The curve

numbers = st.floats(1e-6, 1e-2)


@given(numbers, st.floats(-1e-3, 1e-1), st.floats(0.0, 1.0), st.floats(50.0, 900.0))
def test_the_speed_of_a_thrust_is_the_inverse_of_a_polynomial(a, b, c, low):
    try:
        curve = ThrustCurve.polynomial([a, b, c], low, 1000.0)
    except ParameterError:
        assert 2.0 * a * low + b < 0.0 or (a * low + b) * low + c <= 0.0
        return
    w = np.append(np.linspace(0.0, 1000.0, 41), low)
    f = curve.thrust(w)
    assert f[0] == 0.0
    assert_allclose(f[w >= low], np.polyval([a, b, c], w[w >= low]), rtol=1e-12)
    assert_allclose(curve.speed(f), w, rtol=1e-9, atol=1e-6)
    assert (np.diff(curve.thrust(np.sort(w))) >= 0.0).all()


@given(st.lists(st.tuples(st.floats(0.5, 100.0), st.floats(0.01, 5.0)), min_size=2, max_size=9))
def test_a_table_goes_through_its_points_and_back(steps):
    w, f = np.cumsum(np.array(steps), axis=0).T
    curve = ThrustCurve.table(w, f)
    assert_allclose(curve.thrust(w), f, rtol=1e-9)
    over = np.linspace(0.0, w[-1], 50)
    assert_allclose(curve.speed(curve.thrust(over)), over, rtol=1e-6, atol=1e-6)
    # Points of k_f w^2 give k_f w^2 between them and below the first, too.
    assert_allclose(ThrustCurve.table(w, 2e-5 * w**2).thrust(over), 2e-5 * over**2, atol=1e-9)


def test_a_falling_share_of_the_square_is_a_curve_as_well():
    """By hand: f = 0.01 w - 1e-6 w^2 at 500 rad/s is 4.75 N, and 1000 (1 - sqrt(0.525)) / 0.2."""
    curve = ThrustCurve.polynomial([-1e-6, 0.01, 0.0], 0.0, 1000.0)
    assert curve.thrust(500.0) == pytest.approx(4.75)
    assert curve.speed(4.75) == pytest.approx(500.0)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_expo_of_px4_and_back(x, expo):
    share = to_thrust(x, expo)
    assert share == pytest.approx(expo * x**2 + (1.0 - expo) * x)
    throttle = ThrustCurve(expo=expo).throttle(np.sqrt(share), 1.0)
    assert throttle == pytest.approx(x, abs=1e-7)


def test_the_throttle_by_hand():
    """FunctionMotors.hpp of PX4: with THR_MDL_FAC 0.5, half of the thrust needs 0.618."""
    half = float(np.sqrt(0.5) * 400.0)
    some = vehicle({CURVE + 'expo': 0.5, CURVE + 'pwm': [1100.0, 1900.0]})
    assert_allclose(some.throttles([half] * 6), (np.sqrt(5.0) - 1.0) / 2.0)
    assert_allclose(some.pulses([half] * 6), 1100.0 + 800.0 * (np.sqrt(5.0) - 1.0) / 2.0)
    # By default the throttle is the share of the greatest thrust; measured ones are linear.
    assert_allclose(vehicle().throttles([200.0] * 6), 0.25)
    assert_allclose(vehicle(TABLE).throttles([0.0, 25.0, 75.0, 150.0, 300.0, 400.0]),
                    [0.0, 0.025, 0.125, 0.35, 0.75, 1.0])


def test_rotors_that_reverse_have_their_rest_in_the_middle():
    rov = Vehicle.load('rov')
    top = rov.speed_max
    assert_allclose(rov.throttles(-top / 2.0), -0.25)
    for share, pulse in ((-1.0, 1000.0), (0.0, 1500.0), (1.0, 2000.0)):
        assert_allclose(rov.pulses(share * top), pulse)


# Vehicles

@pytest.mark.parametrize('curve', [POLYNOMIAL, TABLE])
def test_everything_that_makes_speeds_uses_the_curve(curve):
    some = vehicle(curve)
    thrust = np.array(np.polyval(curve[CURVE + 'polynomial'], 300.0) if curve is POLYNOMIAL
                      else 1.2 + (3.9 - 1.2) * (300.0**2 - 200.0**2) / (400.0**2 - 200.0**2))
    assert_allclose(some.thrusts([300.0] * 6), thrust)
    assert_allclose(some.with_health(np.full(6, 0.5)).thrusts([300.0] * 6), thrust / 2.0)
    answer = Exact(some).allocate([6.0 * thrust, 0.0, 0.0, 0.0])
    assert answer.status.name == 'EXACT'
    assert_allclose(answer.speeds, 300.0)
    batch = Exact(some).allocate_batch([[6.0 * thrust, 0.0, 0.0, 0.0]] * 2)
    assert_array_equal(batch.speeds, [answer.speeds] * 2)
    body = body_of(some, load('hexarotor').simulator)
    # From rest, the simulated vehicle rises with the thrust of the curve.
    plant = Plant(body)
    plant.step(np.full(6, 300.0))
    assert_allclose(plant.state[5], (6.0 * thrust / some.mass - some.gravity) * plant.time_step)


def test_the_voltage_bounds_the_speeds_and_moves_the_throttle():
    """By hand: 25 rad/s per volt are 400 rad/s at 16 V, and 300 at 12 V."""
    some = vehicle(TABLE, {'rotors.speed_max_per_volt': 25.0})
    for voltage, top in ((20.0, 400.0), (16.0, 400.0), (12.0, 300.0)):
        sagging = some.at_voltage(voltage)
        assert_allclose(sagging.speed_max, top)
        # The same throttle turns the rotors in proportion to the voltage.
        assert_allclose(sagging.throttles([200.0 * voltage / 16.0] * 6), 0.5)
        assert_allclose(sagging.thrusts([200.0] * 6), 1.2)
    assert_allclose(some.at_voltage(12.0).throttles([300.0] * 6), 1.0)
    # What the file says of the voltage is only the first one.
    first = vehicle(TABLE, {'rotors.speed_max_per_volt': 25.0, 'rotors.battery_voltage': 12.0})
    assert_allclose(first.speed_max, 300.0)
    assert_allclose(first.at_voltage(15.0).speed_max, 375.0)
    plain = vehicle({'rotors.speed_max_per_volt': 25.0})
    assert_allclose(plain.at_voltage(20.0).throttles([250.0] * 6), 0.25)
    # 16 V turn the rotors with 400 rad/s, so that 8 to 24 V are sound; 12 V are declared.
    for sound, words in ((some, 'expected 8 to 24 V'), (first, 'expected 6 to 18 V')):
        for wrong in (0.0, -1.0, 1.7, 4.0, 25.0, 16800.0, np.inf, np.nan):
            with pytest.raises(ParameterError, match=rf'^battery: .* V: {words}'):
                sound.at_voltage(wrong)
    with pytest.raises(ParameterError, match=r'^battery: 9 V turn a rotor with less'):
        vehicle({'rotors.speed_max_per_volt': 25.0, 'rotors.speed_min': 230.0}).at_voltage(9.0)


@pytest.mark.parametrize('name', ['hexarotor', 'x8', 'rov'])
def test_without_a_curve_not_a_bit_changes(name):
    some = Vehicle.load(name)
    f = np.random.default_rng(0).uniform(some.thrust_min, some.thrust_max, (100, some.n))
    k = np.where(f < 0.0, some.thrust_coefficient_reverse, some.thrust_coefficient)
    expected = np.clip(np.sign(f) * np.sqrt(np.abs(f) / k), some.speed_min, some.speed_max)
    assert_array_equal(some.speeds(f), expected)
    assert_array_equal([some.speeds(each) for each in f], expected)


@pytest.mark.parametrize(('wrong', 'words'), [
    ({CURVE + 'polynomial': 2.5}, 'polynomial: expected a, b and c, got 2.5'),
    ({CURVE + 'polynomial': [2e-5, 1.5e-3, -0.5]}, 'polynomial: -0.408 N at 40 rad/s'),
    ({CURVE + 'polynomial': [2e-2, 1.5e-3, 0.0]}, 'polynomial, thrusts: 3200.6 N at speed_max'),
    ({CURVE + 'polynomial': [-2e-5, 1e-2, 0.1]}, 'polynomial: .* least slope -0.006'),
    ({CURVE + 'polynomial': [-1.25e-5, 0.0101, 0.1], 'rotors.speed_max_per_volt': 25.0},
     'polynomial: .* least slope -0.0049 .* from speed_min to 600 rad/s'),
    ({**POLYNOMIAL, **TABLE}, 'polynomial: given beside thrusts'),
    ({**POLYNOMIAL, 'rotors.speed_min': 0.0}, 'polynomial: 0.1 N at rest'),
    ({**POLYNOMIAL, 'rotors.speed_min': -9.0}, 'polynomial, thrusts: .* do not reverse'),
    ({**TABLE, CURVE + 'thrusts': [1.0, 2.0, 2.0, 3.0]}, 'thrusts: .* that increase'),
    ({**TABLE, CURVE + 'thrusts': [1.0, 2.0, 3.0]}, 'thrusts: 3 for 4 speeds'),
    ({**TABLE, CURVE + 'throttles': [0.0, 0.5, 0.2, 1.0]}, 'throttles: .* that increase'),
    ({**TABLE, 'rotors.speed_max': 410.0}, 'speeds: they end at 400 rad/s, before speed_max'),
    ({CURVE + 'throttles': [0.0, 1.0]}, 'speeds: missing'),
    ({CURVE + 'pwm': [1000.0, 1000.0]}, 'pwm: expected two different'),
])
def test_what_is_no_curve_is_refused_by_name(wrong, words):
    with pytest.raises(ParameterError, match=rf'^rotors\.thrust_curve\.{words}'):
        vehicle(wrong)


def test_numbers_that_are_not_finite_are_no_table():
    for wrong in (np.nan, np.inf):
        with pytest.raises(ParameterError, match=r'^thrusts: .* that increase'):
            ThrustCurve.table([0.0, 1.0, 2.0], [0.0, 1.0, wrong])


# The fit

STAND = """\
Throttle (%),RPM,Thrust [gf],Torque [N m],Note,Voltage [V]
0,0,0,0,rest,16.4
"""


ROWS = 'rpm,thrust [N]\n{},1000,1\n{},2000,2\n{},3000,3\n{},4000,4\n'


@pytest.fixture
def stand(tmp_path):
    """Return the file of a stand with thrusts of 2e-5 w^2 + 1e-3 w + 0.05 N and a K_M of 0.02."""
    lines = []
    for x in range(10, 101, 10):
        w = 4.0 * x + 50.0
        f = (2e-5 * w + 1e-3) * w + 0.05
        lines.append(f'{x},{w * 30.0 / np.pi!r},{f / 9.80665e-3!r},{0.02 * f!r},,{16.5 - x / 100}')
    file = tmp_path / 'stand.csv'
    file.write_text(STAND + '\n'.join(lines) + '\n')
    return file


def test_the_fit_finds_the_curve_of_a_stand(stand):
    found = fit(read_stand(stand))
    curve = found.settings['thrust_curve']
    assert_allclose(curve['polynomial'], [2e-5, 1e-3, 0.05], rtol=1e-5)
    # Speeds at the voltage of full throttle, 15.5 V.
    x = np.array(curve['throttles'])
    assert_allclose(curve['speeds'], (50.0 + 400.0 * x) * 15.5 / (16.5 - x), rtol=1e-5)
    assert found.settings['speed_max_per_volt'] == pytest.approx(450.0 / 15.5, rel=1e-5)
    ratio = found.settings['torque_coefficient'] / found.settings['thrust_coefficient']
    assert ratio == pytest.approx(0.02, rel=1e-5)
    assert found.error(found.curve)[1] < 1e-5
    assert found.error(found.square)[1] > 0.1
    # k_f by the normal equation.
    w, f = found.speeds, found.thrusts
    assert found.settings['thrust_coefficient'] == pytest.approx((w**2 @ f) / (w**4).sum(), 1e-5)


@pytest.mark.parametrize('options', [[], ['--table']])
def test_the_file_of_the_fit_is_the_curve(stand, options, tmp_path, capsys):
    out, plot = tmp_path / 'motor.yaml', tmp_path / 'motor.png'
    command = ['fit-thrust', str(stand), '--out', str(out), *options]
    command += [] if options else ['--plot', str(plot)]
    assert main(command) == 0
    assert 'k_f w^2      error' in capsys.readouterr().out
    assert bool(options) != plot.is_file()
    some = vehicle(read(out))
    for x in (0.1, 0.4, 1.0):
        w = 400.0 * x + 50.0
        assert_allclose(some.thrusts([w] * 6), (2e-5 * w + 1e-3) * w + 0.05, rtol=1e-5)
        # What the stand measured, at the voltage that it measured.
        assert_allclose(some.at_voltage(16.5 - x).throttles([w] * 6), x, rtol=1e-5)


def test_a_throttle_is_read_as_a_percentage_too_and_the_slowest_row_is_said(tmp_path):
    file = tmp_path / 'stand.csv'
    for title, form in (('throttle', '{}%'), ('throttle [%]', '{}'), ('throttle [%]', '{} %')):
        rows = ('40', '200,1'), ('60', '260,1.7'), ('80', '320,2.6'), ('100', '400,4')
        lines = (f'{form.format(throttle)},{rest}' for throttle, rest in rows)
        file.write_text('\n'.join([f'{title},speed [rad/s],thrust [N]', *lines]))
        each = fit(read_stand(file))
        assert_allclose(each.throttles, [0.4, 0.6, 0.8, 1.0])
        line = 'speed_min    200 rad/s, the slowest row (throttle 0.4): lower it if'
        assert any(said.startswith(line) for said in summary(each))
    file.write_text('throttle,speed [rad/s],thrust [N]\n0.4,200,40%\n')
    with pytest.raises(ParameterError, match=r"line 2, .*: expected a number, got '40%'"):
        read_stand(file)


def test_a_stand_without_speeds_gives_nominal_ones(tmp_path):
    file = tmp_path / 'stand.csv'
    file.write_text('PWM [us],thrust [N]\n1000,0\n1250,0.5\n1500,1.5\n1750,2.5\n2000,4\n')
    found = fit(read_stand(file), speed_max=400.0)
    assert_allclose(found.speeds, 400.0 * np.sqrt(found.thrusts / 4.0))
    assert found.settings['thrust_curve']['pwm'] == [1000.0, 2000.0]
    assert found.settings['thrust_curve']['throttles'] == [0.25, 0.5, 0.75, 1.0]
    assert not found.note


def test_a_stand_without_a_row_at_rest_has_the_usual_pulse_of_rest(tmp_path):
    file = tmp_path / 'stand.csv'
    file.write_text('ESC [us],Thrust efficiency [g/W],RPM,thrust [N]\n'
                    '1200,1,1000,0.5\n1500,1,2000,1.5\n1750,1,3000,2.5\n2000,1,4000,4\n')
    found = fit(read_stand(file))
    assert found.settings['thrust_curve']['pwm'] == [1000.0, 2000.0]
    assert found.settings['thrust_curve']['throttles'] == [0.2, 0.5, 0.75, 1.0]
    assert found.note == 'no row at rest: throttle 0 is assumed to be 1000 us'
    with file.open('a') as more:
        more.write('1100,1,900,-0.1\n')
    assert fit(read_stand(file)).note == 'rows of negative thrust left out: 1'


@pytest.mark.parametrize(('text', 'words'), [
    ('', 'no column of thrust'),
    ('rpm,thrust\n1,2\n', "'thrust': expected its unit in brackets, one of n, kgf"),
    ('rpm,thrust [N]\n1,2\n', '1 points with speed and thrust: expected 4'),
    ('rpm,thrust [N]\n\n1,x\n', "line 3, 'thrust [N]': expected a number, got 'x'"),
    ('rpm,thrust [N]\n1\n', "line 2, 'thrust [N]': expected a number, got ''"),
    ('rpm,thrust [N]\n1,nan\n', "line 2, 'thrust [N]': expected a number, got 'nan'"),
    ('rpm,throttle,thrust [N]\n1,10,1\n', "'throttle': expected a number from 0 to 1, got '10'"),
    ('rpm,thrust [N],voltage\n1,1,0\n', "'voltage': expected a number from 0.001 to"),
    ('throttle [%];rpm;thrust [N]\n10;1;1\n', 'expected commas between the columns'),
    (f'throttle [%],{ROWS}'.format(10, 20, 30, 50), 'throttle ends at 0.5: expected rows up to'),
    (f'pwm,{ROWS}'.format(1000, 1200, 1500, 2000), 'the motor turned at 1000 us: expected a row'),
    (f'throttle,pwm,{ROWS}'.format('0,1', '0,1', '0,1', '0,1'), 'throttle and of PWM: leave one'),
    ('rpm,thrust [N]\n1,5\n2,5\n3,5\n4,5\n', 'the thrust does not increase'),
    ('rpm,rpm,thrust [N]\n', "'rpm': a second column of speed"),
    ('throttle,thrust [N]\n1,1\n', 'no column of speed: expected one, or --speed-max'),
    ('rpm,thrust [N]\n1,1\n2,4\n3,4\n4,2\n', 'polynomial: .* increase'),
])
def test_what_is_no_stand_is_refused_in_one_line(text, words, tmp_path, capsys):
    file = tmp_path / 'stand.csv'
    file.write_text(text)
    assert main(['fit-thrust', str(file)]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f'ca_ros fit-thrust: {file}: ')
    assert re.search(words.replace('[', r'\['), line)
