"""The benchmark: its measurements are consistent; their values are not judged here."""

import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ca_ros import AdmissibleSet, Vehicle, make_allocator
from ca_ros.evaluation.benchmark import benchmark, c_contenders, contenders, loads, timing
from ca_ros.evaluation.benchmark.benchmark import main
from ca_ros.evaluation.benchmark.c_contenders import compiled
from ca_ros.evaluation.benchmark.contenders import BASELINE, CONTENDERS, POLICIES
from ca_ros.evaluation.benchmark.loads import ring, tilted_ring
from ca_ros.evaluation.benchmark.plan import QUICK
from ca_ros.evaluation.benchmark.promises import promise, promises
from ca_ros.evaluation.benchmark.results import KEY, ratio
from ca_ros.evaluation.benchmark.setups import SETUPS
from ca_ros.evaluation.benchmark.timing import PERCENTILES, Key
from ca_ros.evaluation.cases import PAPER
from ca_ros.evaluation.environment import THREADS
from ca_ros.evaluation.judge import Judge, faults
from ca_ros.evaluation.sampling import gauge
from ca_ros.flight.controller import Controller, Gains
from ca_ros.flight.rigid_body import ANGULAR_VELOCITY, ATTITUDE, NULL_STATE, POSITION
from ca_ros.nodes.parameters import load as parameters_of
from ca_ros.vehicle.files import config_directory
from strategies import FLEET, HEXAROTOR

pytestmark = pytest.mark.slow

BENCHMARK = 'ca_ros.evaluation.benchmark.benchmark'
SHIPPED = sorted(path.stem for path in config_directory().glob('*.yaml'))
TINY = replace(
    QUICK, wrenches=12, flight=40, repetitions=4, least=2, budget=1e-4,
    batches={10: 3, 20: 1}, looped=6, rounds=2, rotors=(4, 6, 32), duration=0.1)
INSTALLED = [
    name for name, each in CONTENDERS.items()
    if each.package and importlib.util.find_spec(each.package)]


def careless(problem, speed):
    """Answer at once, and always the same."""
    thrusts = problem.upper.copy()
    return lambda u: thrusts


