"""The page of the explorer in a real browser: its numbers have the bits of Python."""

import json
import re
import shutil
import warnings
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

import ca_ros.settings
from ca_ros import AdmissibleSet, Exact, Vehicle, control_allocation_matrix, make_allocator
from ca_ros.__main__ import main
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.rates import WithinRates
from ca_ros.allocation.settings import AllocatedVehicleSettings
from ca_ros.control.waypoint import Waypoint
from ca_ros.explore import PAGE
from ca_ros.problem.audit import audit
from ca_ros.problem.vehicle_problem import problem_of
from ca_ros.px4 import parameters as px4
from ca_ros.setting_names import check_given, renamed
from ca_ros.settings import table
from ca_ros.simulation import closed_loop
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from ca_ros.studies.comparison import FixedPseudoInverse
from ca_ros.studies.dynamic.manoeuvres import unlimited, upset
from ca_ros.vehicle import files
from ca_ros.vehicle.failure_words import read_failures, with_failures
from ca_ros.vehicle.files import config_directory, read
from ca_ros.vehicle.formats import mixers
from ca_ros.vehicle.settings import MovingBodySettings
from ca_ros.vehicle.state import NULL_STATE
from strategies import need_kernel

need_kernel()
sync_api = pytest.importorskip('playwright.sync_api', reason="needs the extra 'browser'")
CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(CHROMIUM is None, reason='needs chromium: apt install chromium'),
    pytest.mark.skipif(not PAGE.is_file(), reason='the page is not built: make explorer'),
]
VEHICLES = {file.stem: file.read_text() for file in config_directory().glob('*.yaml')}
FLAGS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader']

PREPARE = """([yaml, health, settings]) => {
  const vehicle = explorer.readVehicle(yaml);
  return explorer.kernel.prepare(vehicle, health ?? vehicle.health, {...vehicle, ...settings});
}"""
ALLOCATE = """([yaml, health, settings, wrenches, method]) => {
  const vehicle = explorer.readVehicle(yaml);
  explorer.kernel.prepare(vehicle, health ?? vehicle.health, {...vehicle, ...settings});
  return wrenches.map((u) => explorer.kernel.allocate(vehicle, u, method));
}"""


@pytest.fixture(scope='module')
def browser():
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


def visit(page, address):
    """Open an address in a page, and wait until the explorer there works; return the page."""
    page.goto(address)
    page.wait_for_function('window.explorer?.times.length')
    return page


@pytest.fixture(scope='module')
def opened(browser):
    """Return the page, opened from its file, with what it asked of the network and its errors."""
    page = browser.new_page(viewport={'width': 1280, 'height': 800})
    page.asked, page.errors = [], []
    page.on('request', lambda request: page.asked.append(request.url))
    page.on('pageerror', lambda error: page.errors.append(str(error)))
    visit(page, PAGE.as_uri())
    return page


@pytest.fixture
def page(opened):
    """Return the page as it begins; a test must leave no error in it."""
    show(opened, 'hexarotor')
    opened.evaluate('scrollTo(0, 0)')
    yield opened
    assert opened.errors == []


def show(page, vehicle, **state):
    page.evaluate('([yaml, name, state]) => explorer.show(yaml, name, state)',
                  [VEHICLES.get(vehicle, vehicle), vehicle if vehicle in VEHICLES else '', state])


def yaml_of(given):
    """Return a parameter file."""
    return json.dumps({'/**': {'ros__parameters': given}}).replace('NaN', '.nan')


def with_value(setting, value, vehicle='hexarotor'):
    """Return the parameters of a shipped vehicle with another value of a setting."""
    return read(config_directory() / f'{vehicle}.yaml') | {setting: value}


def demands(problem, size):
    """Return wrenches up to twice as far from the middle of the set as its boundary."""
    inside = AdmissibleSet(problem).sample(np.random.default_rng(3), size)
    return problem.center + np.linspace(0.5, 2.0, size)[:, None] * (inside - problem.center)


def test_the_page_is_one_file_without_network(page):
    assert PAGE.stat().st_size < 1e6
    assert [url for url in page.asked if not url.startswith(('file:', 'data:', 'blob:'))] == []


@pytest.mark.parametrize(('name', 'settings'), [
    ('hexarotor', {}),
    ('x8', {'axis_reversal': 'allow'}),
    ('hexarotor_tilted', {'policy': 'scale'}),
    ('hexarotor', {'policy': 'reject'}),
    ('y6', {'airmode_limit': 0.1}),
    ('hexarotor_realistic', {}),
    ('hexarotor', {'order': ['thrust', 'roll pitch', 'yaw'], 'axis_reversal': 'allow'}),
])
def test_thousand_allocations_have_the_bits_of_python(page, name, settings):
    exact = Exact(Vehicle.load(name), **settings)
    wrenches = demands(exact.problem, 1000)
    words = {'policy': settings.get('policy', 'prioritize'),
             'deviation': settings.get('axis_reversal', 'prevent')}
    if 'order' in settings:
        words['order'] = settings['order']
    if limit := settings.get('airmode_limit'):
        words['airmode'] = [limit, limit]
    answers = page.evaluate(ALLOCATE, [VEHICLES[name], None, words, wrenches.tolist(), 'exact'])
    expected = exact.allocate_batch(wrenches)
    assert np.array_equal([a['thrusts'] for a in answers], expected.thrusts)
    assert np.array_equal([a['speeds'] for a in answers], expected.speeds)
    assert np.array_equal([a['saturation'] for a in answers], expected.saturation)
    assert np.array_equal([a['level'] for a in answers], expected.level)
    assert len({a['status'] for a in answers}) == 2
    margins = AdmissibleSet(exact.problem).margin(wrenches)
    np.testing.assert_allclose([a['margin'] for a in answers], margins, rtol=1e-9, atol=1e-12)


def test_what_limits_an_answer_is_what_python_says(page):
    exact = Exact(Vehicle.load('hexarotor'), airmode_limit=0.05)
    wrenches = demands(exact.problem, 60)
    answers = page.evaluate(ALLOCATE, [
        VEHICLES['hexarotor'], None, {'airmode': [0.05, 0.05]}, wrenches.tolist(), 'exact'])
    limited = 0
    for u, got in zip(wrenches, answers, strict=True):
        found = exact.allocate(u).explanation
        assert np.array_equal(got['served'], found.served)
        assert np.array_equal(got['blocks'], found.blocks)
        assert np.array_equal(got['airmodeBlocks'], found.airmode_blocks)
        assert np.array_equal(got['cause'], found.limit)
        limited += bool(found.airmode_blocks.any())
    assert limited


def test_with_the_time_since_hover_the_set_grows_to_the_whole_one(page):
    volumes = []
    for elapsed in (0.01, 0.05, 1.0, 0.0):
        show(page, 'hexarotor', elapsed=elapsed, shown=['roll', 'pitch'])
        [[*corners]] = page.evaluate('explorer.sets[0]')
        x, y, _ = np.array(corners).T
        volumes.append(0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))))
    assert volumes[0] < 0.5 * volumes[1] < 0.5 * volumes[2]
    assert volumes[2] == pytest.approx(volumes[3])
    show(page, 'hexarotor', elapsed=0.01, demand=[9.81, 2.0, 0.0, 0.0])
    assert page.locator('#status').inner_text() == 'RATE_LIMITED'
    assert 'speeding up' in page.locator('#words').inner_text()


@pytest.mark.parametrize(('name', 'failed'), [
    ('hexarotor', '1'), ('quadrotor', '2'), ('x8', '1,2,3'), ('y6', '1=0.4'), ('rov', '5,6'),
    ('hexarotor_realistic', '2=0.5,4'),
])
def test_axes_are_lost_and_served_as_in_python(page, name, failed):
    report = audit(with_failures(Vehicle.load(name), read_failures(failed)))
    problem = report.independent
    health = report.vehicle.health.tolist()
    prepared = page.evaluate(PREPARE, [VEHICLES[name], health, {}])
    assert tuple(prepared['kept']) == problem.axes
    wrenches = demands(problem, 100)
    full = np.zeros((100, len(report.full.axes)))
    full[:, [report.full.axes.index(axis) for axis in problem.axes]] = wrenches
    answers = page.evaluate(ALLOCATE, [VEHICLES[name], health, {}, full.tolist(), 'exact'])
    expected = Exact(report.vehicle).allocate_batch(wrenches)
    assert np.array_equal([a['thrusts'] for a in answers], expected.thrusts)


@pytest.mark.parametrize('method', ['pseudo_inverse', 'fixed_pseudo_inverse'])
def test_the_other_methods_are_those_of_python(page, method):
    report = audit(with_failures(Vehicle.load('hexarotor'), {'3': 0.0}))
    kind = FixedPseudoInverse if method.startswith('fixed') else None
    other = kind(report.vehicle) if kind else make_allocator(method, report.vehicle)
    wrenches = demands(report.full, 200)
    answers = page.evaluate(ALLOCATE, [
        VEHICLES['hexarotor'], report.vehicle.health.tolist(), {}, wrenches.tolist(), method])
    np.testing.assert_allclose(
        [a['thrusts'] for a in answers], other.allocate_batch(wrenches).thrusts, atol=1e-12)


def random_vehicle(rng):
    """Return the parameter file of a vehicle with random numbers."""
    n = int(rng.integers(4, 13))
    rotors = {
        'spins': rng.choice(['cw', 'ccw'], n).tolist(),
        'thrust_coefficient': rng.uniform(1e-5, 1e-4, n).tolist(),
        'torque_coefficient': float(rng.uniform(1e-7, 1e-6)),
        'speed_min': rng.uniform(-100.0, 50.0, n).tolist(),
        'speed_max': rng.uniform(300.0, 500.0, n).tolist(),
        'health': rng.uniform(0.3, 1.0, n).tolist(),
    }
    if rng.random() < 0.3:
        rotors['ring'] = {'count': n, 'radius': float(rng.uniform(0.2, 0.5)),
                          'first_angle': float(rng.choice([0.0, 30.0, 45.0, 22.5]))}
    else:
        rotors['positions'] = rng.normal(0.0, 0.3, 3 * n).tolist()
    if rng.random() < 0.5:
        rotors['axes'] = rng.normal([0.0, 0.0, 1.0], 0.2, (n, 3)).ravel().tolist()
        rotors['thrust_coefficient_reverse'] = float(rng.uniform(1e-5, 1e-4))
    body = {'name': 'random', 'mass': 1.5, 'center_of_mass': rng.normal(0.0, 0.02, 3).tolist()}
    return yaml_of({'vehicle': body, 'rotors': rotors})


MEASURED = [
    {'speeds': [50.0, 100.0, 250.0, 400.0], 'thrusts': [0.06, 0.3, 1.6, 3.9]},
    {'speeds': [0.0, 200.0, 400.0], 'throttles': [0.05, 0.5, 0.9]},
    {'speeds': [100.0, 410.0], 'thrusts': [0.25, 4.2], 'throttles': [0.1, 1.0]},
]


@pytest.mark.parametrize('measured', MEASURED)
def test_a_table_of_thrusts_is_read_and_answered_as_by_python(page, measured, tmp_path):
    text = yaml_of({**read('hexarotor'), **{
        f'rotors.thrust_curve.{name}': values for name, values in measured.items()}})
    (tmp_path / 'measured.yaml').write_text(text)
    exact = Exact(Vehicle.load(tmp_path / 'measured.yaml'))
    wrenches = demands(exact.problem, 100)
    answers = page.evaluate(ALLOCATE, [text, None, {}, wrenches.tolist(), 'exact'])
    expected = exact.allocate_batch(wrenches)
    assert np.array_equal([a['thrusts'] for a in answers], expected.thrusts)
    assert np.array_equal([a['speeds'] for a in answers], expected.speeds)


def test_matrices_and_bounds_have_the_bits_of_python(page, tmp_path):
    rng = np.random.default_rng(5)
    texts = [*VEHICLES.values(), *(random_vehicle(rng) for _ in range(100))]
    found = page.evaluate("""(texts) => texts.map((text) => {
      const vehicle = explorer.readVehicle(text);
      return {...vehicle, ...explorer.bounds(vehicle, vehicle.health)};
    })""", texts)
    for text, got in zip(texts, found, strict=True):
        (tmp_path / 'vehicle.yaml').write_text(text)
        vehicle = Vehicle.load(tmp_path / 'vehicle.yaml')
        assert got['axes'] == list(vehicle.axes)
        expected = {'gamma': control_allocation_matrix(vehicle), 'lower': vehicle.thrust_min,
                    'upper': vehicle.thrust_max}
        for name, numbers in expected.items():
            np.testing.assert_array_equal(got[name], numbers, f'{name} of {text}')
        assert got['reference'][got['axes'].index('thrust')] == vehicle.weight