def absent(problem):
    """Fail as where a package is not installed."""
    raise ImportError


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A benchmark with two peers more: one that is fast and wrong, one that is not installed."""
    out = tmp_path_factory.mktemp('benchmark')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(benchmark, 'QUICK', TINY)
        patch.setitem(CONTENDERS, 'careless', contenders.peer('json', careless, speed='high'))
        patch.setitem(CONTENDERS, 'absent', contenders.peer('no_such_solver', absent))
        assert main(['--quick', '--no-nodes', '--out', str(out)]) == 0
    return out


@pytest.fixture
def found(folder):
    return json.loads((folder / 'benchmark.json').read_text())


@pytest.fixture
def rows(folder):
    return pd.read_csv(folder / 'benchmark.csv')


@pytest.fixture
def results(found):
    """Return the results by part, load, contender and number of rotors."""
    return pd.DataFrame(found['results']).set_index(KEY).sort_index()


@pytest.fixture
def text(folder):
    return (folder / 'benchmark.md').read_text()


# A whole run

def test_all_contenders_are_measured_on_all_loads(found, results, folder):
    everybody = {'clipped_pinv', 'careless', *PAPER, *POLICIES, *INSTALLED}
    assert set(found['contenders']) == everybody
    assert set(found['loads']) == set(loads.LOADS)
    calls = results.loc['calls']
    assert set(calls.index) == {(load, name, 6) for load in loads.LOADS for name in everybody}
    assert (calls['time_low'] > 0.0).all()
    assert (calls['time_low'] <= calls['time']).all()
    assert (calls['time'] <= calls['time_high']).all()
    ends = calls[[*PERCENTILES, 'slowest']]
    assert (ends['p50'] > 0.0).all()
    assert (ends.diff(axis=1).iloc[:, 1:] >= 0.0).all(axis=None)
    assert [found['loads'][load]['wrenches'] for load in loads.LOADS] == [12, 12, 40]
    rotors = results.loc['rotors'].index
    assert set(rotors.get_level_values('rotors')) == set(TINY.rotors)
    assert set(rotors.get_level_values('load')) == set(loads.LOADS)
    assert set(results.loc['set-up'].index) == {
        (axes, name, 16) for axes in ('4 axes', '6 axes') for name in SETUPS}
    assert (folder / 'benchmark.png').stat().st_size > 20_000


def test_results_are_those_of_the_repetitions(rows, results):
    timed = rows[rows['repetition'] >= 0]
    assert (timed[timed['part'] == 'calls'].groupby(KEY).size() >= TINY.least).all()
    for key, own in timed.groupby(KEY):
        result = results.loc[key]
        assert result['time'] == pytest.approx(own['time'].median())
        part, load, _, rotors = key
        if part not in ('batches', 'set-up'):
            unit = timed[(timed[KEY] == [part, load, 'clipped_pinv', rotors]).all(axis=1)]
            ratios = own.set_index('repetition')['time'] / unit.set_index('repetition')['time']
            assert [result[name] for name in ('ratio_low', 'ratio', 'ratio_high')] == (
                pytest.approx(np.percentile(ratios.dropna(), (25, 50, 75))))
            one, other = Key(*key), Key(part, load, 'clipped_pinv', rotors)
            assert ratio(rows, one, other) == pytest.approx(result['ratio'])
    assert ratio(rows, Key('calls', 'flight', 'absent', 6), one) is None


def test_promises_are_judged_by_the_rows_of_the_run(found, rows, results):
    assert found['promises'] == json.loads(json.dumps(promises(found, rows)))
    by_name = {each['what']: each for each in found['promises']}
    [flight] = [each for what, each in by_name.items() if what.startswith('`exact` on a flight')]
    assert flight['measured'] == pytest.approx(
        results.loc[('calls', 'flight', 'exact', 6), 'ratio'])
    if 'osqp' in INSTALLED:
        [osqp] = [each for what, each in by_name.items() if 'OSQP' in what]
        assert osqp['measured'] == max(
            ratio(rows, Key('calls', load, 'exact', 6), Key('calls', load, name, 6))
            for load in loads.LOADS for name in ('osqp', 'osqp_polished'))
    for each in found['promises']:
        if each['measured'] is None:
            assert each['met'] is None
        else:
            above = each['measured'] >= each['limit']
            assert each['met'] is (above if each['at_least'] else not above)
    assert sum('latency' in what for what in by_name) == 2


def nodes(late, ratios):
    """Return metrics of nodes, of which the allocator answers some commands late."""
    echo = {'p50': 1e-4, 'p99': 2e-4, 'p99.9': 3e-4, 'late': 0, 'sent': 2000, 'answered': 1999}
    rate = {'allocator': echo | {'late': late}, 'echo': echo, 'ratio': ratios}
    return {
        'rates': {'250': rate, '1000': rate}, 'settings': {'block': 2.0},
        'sustained': {'allocator': 900.0, 'echo': 1000.0, 'ratio': 0.9}}


def test_what_is_missed_is_shown_as_missed(found, rows):
    rows.loc[(rows['part'] == 'calls') & (rows['contender'] == 'exact'), 'time'] = 1.0
    found['node'] = nodes(late=1, ratios={'p50': 1.04, 'p99': 1.2})
    found['promises'] = promises(found, rows)
    met = [each['met'] for each in found['promises']]
    assert met[0] is False
    assert met[-5:-1] == [True, False, True, True]
    assert promise('', 1.0, {'one': 0.9, 'two': 1.1, 'three': None}) == {
        'what': ' (worst: two)', 'limit': 1.0, 'measured': 1.1, 'at_least': False, 'met': False}
    assert promise('', 1.0, 1.0)['met']
    assert promise('', 1.0, 1.0, at_least=True)['met']
    text = benchmark.document(found)
    assert re.search(r'`exact` on a flight, .* at most 1 \| \d+ \| \*\*missed', text)


def test_a_fast_wrong_answer_is_marked_and_never_the_rival(found, results, text):
    for load in loads.LOADS:
        own = results.loc[('calls', load, 'careless', 6)]
        assert 'wrench' in own['faults']
        assert own['error'] > 1.0
    assert found['rival'] in [*INSTALLED, None]
    lines = text.partition('## In C')[0].splitlines()
    [row] = [line for line in lines if re.match(r'\| `careless` \| \S+ \(', line)]
    assert row.count('✗') == 3
    [row] = [line for line in lines if re.match(r'\| `exact` \| \S+ \(', line)]
    assert row.endswith('nothing |')
    assert '✗' not in row


def test_exact_is_right_on_all_loads_and_all_sizes(results):
    assert (results.xs('exact', level='contender')['faults'] == '').all()


def test_who_is_absent_is_named(found, text):
    assert found['absent']['absent'] == 'pip install no_such_solver'
    assert '`absent` (pip install no_such_solver)' in text
    assert found['node'] == {'absent': 'left out by --no-nodes'}
    assert 'Not measured: left out by --no-nodes.' in text


def test_the_report_says_what_the_times_depend_on(found, text):
    assert {'python', 'numpy', 'osqp'} <= set(found['environment']['versions'])
    assert found['contenders']['careless']['settings'] == {'speed': 'high'}
    for words in ('a **quick** one', 'speed=high', 'OPENBLAS_NUM_THREADS=', 'load ', 'BLAS of',
                  'seed 0', '## What is promised', '## Times per call'):
        assert words in text
    for name in found['contenders']:
        assert f'`{name}`' in text


# The loads

@pytest.mark.parametrize('vehicle', SHIPPED)
def test_loads_are_what_they_say(vehicle):
    parameters = parameters_of(vehicle)
    admissible = AdmissibleSet(Vehicle.load(vehicle))
    rng = np.random.default_rng(1)
    assert np.all(admissible.margin(admissible.sample(rng, 200)) > 0.0)

    wrenches = loads.boundary(admissible, rng, 300)
    depth = gauge(admissible, wrenches) - 1.0
    np.testing.assert_allclose(depth[1::3], 0.0, atol=1e-13)
    for side, part in ((-1.0, depth[0::3]), (1.0, depth[2::3])):
        off = np.abs(side * part[:, None] - loads.DEPTHS) <= 1e-13
        assert off.any(axis=1).all()
        assert off.any(axis=0).all()

    gains = Gains.from_parameters(parameters)
    vehicle = admissible.problem.vehicle
    wrenches = loads.flight(vehicle, gains, 400)
    assert wrenches.shape == (400, len(vehicle.axes))
    assert np.all(admissible.contains(wrenches, 1e-9))
    first = Controller(vehicle, gains).wrench(
        NULL_STATE[POSITION], NULL_STATE[ATTITUDE], np.zeros(3), NULL_STATE[ANGULAR_VELOCITY],
        loads.WAYPOINTS[0])
    np.testing.assert_array_equal(wrenches[0], first)


def test_rotors_saturate_in_the_flight_and_it_has_no_jump_but_at_a_waypoint():
    gains = Gains.from_parameters(parameters_of('hexarotor'))
    wrenches = loads.flight(HEXAROTOR, gains, 1000)
    saturation = make_allocator('exact', HEXAROTOR).allocate_batch(wrenches).saturation
    assert 0.01 < (saturation != 0).any(axis=1).mean() < 0.5
    jumps = np.abs(np.diff(wrenches, axis=0)).max(axis=1)
    assert set(np.argsort(jumps)[-3:] + 1) == {250, 500, 750}
    np.testing.assert_array_equal(loads.flight(HEXAROTOR, gains, 2000)[:1000], wrenches)
    np.testing.assert_array_equal(loads.flight(HEXAROTOR, gains, 1000), wrenches)


def test_the_ring_of_six_is_the_hexarotor_and_all_rings_give_the_same_thrust():
    gamma = AdmissibleSet(HEXAROTOR).problem.gamma
    six = AdmissibleSet(Vehicle.from_parameters(ring(6))).problem
    np.testing.assert_allclose(six.gamma, gamma, atol=1e-15)
    for n in QUICK.rotors:
        vehicle = Vehicle.from_parameters(ring(n))
        assert vehicle.n == n
        assert vehicle.thrust_max.sum() == pytest.approx(24.0)
        assert AdmissibleSet(vehicle).contains([vehicle.weight, 0.0, 0.0, 0.0])


def test_the_tilted_ring_of_six_is_the_tilted_hexarotor():
    six, shipped = (AdmissibleSet(vehicle).problem for vehicle in (
        Vehicle.from_parameters(tilted_ring(6)), Vehicle.load('hexarotor_tilted')))
    np.testing.assert_allclose(six.gamma, shipped.gamma, atol=1e-9)


# The judge

@pytest.fixture
def judge():
    admissible = AdmissibleSet(HEXAROTOR)
    inside = admissible.sample(np.random.default_rng(0), 20)
    outside = admissible.center + 2.0 * (loads.boundary(
        admissible, np.random.default_rng(0), 5) - admissible.center)
    return Judge(admissible.problem, np.concatenate([inside, outside]))


def judged(judge, answers):
    worst = judge.worst(answers)
    return worst | {'faults': faults(worst)}


def right(judge):
    exact = make_allocator('exact', HEXAROTOR)
    return [*exact.allocate_batch(judge.demands[:20]).thrusts, *[None] * 5]


def test_right_answers_have_no_fault(judge):
    found = judged(judge, right(judge))
    assert found['faults'] == ''
    assert found['attainable'] == 20
    assert found['error'] < 1e-12
    assert found['violation'] == 0.0
    assert 0.0 <= found['norm_excess'] < 1e-12


def spoilt(answers, number, change):
    answers[number] = change(answers[number])
    return answers


@pytest.mark.parametrize(('number', 'change', 'fault'), [
    (3, lambda f: f + 1e-5, 'wrench'),
    (3, lambda f: None, 'no answer to 1 of 20'),
    (3, lambda f: f * np.nan, 'no answer to 1 of 20'),
    (22, lambda f: np.full(6, 4.1), 'bounds'),
    (22, lambda f: np.full(6, 0.0), 'bounds'),
])
def test_every_fault_is_found(judge, number, change, fault):
    assert fault in judged(judge, spoilt(right(judge), number, change))['faults']


def test_where_there_is_no_right_answer_thrusts_within_bounds_are_none_wrong(judge):
    assert judged(judge, spoilt(right(judge), 22, lambda f: np.full(6, 2.0)))['faults'] == ''


def test_thrusts_that_are_not_the_least_are_found(judge):
    # Hover with one more of what gives no wrench: the rotors in turn more and less.
    problem = judge.problem
    own = Judge(problem, problem.hover[None])
    null = np.linalg.svd(problem.gamma)[2][-1]
    least = np.full(6, problem.hover[0] / 6.0)
    assert judged(own, [least])['faults'] == ''
    found = judged(own, [least + 0.1 * null])
    assert found['faults'] == 'norm'
    assert found['norm_excess'] == pytest.approx(
        np.linalg.norm(least + 0.1 * null) - np.linalg.norm(least))


# The peers

@pytest.mark.parametrize('name', INSTALLED)
@pytest.mark.parametrize('vehicle', ['hexarotor', 'x8', 'asymmetric'])
def test_a_peer_is_asked_the_right_question(name, vehicle):
    admissible = AdmissibleSet(FLEET[vehicle])
    wrenches = admissible.sample(np.random.default_rng(0), 60)
    call, judge = CONTENDERS[name].call(admissible.problem), Judge(admissible.problem, wrenches)
    for _ in range(2):
        found = judged(judge, [np.array(call(u)) for u in wrenches])
        if name == 'osqp':
            # What its default tolerances are good for.
            assert 1e-6 < found['error'] < 0.1
            assert found['failures'] == 0
        else:
            assert found['faults'] == '', found


def test_the_baseline_is_the_formula():
    problem = AdmissibleSet(HEXAROTOR).problem
    wrenches = AdmissibleSet(HEXAROTOR).sample(np.random.default_rng(0), 50)
    wanted = make_allocator('pseudo_inverse', HEXAROTOR).allocate_batch(wrenches).thrusts
    call = CONTENDERS[BASELINE].call(problem)
    np.testing.assert_allclose([call(u) for u in wrenches], wanted, atol=1e-14)


# In C

@pytest.fixture(scope='module')
def in_c():
    """Return the contenders in C for the hexarotor, and what is known about them."""
    admissible = AdmissibleSet(HEXAROTOR)
    calls, about = compiled(admissible.problem)
    if not calls:
        pytest.skip(about['absent']['exact'])
    return calls, about


def test_contenders_in_c_are_asked_the_right_question(in_c):
    calls, about = in_c
    assert set(calls) == set(about['contenders'])
    assert set(calls) | set(about['absent']) == {'clipped_pinv', 'exact', 'daqp_reused', 'osqp'}
    admissible, rng = AdmissibleSet(HEXAROTOR), np.random.default_rng(0)
    wrenches = np.concatenate(
        [admissible.sample(rng, 60), loads.boundary(admissible, rng, 60)])
    judge = Judge(admissible.problem, wrenches)
    for name, call in calls.items():
        times, answers = call.one_by_one(list(wrenches))
        assert len(times) == len(answers) == 120
        assert min(times) >= 0
        assert 0 <= call.together(list(wrenches)) < 1e9
        found = judged(judge, answers)
        if name == 'osqp':
            # What its default tolerances are good for.
            assert 1e-6 < found['error'] < 0.1
        elif name == 'clipped_pinv':
            python = CONTENDERS[BASELINE].call(admissible.problem)
            np.testing.assert_allclose(answers, [python(u) for u in wrenches], atol=1e-14)
        else:
            assert found['faults'] == '', (name, found)
            np.testing.assert_array_equal(call(wrenches[0]), answers[0])


def test_the_kernel_in_c_gives_the_thrusts_of_exact(in_c):
    admissible = AdmissibleSet(HEXAROTOR)
    wrenches = loads.boundary(admissible, np.random.default_rng(1), 300)
    _, answers = in_c[0]['exact'].one_by_one(list(wrenches))
    wanted = make_allocator('exact', HEXAROTOR).allocate_batch(wrenches).thrusts
    np.testing.assert_allclose(answers, wanted, atol=1e-11)


@pytest.mark.parametrize(('name', 'value', 'absent', 'reason'), [
    ('COMPILERS', (), {'clipped_pinv', 'exact', 'daqp_reused', 'osqp'}, 'no C compiler'),
    ('DAQP', '0.0', {'daqp_reused'}, 'of daqp 0.0, found'),
])
def test_contenders_in_c_that_are_missing_are_named(name, value, absent, reason, monkeypatch):
    if name == 'DAQP':
        pytest.importorskip('daqp')
    monkeypatch.setattr(c_contenders, name, value)
    admissible = AdmissibleSet(HEXAROTOR)
    calls, about = compiled(admissible.problem)
    assert absent <= set(about['absent'])
    assert not absent & set(calls)
    assert all(reason in about['absent'][each] for each in absent)


def test_the_times_in_c_are_in_the_report(found, results, text):
    assert set(found['C']['contenders']) | set(found['C']['absent']) == {
        'clipped_pinv', 'exact', 'daqp_reused', 'osqp'}
    part = text.partition('## In C')[2].partition('\n## ')[0]
    for name in found['C']['contenders']:
        assert (results.loc[('C', 'flight', name, 6), 'time'] > 0.0).all()
        assert re.search(rf'\| `{name}` \| \S+ \(', part)
    for name, why in found['C']['absent'].items():
        assert f'`{name}`: {why}' in part


# The clock

class Asked:
    """Notes what it is asked, and answers with an array that it uses again and again."""

    def __init__(self, size=3):
        self.asked, self.answer = [], np.zeros(size)

    def __call__(self, u):
        self.asked.append(u[0])
        self.answer[:] = u[0]
        return self.answer


class Noted:
    """A judge that notes what it is given."""

    def __init__(self, demands):
        self.demands, self.answers = demands, []

    def worst(self, answers):
        self.answers.append([answer[0] for answer in answers])
        return {'error': max(self.answers[-1])}


def test_all_are_asked_the_same_and_every_answer_is_checked(monkeypatch):
    monkeypatch.setattr(timing, 'TURN', 4)
    calls = {Key('', '', name, 6): Asked() for name in ('one', 'two')}
    judges = {key: Noted(np.arange(10.0)[:, None]) for key in calls}
    rows = timing.measure(
        calls, judges, replace(TINY, repetitions=3, least=3, budget=0.0), seed=0)
    one, two = calls.values()
    assert one.asked == two.asked
    # Once before, then twice a repetition, with the wrench before each of three turns.
    assert len(one.asked) == 10 + 3 * 2 * (10 + 3)
    for judge in judges.values():
        assert judge.answers == [list(range(10))] * (1 + 3)
    assert sorted(zip(rows['contender'], rows['repetition'], strict=True)) == [
        (name, repetition) for name in ('one', 'two') for repetition in (-1, 0, 1, 2)]
    assert (rows['error'] == 9.0).all()
    timed = rows[rows['repetition'] >= 0]
    measured = ['time', *PERCENTILES]
    assert (timed[measured] > 0.0).all(axis=None)
    assert rows[rows['repetition'] < 0][measured].isna().all(axis=None)


def test_who_is_too_slow_for_all_repetitions_takes_part_in_some_evenly_spread():
    for count in range(1, 8):
        part = [k for k in range(7) if timing.takes_part(k, count, 7)]
        assert len(part) == count
        assert part[0] == 0
        gaps = np.diff([*part, 7])
        assert gaps.max() - gaps.min() <= 1
    slow, answer = Key('', '', 'slow', 6), np.zeros(3)
    rows = timing.measure(
        {slow: lambda u: sum(range(20000)) and answer}, {slow: Noted(np.zeros((5, 1)))},
        replace(TINY, repetitions=6, least=2, budget=1e-9), seed=0)
    assert rows['repetition'].tolist() == [-1, 0, 3]


# The nodes

def test_the_metrics_of_the_nodes_are_in_the_report(found):
    found['node'] = nodes(late=3, ratios={'p50': 1.0, 'p99': 1.0})
    text = benchmark.document(found)
    assert '| 250 Hz, allocator | 100 | 200 | 300 | 3 | 1999 of 2000 |' in text
    assert '| 250 Hz, echo | 100 | 200 | 300 | 0 | 1999 of 2000 |' in text
    assert 'Highest sustained rate: 900 Hz, echo 1000 Hz, ratio 0.9.' in text
    found['node'] = {'error': 'the echo ended'}
    assert '**Not measured: the echo ended.**' in benchmark.document(found)


# A problem without a vehicle

def test_of_a_problem_calls_and_batches_are_measured(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, 'QUICK', TINY)
    command = ['--vehicle', 'admire', '--methods', 'all', '--quick']
    assert main([*command, '--out', str(tmp_path)]) == 0
    found = json.loads((tmp_path / 'benchmark.json').read_text())
    results = pd.DataFrame(found['results'])
    assert set(results['part']) <= {'calls', 'C', 'batches'}
    assert {'calls', 'batches'} <= set(results['part'])
    assert set(found['loads']) == {'uniform', 'boundary'}
    exact = results[results['contender'].isin(['exact', 'quadprog'])]
    assert (exact['faults'] == '').all()
    assert (found['flight'], found['promises']) == (None, [])
    assert found['node'] == {'absent': 'a problem without a vehicle has no rotor speeds'}
    text = (tmp_path / 'benchmark.md').read_text()
    assert '## Closed loop' not in text
    assert '`betaflight_mixer`: betaflight_mixer is for multirotors' in text


# The command line

def test_a_method_that_does_not_answer_with_thrusts_is_named(own, monkeypatch, capsys):
    (own / 'five.py').write_text("""