BAD = ['x', -1.0, 2.5, 1e10, float('nan'), [1.0, 2.0], [], None, True, '5', 0.0, 1e-40]
OTHERS = [
    ('vehicle.wings', 2), ('rotors.speed_maxx', 3.0), ('allocation.axes', 'thrust'),
    ('allocation.axes', ['lift']), ('allocation.axes', ['thrust', 'thrust', 'yaw']),
    ('allocation.axs', ['thrust']), ('rotors.spins', ['cw', 'left'] * 3),
    ('rotors.spins', ['cw', 'ccw']), ('rotors.health', 2.0), ('rotors.health', [1.0] * 5),
    ('rotors.ring.radius', 0.0), ('rotors.ring.count', 33), ('rotors.ring.count', 3_000_000),
    ('rotors.positions', [0.1] * 18), ('rotors.axes', [0.0] * 3), ('rotors.axes', [1.0] * 6),
    ('rotors.speed_min', 500.0), ('rotors.deceleration_max', 5.0), ('rotors.battery_voltage', 3),
    ('rotors.thrust_curve.thrusts', [1.0, 2.0]), ('rotors.thrust_curve.polynomial', [1.0] * 3),
    ('rotors.thrust_curve.speeds', [50.0, 100.0]),
    ('allocation.exact.order', ['roll', 'pitch', 'thrust']), ('allocation.exact.order', ['foo']),
    ('allocation.exact.order', ['roll pitch', 'thrust', 'yaw', 'roll']),
    ('allocation.exact.airmode_limit', [0.1, 0.5]),
    ('allocation.exact.airmode_limit', [0.5, 0.1, 0.2, 0.0]),
    ('allocation.exact.axis_reversal', 'avoid'), ('allocation.exact.weights', [1.0] * 5),
    ('allocation.exact.weights', [1.0] * 5 + [1e5]), ('allocation.exact.preferred', 1e6),
    ('allocation.exact.reversal', 'maybe'), ('allocation.exact.slack', 1.0),
]


def test_a_file_is_refused_where_python_refuses_it_and_in_one_line(page):
    # The page has no rotors that tilt, and does not need the inertia.
    known = {**table(AllocatedVehicleSettings), **table(MovingBodySettings, 'vehicle.')}
    names = [name for name in known if not any(
        word in name for word in ('tilt', 'gimbal', 'servos', 'inertia', 'conventional'))]
    names = [n for n in names if n.count('.') == 1 or n.startswith(('rotors', 'allocation.exact'))]
    cases = [*OTHERS, *((name, value) for name in names for value in BAD)]
    texts = [yaml_of(with_value(*case)) for case in cases]
    found = page.evaluate("""(texts) => texts.map((text) => {
      try { explorer.readVehicle(text); return ''; } catch (error) { return error.message; }
    })""", texts)
    known, different = table(AllocatedVehicleSettings), []
    for case, got in zip(cases, found, strict=True):
        given = with_value(*case)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore', FutureWarning)
                given = renamed(given)
            check_given({name: value for name, value in given.items() if name.startswith(
                ('vehicle.', 'rotors.', 'allocation.')) and name != 'vehicle.inertia'}, known)
            problem = problem_of(Vehicle.from_parameters(given))
            exact = ca_ros.settings.read(ExactSettings, given, 'allocation.exact.')
            exact.groups(problem.axes)
            exact.preference(problem)
            expected = ''
        except ValueError as error:
            expected = str(error)
        if bool(expected) != bool(got) or '\n' in got:
            different.append((case, expected, got))
    assert not different


@pytest.mark.parametrize('shown', [['roll', 'pitch', 'yaw'], ['thrust', 'yaw']])
def test_the_attainable_set_is_that_of_python(page, shown):
    show(page, 'hexarotor', demand=[14.0, 0.3, -0.2, 0.05], shown=shown)
    admissible = AdmissibleSet(Vehicle.load('hexarotor'))
    expected = admissible.section(shown, [14.0, 0.3, -0.2, 0.05]).vertices
    rows = [admissible.problem.axes.index(axis) for axis in shown]
    corners = np.array([corner for face in page.evaluate('explorer.sets[0]') for corner in face])
    found = admissible.problem.center[rows] + admissible.problem.extent[rows] * (
        corners[:, :len(shown)])
    gaps = np.abs(found[:, None] - expected).max(axis=2)
    assert gaps.min(axis=1).max() < 1e-9
    assert gaps.min(axis=0).max() < 1e-9


def centre(page, selector):
    box = page.locator(selector).bounding_box()
    return box['x'] + box['width'] / 2, box['y'] + box['height'] / 2


def drag(page, x, y, right, down, steps):
    """Drag from a point [px]."""
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right, y + down, steps=steps)
    page.mouse.up()


def test_a_drag_moves_the_demand_and_fails_to_leave_the_set(page):
    page.locator('#shown button[value="roll,pitch"]').click()
    x, y = centre(page, '#section')
    drag(page, x, y, 300, 0, steps=10)
    assert page.locator('#status').inner_text() == 'PRIORITIZED'
    roll = page.evaluate('explorer.state.demand[1]')
    assert roll > 2.8
    assert '2.74' in page.locator('#demand div:nth-child(2) output').inner_text()
    page.locator('#demand div:nth-child(2) input').first.focus()
    page.keyboard.press('ArrowLeft')
    assert page.evaluate('explorer.state.demand[1]') < roll


def twelve():
    """Return the parameter file of a vehicle with twelve rotors."""
    rotors = {
        'ring': {'count': 12, 'radius': 0.6}, 'spins': ['cw', 'ccw'] * 6,
        'thrust_coefficient': 2.5e-5, 'torque_coefficient': 5e-7, 'speed_min': 40.0,
        'speed_max': 400.0}
    return yaml_of({'vehicle': {'mass': 2.0}, 'rotors': rotors})


@pytest.mark.parametrize('vehicle', ['hexarotor', twelve()], ids=['hexarotor', 'twelve rotors'])
def test_a_drag_is_answered_within_a_frame(page, vehicle):
    show(page, vehicle)
    times = page.evaluate("""() => {
      const slider = document.querySelector('#demand input');
      explorer.times.length = 0;
      for (let i = 0; i < 180; i++) {
        slider.value = Number(slider.min) + (slider.max - slider.min) * (i % 60 + 0.5) / 60;
        slider.dispatchEvent(new Event('input'));
      }
      return explorer.times;
    }""")
    # The least of three, nine times in ten: others use the processor, too.
    assert np.quantile(np.reshape(times, (3, 60)).min(axis=0), 0.9) < 16.0


def test_a_click_on_a_rotor_fails_it_and_the_address_keeps_the_case(page, browser):
    # Labels get their places with the next picture.
    page.evaluate('new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)))')
    spot = page.evaluate("""() => {
      const labels = [...document.querySelectorAll('#body .rotor')];
      const box = labels.find((label) => label.textContent === '5').getBoundingClientRect();
      return [box.x + box.width / 2, box.y + box.height / 2];
    }""")
    # The label is outside of the rotor, which is nearer to the middle.
    middle = centre(page, '#body')
    page.mouse.click(*(np.array(spot) * 0.75 + np.array(middle) * 0.25))
    assert page.evaluate('explorer.state.health') == [1, 1, 1, 1, 0, 1]
    assert 'Rotor 5 lost' in page.locator('#words').inner_text()
    other = visit(browser.new_page(), page.url)
    assert other.evaluate('explorer.state') == page.evaluate('explorer.state')
    assert other.locator('#words').inner_text() == page.locator('#words').inner_text()
    other.close()


DROP = """([text, name]) => {
  const data = new DataTransfer();
  data.items.add(new File([text], name));
  window.dispatchEvent(new DragEvent('drop', {dataTransfer: data, cancelable: true}));
}"""


def test_a_dropped_file_is_shown_and_a_broken_one_refused_in_one_line(page):
    page.evaluate(DROP, [twelve(), 'mine.yaml'])
    page.wait_for_function('document.querySelectorAll("#rotors div").length === 12')
    for text, fault in {
        'vehicle: [': 'mine.yaml: not readable YAML',
        'a: 1': 'mine.yaml: expected a ROS parameter file',
        VEHICLES['hexarotor'].replace('[cw, ccw,', '[cw,'): 'rotors.spins: expected 6 words',
        VEHICLES['hexarotor'].replace('40.0 ', '.nan '): 'rotors.speed_min: must be a finite',
        twelve().replace('"count": 12', '"count": 3000000'): 'count: must be a whole num',
        yaml_of(with_value('allocation.exact.policy', 'foo')): 'exact.policy: must be one',
        yaml_of(with_value('rotors.speed_max', 1e200)): 'rotors.speed_max: must be pos',
        VEHICLES['hexarotor_realistic'].replace('2.2e-5', '-2.2e-5'): 'rotors.thrust_curve.poly',
    }.items():
        page.evaluate(DROP, [text, 'mine.yaml'])
        page.wait_for_function('document.querySelector("#fault").textContent')
        said = page.locator('#fault').inner_text()
        assert fault in said
        assert '\n' not in said
        assert page.locator('#rotors div').count() == 12
        page.evaluate('document.querySelector("#fault").textContent = ""')
    # The page is as it was.
    page.locator('#rotors button').first.click()
    assert page.locator('#status').inner_text() == 'EXACT'
    assert page.evaluate('explorer.state.health') == [0, *[1] * 11]
    page.locator('#hover').click()
    assert page.evaluate('explorer.state.health') == [1] * 12
    page.select_option('#vehicle', 'hexarotor')
    assert page.locator('#rotors div').count() == 6
    page.select_option('#vehicle', '')
    assert page.locator('#rotors div').count() == 12


@pytest.mark.parametrize('width', [1280, 390])
def test_the_page_fits_its_width(page, width):
    page.set_viewport_size({'width': width, 'height': 800})
    assert page.evaluate('document.documentElement.scrollWidth') <= width
    page.set_viewport_size({'width': 1280, 'height': 800})


def test_the_command_writes_a_page_that_begins_with_the_vehicle(browser, tmp_path, capsys):
    file, out = tmp_path / 'mine.yaml', tmp_path / 'page.html'
    file.write_text(VEHICLES['y6'].replace('name: y6', 'name: mine </script>'))
    assert main(['explore', str(file), '--out', str(out)]) == 0
    page = visit(browser.new_page(), out.as_uri())
    assert page.locator('#vehicle option:checked').inner_text() == 'mine </script>'
    assert 'Hover' not in page.locator('#words').inner_text()
    assert capsys.readouterr().err == ''
    file.write_text(re.sub('mass: .*', 'mass: 50.0', VEHICLES['y6']))
    assert main(['explore', str(file), '--out', str(out)]) == 0
    assert 'cannot hover: 50 kg' in capsys.readouterr().err
    page.goto(out.as_uri())
    page.get_by_text('Hover is not attainable (thrust)').wait_for()
    page.close()
    assert main(['explore', 'no such vehicle', '--out', str(out)]) == 1
    assert capsys.readouterr().err.count('\n') == 1


def test_an_address_that_is_wrong_is_refused_in_a_line_and_shows_the_default(page, browser):
    page.evaluate('location.hash = "#vehicle=x8"')
    page.wait_for_function('explorer.state.name === "x8"')
    for words, fault in {
        'policy=foo': 'policy: must be one of', 'order=foo': 'order: expected groups',
        'order=roll': 'order: expected groups', 'airmode=x': 'airmode[0]: must be in [0, 1]',
        'airmode=-3': 'in [0, 1], got "-3"', 'health=1,1': 'health: expected 8 values, got 2',
        'demand=1,2': 'demand: expected 4 values, got 2', 'demand=': 'demand: expected 4 values',
        'beside=zzz': 'beside: must be one of pseudo_in', 'demand=a,b,c,d': 'demand[0]: must be',
        'health=x,1,1,1,1,1,1,1': 'health[0]: must be', 'health=5,1,1,1,1,1,1,1': 'got "5"',
        'deviation=zzz': 'deviation: must be one of', 'elapsed=-1': 'elapsed: must be',
        'elapsed=x': 'elapsed: must be', 'shown=foo,bar': 'shown[0]: must be', 'foo=1': 'foo: no',
    }.items():
        page.evaluate('(words) => { location.hash = `#vehicle=x8&${words}`; }', words)
        page.wait_for_function('document.querySelector("#fault").textContent')
        said = page.locator('#fault').inner_text()
        assert said.startswith(f'address: {fault}') or fault in said, said
        assert page.evaluate('explorer.state.health') == [1] * 8
        page.evaluate('document.querySelector("#fault").textContent = ""')
    other = visit(browser.new_page(), f'{PAGE.as_uri()}#vehicle=mine')
    assert 'vehicle: expected one of' in other.locator('#fault').inner_text()
    assert other.locator('#rotors div').count() == 6
    other.close()