from types import SimpleNamespace
from ca_ros.allocation.pseudo_inverse import PseudoInverse
class Five(PseudoInverse):
    def allocate(self, u):
        return SimpleNamespace(thrusts=[1.0] * 5)
""")
    monkeypatch.setattr(benchmark, 'QUICK', TINY)
    assert main(['--quick', '--no-nodes', '--methods', 'five:Five', '--out', str(own)]) == 1
    err = capsys.readouterr().err
    assert err == 'benchmark: five:Five: expected thrusts of 6 rotors, got an array (5,)\n'


def test_a_wrong_method_is_named_in_one_line(tmp_path, capsys):
    assert main(['--methods', 'exakt', '--quick', '--no-nodes', '--out', str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert re.fullmatch("benchmark: no method 'exakt'.*\n", err)


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Let a method of the user's own be found."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(
        [str(tmp_path), str(Path(__file__).parent.parent)]))
    return tmp_path


def test_it_starts_itself_anew_with_one_thread(own):
    (own / 'threads.py').write_text(f"""
import os
from ca_ros.allocation.pseudo_inverse import PseudoInverse
class Threads(PseudoInverse):
    def __init__(self, vehicle):
        raise ValueError(' '.join(os.environ[name] for name in {THREADS}))
""")
    environment = {name: value for name, value in os.environ.items() if name not in THREADS}
    run = subprocess.run(
        [sys.executable, '-m', BENCHMARK, '--methods', 'threads:Threads'],
        env=environment, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (1, '', 'benchmark: 1 1 1\n')


def test_an_interrupt_ends_it_in_one_line(own):
    (own / 'ready.py').write_text("""