def test_with_all_rotors_failed_the_page_and_its_address_show_it(page):
    for button in page.locator('#rotors button').all():
        button.click()
    assert page.locator('#status').inner_text() == 'LOST'
    assert 'rotors 1, 2, 3, 4, 5 and 6 lost' in page.locator('#words').inner_text()
    rows = page.locator('#rotors div').all()
    assert all('0 N, 0 rad/s' in row.inner_text() for row in rows)
    assert page.locator('#rotors button[aria-pressed=true]').count() == 6
    assert 'health=0%2C0%2C0%2C0%2C0%2C0' in page.url
    page.locator('#hover').click()
    assert page.locator('#status').inner_text() == 'EXACT'


def test_a_link_to_a_vehicle_that_is_not_shipped_carries_its_file(browser, tmp_path):
    file, out = tmp_path / 'hexarotor.yaml', tmp_path / 'page.html'
    file.write_text(yaml_of(with_value('vehicle.mass', 1.25)))
    assert main(['explore', str(file), '--out', str(out)]) == 0
    page = visit(browser.new_page(), out.as_uri())
    visit(page, PAGE.as_uri() + '#' + page.url.partition('#')[2])
    assert page.evaluate('explorer.state.demand[0]') == pytest.approx(1.25 * 9.81)
    page.close()


def test_the_keyboard_opens_a_file(page):
    # Before the keys: the browser must hold choosers back when the first opens.
    page.on('filechooser', lambda chooser: None)
    page.locator('#vehicle').focus()
    page.keyboard.press('Tab')
    with page.expect_file_chooser() as chosen:
        page.keyboard.press('Enter')
    chosen.value.set_files(
        {'name': 'mine.yaml', 'mimeType': 'text/yaml', 'buffer': twelve().encode()})
    page.wait_for_function('document.querySelectorAll("#rotors div").length === 12')


def test_the_keyboard_moves_the_demand_of_a_small_vehicle(page):
    small = twelve().replace('5e-07', '1e-11').replace('2.5e-05', '1e-8').replace('0.6', '0.04')
    show(page, small)
    page.locator('#demand div:nth-child(4) input').first.focus()
    for _ in range(25):
        page.keyboard.press('ArrowRight')
    yaw = page.evaluate('explorer.state.demand[3]')
    assert yaw == pytest.approx(0.1 * 6 * 1e-11 * (400.0**2 - 40.0**2), rel=1e-2)


def test_at_390_pixels_status_set_and_controls_of_it_are_seen_together(page):
    page.set_viewport_size({'width': 390, 'height': 844})
    page.evaluate('document.querySelector("#setcard").scrollIntoView()')
    boxes = [page.locator(each).bounding_box() for each in ('#status', '#set', '#shown', '#words')]
    ends = [(box['y'], box['y'] + box['height']) for box in boxes]
    assert ends[0][0] >= 0.0
    assert ends[-1][1] <= 844
    assert all(one[1] <= other[0] for one, other in pairwise(ends[1:]))
    page.set_viewport_size({'width': 1280, 'height': 800})


def test_one_rotor_is_no_plural(page):
    show(page, 'quadrotor', demand=[4.0, 0.9, 0.0, 0.0], policy='scale')
    words = page.locator('#words').inner_text()
    assert 'rotors 4 at' not in words
    assert 'rotors 2 at' not in words


def test_the_command_refuses_rotors_that_tilt(tmp_path, capsys):
    assert main(['explore', 'tricopter', '--out', str(tmp_path / 'page.html')]) == 1
    assert 'fixed rotors only' in capsys.readouterr().err


FLY = """async ([yaml, method, goal, state, failures]) => {
  const vehicle = explorer.readVehicle(yaml), kernel = await explorer.loadKernel();
  const flight = new explorer.Flight(kernel, vehicle, method, vehicle, goal, state), flown = [];
  for (let step = 0; step < 6000; step++) {
    failures.filter(([, at]) => at === step).forEach(([rotor]) => flight.fail(rotor));
    const {state, status} = flight.advance(1);
    flown.push([status, ...state.slice(0, 3)]);
  }
  return flown;
}"""


@pytest.mark.parametrize('method', ['exact', 'pseudo_inverse'])
@pytest.mark.parametrize(('name', 'goal', 'state', 'failures'), [
    ('hexarotor', (0.0, 0.0, 0.0, 0.0), upset(110.0, 40.0), []),
    ('hexarotor', (2.0, 1.0, 1.0, 0.0), NULL_STATE, [(0, 1000)]),
    ('x8', (1.0, 0.0, 0.0, 1.0), upset(60.0, 0.0, (6.0, 6.0, 6.0)), []),
    ('rov', (1.0, 0.5, -1.0, 1.0), NULL_STATE, [(4, 500)]),
], ids=['upset', 'rotor lost', 'spin', 'underwater'])
def test_a_flight_in_the_page_is_that_of_python(
        page, name, goal, state, failures, method, monkeypatch):
    case, answers = Case.load(name, methods=[method], flying=True), []

    class Recorded(WithinRates):
        def allocate(self, *arguments):
            answers.append(super().allocate(*arguments))
            return answers[-1]

    monkeypatch.setattr(closed_loop, 'WithinRates', Recorded)
    lost = RotorFailures(tuple(RotorFailure(i + 1, at / 1e3) for i, at in failures))
    changes = [
        replace(each, reconfigure=each.reconfigure and partial(
            each.reconfigure, changed=unlimited)) for each in case.announced(method, lost)
    ]
    flight = closed_loop.fly(
        unlimited(case.controller()), case.allocator(method), case.body(), Waypoint.of(*goal),
        6.0, 0.001, state, changes, failures=lost)
    found = page.evaluate(FLY, [VEHICLES[name], method, goal, state.tolist(), failures])
    assert [status for status, *_ in found] == [answer.status.name for answer in answers[:-1]]
    np.testing.assert_allclose([at for _, *at in found], flight.position[1:], atol=1e-6)
    if method == 'exact':
        assert flight.position_error(Waypoint.of(*goal)) < 0.1


def moved():
    """Return the parameters of the story's vehicle: rotor 2 is 19 mm out of place."""
    given = read('hexarotor')
    positions = list(given['rotors.positions'])
    positions[3] = 0.2 + 0.019
    return given | {'rotors.positions': positions}


def clipped(vehicle, u, lost=(), stopped=()):
    """Return the wrench of a clipped pseudo-inverse of all axes.

    It knows of the rotors that are `stopped`, and not of those that are `lost`.
    """
    gamma = control_allocation_matrix(vehicle).copy()
    gamma[:, list(stopped)] = 0.0
    thrusts = np.clip(np.linalg.pinv(gamma) @ u, vehicle.thrust_min, vehicle.thrust_max)
    thrusts[list(lost)] = 0.0
    return gamma @ thrusts


def told(name):
    """Return by Python the status of a story, the wrenches of both methods, and the demand."""
    if name == 'px4':
        vehicle, u = Vehicle.from_parameters(moved()), [9.81, 0.2, 0.1, 0.0]
        report = audit(vehicle.with_health([0, 1, 1, 0, 1, 1]))
        assert report.lost == ('yaw',)
        answer = Exact(report.vehicle).allocate(u[:3])
        return answer.status.name, answer.wrench, clipped(vehicle, u, stopped=(0, 3))[:3], u[:3]
    vehicle = Vehicle.load('quadrotor' if name == 'airmode' else 'hexarotor')
    u = {'roll': [9.81, 3.0, 0.0, 0.0], 'lost': [9.81, 0.0, 0.0, 0.0],
         'airmode': [2.0, 0.7, 0.0, 0.0], 'missed': [6.0, 1.0, 1.0, 0.1]}[name]
    lost = [0] if name == 'lost' else []
    answer = Exact(audit(vehicle.with_health([0, 1, 1, 1, 1, 1])).vehicle if lost
                   else vehicle).allocate(u)
    return answer.status.name, answer.wrench, clipped(vehicle, u, lost), u


def gives(wrench, u):
    """Return what the page says of a wrench."""
    units = ('N', 'N m', 'N m', 'N m')
    rounded = np.where(np.abs(wrench) < 1e-9, 0.0, wrench)
    off = [f'{axis} {got:.3g} instead of {asked:.3g} {unit}' for axis, unit, got, asked in zip(
        ('thrust', 'roll', 'pitch', 'yaw'), units, rounded, u, strict=False)
        if abs(got - asked) > 1e-5]
    return f'gives {" and ".join(filter(None, (", ".join(off[:-1]), off[-1])))}' if off else (
        'serves the demand in full')


@pytest.mark.parametrize('width', [1280, 390])
@pytest.mark.parametrize('name', ['roll', 'lost', 'airmode', 'missed', 'px4'])
def test_a_story_says_in_a_sentence_what_its_values_are(page, name, width):
    page.set_viewport_size({'width': width, 'height': 844})
    page.locator(f'#story button[value={name}]').click()
    status, wrench, other, u = told(name)
    sentence = page.locator('#sentence').inner_text().replace('\xa0', ' ')
    assert f'exact {gives(wrench, u)}' in sentence
    assert sentence.endswith(f' {gives(other, u)}.')
    assert gives(other, u) != gives(wrench, u)
    assert page.locator('#status').inner_text() == status
    rows = page.locator('#demand div').all()
    shown = [row.locator('output').inner_text() for row in rows]
    assert shown == [
        '✓' if abs(got - asked) < 1e-5 else f'{got:.3g}'
        for got, asked in zip(wrench, u, strict=True)] + ['lost'] * (name == 'px4')
    assert [float(row.locator('input[type=number]').input_value()) for row in rows][:len(u)] == u
    # All of the sentence is on the screen, and nothing is wider than it.
    box = page.locator('#sentence').bounding_box()
    assert box['y'] + box['height'] < 844
    assert page.evaluate('document.documentElement.scrollWidth') <= width
    assert page.locator(f'#story button[value={name}]').get_attribute('aria-pressed') == 'true'
    page.set_viewport_size({'width': 1280, 'height': 800})


def test_the_page_opens_on_the_case_of_readme(browser):
    page = visit(browser.new_page(), PAGE.as_uri())
    assert page.evaluate('explorer.state.demand') == [9.81, 3, 0, 0]
    assert page.evaluate('explorer.state.beside') == 'pseudo_inverse'
    assert page.locator('#sentence').inner_text().startswith('Asked for 3 N m of roll')
    page.close()


def test_what_the_airmode_story_says_happens(page):
    page.locator('#story button[value=airmode]').click()
    page.locator('.limits input').first.fill('0')
    thrust, roll, *_ = Exact(Vehicle.load('quadrotor'), airmode_limit=0.0).allocate(
        [2.0, 0.7, 0.0, 0.0]).wrench
    assert (f'{thrust:.3g}', f'{roll:.3g}') == ('2', '0.325')
    assert 'roll 0.325 instead of 0.7' in page.locator('#sentence').inner_text()
    assert 'thrust' not in page.locator('#sentence').inner_text().partition(';')[0]