import sys
from ca_ros.allocation.pseudo_inverse import PseudoInverse
class Ready(PseudoInverse):
    def allocate(self, u):
        print('ready', flush=True)
        return super().allocate(u)
""")
    with subprocess.Popen(
            [sys.executable, '-m', BENCHMARK, '--no-nodes', '--methods', 'ready:Ready',
             '--out', 'out'],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == 'ready\n'
        process.send_signal(signal.SIGINT)
        _, err = process.communicate()
    assert process.returncode == 130
    assert err == 'benchmark: interrupted\n'
    assert list((own / 'out').iterdir()) == []


# The pages

def test_a_full_run_fills_the_pages_between_their_marks_and_a_quick_one_does_not(
        folder, found, tmp_path):
    docs = Path(__file__).resolve().parent.parent / 'docs'
    (tmp_path / 'docs').mkdir()
    for name in ('performance.py', 'marks.py'):
        (tmp_path / 'docs' / name).write_bytes((docs / name).read_bytes())
    script = tmp_path / 'docs' / 'performance.py'
    page = 'Before.\n\n<!-- benchmark -->\nold\n<!-- end of benchmark -->\n\nAfter.\n'
    pages = [tmp_path / 'README.md', tmp_path / 'docs' / 'performance.md']
    for path in pages:
        path.write_text(page)
    out = tmp_path / 'out'
    out.mkdir()
    for name in ('benchmark.md', 'benchmark.png'):
        (out / name).write_bytes((folder / name).read_bytes())

    def fill(quick):
        found['settings']['quick'] = quick
        (out / 'benchmark.json').write_text(json.dumps(found))
        return subprocess.run(
            [sys.executable, str(script), str(out)], capture_output=True, text=True, check=False)

    run = fill(quick=True)
    assert run.returncode == 1
    assert 'quick benchmark' in run.stderr
    assert [path.read_text() for path in pages] == [page, page]
    for _ in range(2):
        assert fill(quick=False).returncode == 0
    readme, performance = (path.read_text() for path in pages)
    for text in (readme, performance):
        assert text.startswith('Before.\n\n<!-- benchmark -->\n')
        assert text.endswith('\n<!-- end of benchmark -->\n\nAfter.\n')
        assert '\n| `exact` |' in text
        assert 'old' not in text.split()
    assert '### Times per call' in performance
    assert '### Batches' in performance
    # README has a few rows and columns of one table.
    rows = [line for line in readme.splitlines() if line.startswith('|')]
    assert 3 < len(rows) < 8
    assert {line.count('|') for line in rows} == {8}
    assert '](benchmark.png)' in performance
    assert (tmp_path / 'docs' / 'benchmark.png').is_file()


def test_the_pages_have_their_marks():
    root = Path(__file__).resolve().parent.parent
    for name in ('README.md', 'docs/performance.md'):
        text = (root / name).read_text(encoding='utf-8')
        assert len(re.findall('<!-- benchmark -->\n.*?<!-- end of benchmark -->', text,
                              re.DOTALL)) == 1