@pytest.mark.parametrize('width', [1280, 390])
def test_a_flight_runs_and_a_click_on_a_rotor_fails_it_in_both(page, width):
    page.set_viewport_size({'width': width, 'height': 844})
    page.select_option('#begin', 'waypoint')
    page.evaluate('document.querySelector("#flights").scrollIntoView()')
    page.evaluate('document.querySelector("#fly").click()')
    page.wait_for_function('explorer.flights.time > 0.5')
    # In one go: the vehicle moves on.
    page.evaluate("""() => {
      const [clientX, clientY] = explorer.air.spots(0)[2];
      document.elementFromPoint(clientX, clientY).dispatchEvent(
        new PointerEvent('pointerup', {clientX, clientY, bubbles: true}));
    }""")
    assert page.evaluate('explorer.flights.failed') == [2]
    page.wait_for_function('document.querySelector("#flown").textContent', timeout=60_000)
    said = page.locator('#flown').inner_text()
    assert re.search(r'exact is 0\.0\d+ m from the goal', said)
    assert 'clipped pseudo-inverse is' in said
    assert page.evaluate('explorer.flights.time') == pytest.approx(6.0)
    for line in ('.servedline', '.besideline', '.lostline'):
        assert page.locator(f'#lines {line}').first.get_attribute('d').count('L') > 100
    assert page.evaluate('document.documentElement.scrollWidth') <= width
    page.set_viewport_size({'width': 1280, 'height': 800})


def test_a_vehicle_without_inertia_is_shown_and_says_why_it_does_not_fly(page):
    given = read('hexarotor')
    del given['vehicle.inertia']
    show(page, yaml_of(given))
    assert page.locator('#status').inner_text() == 'EXACT'
    assert 'vehicle.inertia' in page.locator('#flight').inner_text()
    assert page.locator('#fly').is_hidden()
    show(page, 'hexarotor')
    assert page.locator('#fly').is_visible()
    assert page.evaluate('explorer.air.stages[0].element.isConnected')


def test_without_webgl_the_page_says_so_and_shows_the_sections(browser):
    plain = browser.browser_type.launch(
        executable_path=CHROMIUM, args=['--no-sandbox', '--disable-3d-apis'])
    page = visit(plain.new_page(), PAGE.as_uri())
    assert 'no WebGL' in page.locator('#nowebgl').inner_text()
    page.locator('#story button[value=lost]').click()
    assert page.locator('#section polygon.face').count() == 1
    x, y = centre(page, '#section')
    drag(page, x, y, 60, 0, steps=3)
    assert page.evaluate('explorer.state.demand[1]') > 0.5
    page.locator('#fly').click()
    page.wait_for_function('explorer.flights.time > 0.2')
    plain.close()


def px4_text(vehicle):
    return px4.text(px4.to_px4(vehicle), 'params')


@pytest.mark.parametrize('name', ['hexarotor', 'x8', 'hexarotor_tilted', 'hexarotor_ppnnpn'])
def test_parameters_of_px4_are_read_and_written_as_by_python(page, name):
    vehicle = Vehicle.load(name)
    page.evaluate(DROP, [px4_text(vehicle), 'mine.params'])
    page.locator('#asked').wait_for()
    top = float(vehicle.thrust_coefficient.max()) * 400.0**2
    answers = {'mass': 1.5, 'thrust': top, 'speedMin': 40.0, 'speedMax': 400.0}
    for key, value in answers.items():
        page.locator(f'#asked input[name={key}]').fill(repr(value))
    assert page.locator('#asked input[name=length]').count() == 0
    page.locator('#asked button').click()
    page.wait_for_function('explorer.state.name === ""')
    text = px4.from_px4(px4.read(px4_text(vehicle)), 1.5, (40.0, 400.0), top / 400.0**2)
    expected = Vehicle.from_parameters(files.flatten(
        files.read_yaml(text)['/**']['ros__parameters']))
    found = page.evaluate('explorer.readVehicle(explorer.exported("yaml"))')
    np.testing.assert_allclose(
        found['gamma'], control_allocation_matrix(expected), rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found['fullThrusts'], expected.thrust_max, rtol=1e-8)
    # Out again: what Python writes of the same vehicle.
    show(page, name)
    written = px4.read(page.evaluate('explorer.exported("px4")'))
    assert written == pytest.approx(px4.read(px4_text(vehicle)), abs=1e-8)


def test_normalised_positions_of_px4_need_a_length_and_others_are_refused_in_one_line(page):
    text = '\n'.join(f'param set-default {name} {value}' for name, value in {
        'CA_ROTOR_COUNT': 4, **{f'CA_ROTOR{i}_{key}': each for i, (x, y, k) in enumerate(
            [(1, 1, 0.05), (-1, -1, 0.05), (1, -1, -0.05), (-1, 1, -0.05)])
            for key, each in (('PX', x), ('PY', y), ('KM', k))}}.items())
    page.evaluate(DROP, [text, '4001_quad'])
    page.locator('#asked input[name=length]').fill('0.2')
    page.locator('#asked button').click()
    page.wait_for_function('explorer.state.name === ""')
    assert page.evaluate('explorer.readVehicle(explorer.exported("yaml")).arms[0]') == [
        0.2, -0.2, 0]
    tilting = px4_text(Vehicle.load('tricopter'))
    for other, fault in {
        tilting: 'rotors that tilt', text.replace('_COUNT 4', '_COUNT 40'): 'expected 1 to 12',
        text.replace('CA_ROTOR_COUNT', 'CA_ROTOR_CUONT'): 'no CA_ROTOR_COUNT',
    }.items():
        page.evaluate(DROP, [other, 'mine.params'])
        if 'COUNT 40' in other:
            page.locator('#asked button').click()
        page.wait_for_function('document.querySelector("#fault").textContent')
        assert fault in page.locator('#fault').inner_text()
        page.evaluate('document.querySelector("#fault").textContent = ""')


@pytest.mark.parametrize('style', ['betaflight', 'ardupilot'])
def test_mixers_of_other_autopilots_are_written_as_by_python(page, style):
    for name in VEHICLES:
        show(page, name)
        try:
            expected = mixers.STYLES[style](Vehicle.load(name)) + '\n'
        except ValueError as error:
            expected = str(error)
        assert expected == page.evaluate("""(style) => {
          try { return explorer.exported(style); } catch (error) { return error.message; }
        }""", style)


def test_an_export_is_a_file(page):
    with page.expect_download() as download:
        page.select_option('#export', 'px4')
    assert download.value.suggested_filename == 'hexarotor.params'
    assert px4.read(download.value.path().read_text())['CA_ROTOR_COUNT'] == 6
    show(page, 'rov')
    page.select_option('#export', 'betaflight')
    assert page.locator('#fault').inner_text().startswith('export: mixers have the axes')
    page.evaluate('document.querySelector("#fault").textContent = ""')


def test_an_exported_file_is_the_vehicle_in_python(page, tmp_path):
    for name in ('hexarotor_realistic', 'rov'):
        show(page, name)
        file = tmp_path / f'{name}.yaml'
        file.write_text(page.evaluate('explorer.exported("yaml")'))
        before, after = Vehicle.load(name), Vehicle.load(file)
        assert np.array_equal(
            control_allocation_matrix(after), control_allocation_matrix(before))
        assert np.array_equal(after.thrust_max, before.thrust_max)
        assert np.array_equal(after.inertia, before.inertia)


def test_words_for_rotors_and_axes_that_are_lost_or_weak(page):
    show(page, 'quadrotor', health=[0.0, 1.0, 1.0, 1.0], demand=[9.81, 0.0, 0.0, 0.1])
    words = page.locator('#words').inner_text()
    assert 'is lost: the rotors cannot control it independently' in words
    assert 'lost or weak' not in words
    assert page.locator('#demand output').all_inner_texts().count('lost') == 1
    show(page, 'hexarotor', health=[0.4, *[1.0] * 5], demand=[9.81, 0.0, -3.0, 0.0])
    assert 'rotor 1 weak' in page.locator('#words').inner_text()
    show(page, 'hexarotor', health=[0.0, *[1.0] * 5], demand=[9.81, 0.0, -3.0, 0.0])
    assert 'rotor 1 lost' in page.locator('#words').inner_text()


def test_what_does_not_count_is_off(page):
    for policy, on in (('prioritize', True), ('scale', False), ('reject', False)):
        page.select_option('#policy', policy)
        for each in ('#order', '#deviation', '.limits input[aria-label="airmode limit"]'):
            assert page.locator(each).is_enabled() == on


def test_the_ring_moves_in_the_plane_of_roll_and_pitch_and_with_shift_along_yaw(page):
    page.wait_for_function("""() => {
      const {renderer, element, frame} = explorer.stages.set;
      return renderer.domElement.clientWidth === element.clientWidth && !frame;
    }""")
    x, y = page.evaluate("""() => {
      const {left, top} = document.querySelector('#set').getBoundingClientRect();
      const {set} = explorer.stages, at = set.project(set.demand);
      return [left + at.x, top + at.y];
    }""")
    drag(page, x, y, 80, -15, steps=4)
    _, roll, pitch, yaw = page.evaluate('explorer.state.demand')
    assert abs(roll) > 0.1
    assert abs(pitch) > 0.1
    assert yaw == pytest.approx(0.0, abs=1e-6)
    page.locator('#hover').click()
    page.keyboard.down('Shift')
    drag(page, x, y, 0, -30, steps=4)
    page.keyboard.up('Shift')
    _, roll, pitch, yaw = page.evaluate('explorer.state.demand')
    assert (roll, pitch) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert yaw > 0.02


def test_a_finger_drags_the_ring_and_scrolls_the_page_elsewhere(browser):
    context = browser.new_context(viewport={'width': 390, 'height': 844}, has_touch=True)
    page = visit(context.new_page(), PAGE.as_uri())
    page.evaluate('document.querySelector("#setcard").scrollIntoView()')
    touch = context.new_cdp_session(page)

    def swipe(x, y, dx, dy):
        def send(kind, *spots):
            touch.send('Input.dispatchTouchEvent', {
                'type': kind, 'touchPoints': [{'x': a, 'y': b} for a, b in spots]})

        before = page.locator('#section').bounding_box(), page.evaluate('explorer.state.demand')
        send('touchStart', (x, y))
        for share in (0.2, 0.4, 0.6, 0.8, 1.0):
            send('touchMove', (x + share * dx, y + share * dy))
        send('touchEnd')
        page.wait_for_timeout(100)
        after = page.locator('#section').bounding_box(), page.evaluate('explorer.state.demand')
        return before[0]['y'] - after[0]['y'], after[1] != before[1]

    ring = page.locator('#section .ring').bounding_box()
    x, y = ring['x'] + ring['width'] / 2, ring['y'] + ring['height'] / 2
    assert swipe(x, y, -60, -60) == (pytest.approx(0.0, abs=1.0), True)
    for scene in ('#section', '#body'):
        page.evaluate(f'document.querySelector("{scene}").scrollIntoView()')
        box = page.locator(scene).bounding_box()
        moved, changed = swipe(box['x'] + 40, box['y'] + 200, 0, -120)
        assert moved > 60, scene
        assert not changed, scene
    context.close()


def test_zoom_and_a_demand_far_out_stay_in_the_picture(page):
    page.locator('#shown button[value="roll,pitch"]').click()
    wide = page.locator('#section svg').get_attribute('viewBox').split()[2]
    page.locator('#zoom button').first.click()
    assert float(page.locator('#section svg').get_attribute('viewBox').split()[2]) < float(wide)
    page.locator('#demand input[type=number]').nth(1).fill('40')
    page.locator('#demand input[type=number]').nth(1).press('Enter')
    page.locator('#zoom button').last.click()
    ring = page.locator('#section .ring').bounding_box()
    box = page.locator('#section').bounding_box()
    assert box['x'] <= ring['x']
    assert ring['x'] + ring['width'] <= box['x'] + box['width']
    assert 'farther out' in page.locator('#section').inner_text()
    page.locator('#shown button').first.click()
    at = page.evaluate("""() => new Promise((found) => {
      const {set} = explorer.stages;
      requestAnimationFrame(() => requestAnimationFrame(() => found(set.project(set.demand))));
    })""")
    box = page.locator('#set').bounding_box()
    assert 0 < at['x'] < box['width']
    assert 0 < at['y'] < box['height']


def test_a_link_is_copied_where_others_can_open_the_address(browser, page):
    assert page.locator('#copy').is_hidden()
    context = browser.new_context(permissions=['clipboard-read', 'clipboard-write'])
    other = context.new_page()
    other.route('**/*', lambda route: route.fulfill(path=PAGE, content_type='text/html'))
    visit(other, 'https://pages.example/explorer.html')
    other.locator('#copy').click()
    other.get_by_text('Copied').wait_for()
    copied = other.evaluate('navigator.clipboard.readText()')
    assert copied.startswith('https://pages.example/explorer.html#vehicle=hexarotor&demand=9.81')
    context.close()
