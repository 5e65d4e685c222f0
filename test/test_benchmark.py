"""The benchmark: what it measures is not for a test to judge, but that its figures are sound."""

import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ca_ros import ALLOCATORS, AdmissibleSet, Vehicle, make_allocator
from ca_ros.evaluation.benchmark import benchmark, loads, node, timing
from ca_ros.evaluation.benchmark.benchmark import main
from ca_ros.evaluation.benchmark.loads import ring
from ca_ros.evaluation.benchmark.peers import PEERS, Peer, baseline, peer
from ca_ros.evaluation.benchmark.plan import QUICK
from ca_ros.evaluation.benchmark.promises import compare, promise, promises
from ca_ros.evaluation.environment import THREADS
from ca_ros.evaluation.judge import Judge, verdict
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
INSTALLED = [name for name, each in PEERS.items() if importlib.util.find_spec(each.package)]


def careless(module, problem, settings):
    """Answer at once, and always the same."""
    thrusts = problem.upper.copy()
    return lambda u: thrusts


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A benchmark with two peers more: one that is fast and wrong, one that is not installed."""
    out = tmp_path_factory.mktemp('benchmark')
    more = {
        'careless': Peer('json', 'none', {'speed': 'high'}, careless),
        'absent': Peer('no_such_solver', 'none', {}, careless),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(benchmark, 'QUICK', TINY)
        for name, each in more.items():
            patch.setitem(PEERS, name, each)
        assert main(['--quick', '--no-nodes', '--out', str(out)]) == 0
    return out


@pytest.fixture
def figures(folder):
    return json.loads((folder / 'benchmark.json').read_text())


@pytest.fixture
def report(folder):
    return (folder / 'benchmark.md').read_text()


# A whole run

def test_everybody_has_figures_for_every_load(figures, folder):
    everybody = {'clipped_pinv', 'careless', *ALLOCATORS, *INSTALLED}
    assert set(figures['contenders']) == everybody
    assert set(figures['calls']) == set(figures['loads']) == set(loads.LOADS)
    for own in figures['calls'].values():
        assert set(own) == everybody
        for each in own.values():
            known = [mean for mean in each['repetitions'] if mean is not None]
            assert len(each['repetitions']) == TINY.repetitions
            assert len(known) >= TINY.least
            assert each['mean']['median'] == pytest.approx(np.median(known))
            assert 0.0 < each['mean']['low'] <= each['mean']['median'] <= each['mean']['high']
            assert each['p99']['median'] > 0.0
    assert [figures['loads'][load]['wrenches'] for load in loads.LOADS] == [12, 12, 40]
    assert (folder / 'benchmark.png').stat().st_size > 20_000


def test_ratios_are_those_of_the_repetitions(figures):
    own = [*figures['calls'].values()]
    own += [
        {name: each[n] for name, each in figures['growth'][load].items()}
        for load in ('uniform', 'flight') for n in ('4', '6', '32')]
    for calls in own:
        base = calls['clipped_pinv']['repetitions']
        for each in calls.values():
            ratios = [
                mean / unit for mean, unit in zip(each['repetitions'], base, strict=True)
                if None not in (mean, unit)]
            found = each['ratio']
            assert [found[key] for key in ('low', 'median', 'high')] == pytest.approx(
                np.percentile(ratios, (25, 50, 75)))
    batch, loop = figures['batch'], figures['closed_loop']
    for ratio, above, below in (
            (batch['linearity']['20'], batch['time']['exact 20'], batch['time']['exact 10']),
            (loop['ratio'], loop['time'], loop['unit'])):
        ratios = np.divide(above['repetitions'], below['repetitions'])
        assert ratio['median'] == pytest.approx(np.median(ratios))
    if figures['rival']:
        ratios = np.divide(
            batch['time']['loop']['repetitions'], batch['time']['exact 20']['repetitions'])
        assert batch['speedup']['median'] == pytest.approx(np.median(ratios))


def test_promises_are_judged_by_the_figures_of_the_run(figures):
    found = figures['promises']
    assert found == json.loads(json.dumps(promises(figures)))
    by_name = {each['what']: each for each in found}
    [flight] = [each for what, each in by_name.items() if what.startswith('`exact` on a flight')]
    assert flight['measured'] == figures['calls']['flight']['exact']['ratio']['median']
    [rotors] = [each for what, each in by_name.items() if what.startswith('32 rotors')]
    pairs = zip(*(figures['growth']['flight']['exact'][n]['repetitions'] for n in ('32', '6')),
                strict=True)
    assert rotors['measured'] == pytest.approx(
        np.median([a / b for a, b in pairs if None not in (a, b)]))
    if 'osqp' in INSTALLED:
        worst = max(
            compare(own, 'exact', name) for own in figures['calls'].values()
            for name in ('osqp', 'osqp_polished'))
        [osqp] = [each for what, each in by_name.items() if 'OSQP' in what]
        assert osqp['measured'] == worst
    for each in found:
        if each['measured'] is None:
            assert each['met'] is None
        else:
            above = each['measured'] >= each['limit']
            assert each['met'] is (above if each['at_least'] else not above)
    assert sum('latency' in what for what in by_name) == 2


def test_what_is_missed_is_shown_as_missed(figures):
    figures['calls']['flight']['exact']['ratio']['median'] = 17.0
    figures['node'] = {
        'rates': {'250': {'ratio_p50': 1.1, 'ratio_p99': 1.4},
                  '1000': {'allocator': {'late': 1, 'sent': 2000}}},
        'sustained': {'ratio': 0.9}}
    met = {each['what']: each['met'] for each in promises(figures)}
    assert met['`exact` on a flight, in units of the clipped pseudo-inverse'] is False
    assert list(met.values())[-5:-1] == [True, False, True, True]
    assert promise('', 1.0, 1.0)['met']
    assert promise('', 1.0, 1.0, at_least=True)['met']
    figures['promises'] = promises(figures)
    assert '| at most 2 | 17 | **missed** |' in benchmark.summary(figures)


def test_a_fast_wrong_answer_is_marked_and_never_the_rival(figures, report):
    for load in loads.LOADS:
        own = figures['calls'][load]['careless']
        assert own['correct'] is False
        assert 'wrench' in own['faults']
        assert own['error'] > 1.0
    assert figures['rival'] != 'careless'
    assert figures['rival'] in [*INSTALLED, None]
    [row] = [line for line in report.splitlines() if re.match(r'\| `careless` \| \S+ \(', line)]
    assert row.count('✗') == 3
    [row] = [line for line in report.splitlines() if re.match(r'\| `exact` \| \S+ \(', line)]
    assert row.endswith('nothing |')
    assert '✗' not in row


def test_exact_is_right_on_all_loads_and_all_sizes(figures):
    assert all(own['exact']['correct'] for own in figures['calls'].values())
    assert all(each['correct'] for own in figures['growth'].values()
               for each in own['exact'].values())
    assert figures['batch']['correct'] is True


def test_who_is_absent_is_named(figures, report):
    assert figures['absent']['absent'] == 'pip install no_such_solver'
    assert '`absent` (pip install no_such_solver)' in report
    assert figures['node'] == {'absent': 'left out by --no-nodes'}
    assert 'Not measured: left out by --no-nodes.' in report


def test_the_report_says_what_the_figures_depend_on(figures, report):
    assert {'python', 'numpy', 'osqp'} <= set(figures['environment']['versions'])
    assert figures['contenders']['careless']['settings'] == {'speed': 'high'}
    for words in ('a **quick** one', 'speed=high', 'OPENBLAS_NUM_THREADS=', 'load ', 'BLAS of',
                  'seed 0', '## Limitations', '## What is promised', '## Times per call'):
        assert words in report
    for name in figures['contenders']:
        assert f'`{name}`' in report


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


# The judge

@pytest.fixture
def judge():
    admissible = AdmissibleSet(HEXAROTOR)
    inside = admissible.sample(np.random.default_rng(0), 20)
    outside = admissible.center + 2.0 * (loads.boundary(
        admissible, np.random.default_rng(0), 5) - admissible.center)
    return Judge(admissible.problem, np.concatenate([inside, outside]))


def judged(judge, answers):
    return verdict(judge.worst(answers), int(judge.attainable.sum()))


def right(judge):
    exact = make_allocator('exact', HEXAROTOR)
    return [*exact.allocate_batch(judge.demands[:20]).thrusts, *[None] * 5]


def test_right_answers_have_no_fault(judge):
    found = judged(judge, right(judge))
    assert found['faults'] == []
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
    assert judged(judge, spoilt(right(judge), 22, lambda f: np.full(6, 2.0)))['faults'] == []


def test_thrusts_that_are_not_the_least_are_found(judge):
    # Hover with one more of what gives no wrench: the rotors in turn more and less.
    problem = judge.problem
    own = Judge(problem, problem.hover[None])
    null = np.linalg.svd(problem.gamma)[2][-1]
    least = np.full(6, problem.hover[0] / 6.0)
    assert judged(own, [least])['faults'] == []
    found = judged(own, [least + 0.1 * null])
    assert found['faults'] == ['norm']
    assert found['norm_excess'] == pytest.approx(
        np.linalg.norm(least + 0.1 * null) - np.linalg.norm(least))


# The peers

@pytest.mark.parametrize('name', INSTALLED)
@pytest.mark.parametrize('vehicle', ['hexarotor', 'x8', 'asymmetric'])
def test_a_peer_is_asked_the_right_question(name, vehicle):
    admissible = AdmissibleSet(FLEET[vehicle])
    wrenches = admissible.sample(np.random.default_rng(0), 60)
    call, judge = peer(name, admissible.problem).call, Judge(admissible.problem, wrenches)
    for _ in range(2):
        found = judged(judge, [np.array(call(u)) for u in wrenches])
        if name == 'osqp':
            # What its default tolerances are good for.
            assert 1e-6 < found['error'] < 0.1
            assert found['failures'] == 0
        else:
            assert found['faults'] == [], found


def test_the_baseline_is_the_formula():
    problem = AdmissibleSet(HEXAROTOR).problem
    wrenches = AdmissibleSet(HEXAROTOR).sample(np.random.default_rng(0), 50)
    wanted = make_allocator('pseudo_inverse', HEXAROTOR).allocate_batch(wrenches).thrusts
    call = baseline(problem).call
    np.testing.assert_allclose([call(u) for u in wrenches], wanted, atol=1e-14)


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


def as_it_is(answer):
    return answer


def test_all_are_asked_the_same_and_every_answer_is_checked(monkeypatch):
    monkeypatch.setattr(timing, 'TURN', 4)
    calls = {(name, 6): Asked() for name in ('one', 'two')}
    judges = {key: Noted(np.arange(10.0)[:, None]) for key in calls}
    rows = timing.measure(
        {key: timing.Track(call, as_it_is, judges[key]) for key, call in calls.items()},
        replace(TINY, repetitions=3, least=3, budget=0.0), seed=0)
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
    assert (timed[['mean', 'p99']] > 0.0).all(axis=None)
    assert rows[rows['repetition'] < 0][['mean', 'p99']].isna().all(axis=None)


def test_who_is_too_slow_for_all_repetitions_takes_part_in_some_evenly_spread():
    for count in range(1, 8):
        part = [k for k in range(7) if timing.takes_part(k, count, 7)]
        assert len(part) == count
        assert part[0] == 0
        gaps = np.diff([*part, 7])
        assert gaps.max() - gaps.min() <= 1
    answer = np.zeros(3)
    rows = timing.measure(
        {('slow', 6): timing.Track(
            lambda u: sum(range(20000)) and answer, as_it_is, Noted(np.zeros((5, 1))))},
        replace(TINY, repetitions=6, least=2, budget=1e-9), seed=0)
    assert rows['repetition'].tolist() == [-1, 0, 3]


def test_a_spread_leaves_out_where_one_took_no_part():
    assert timing.spread([1.0, np.nan, 2.0, 3.0]) == {'low': 1.5, 'median': 2.0, 'high': 2.5}
    one, other = ({'repetitions': each} for each in ([1.0, None, 6.0], [2.0, 4.0, None]))
    assert compare({'one': one, 'other': other}, 'one', 'other') == 0.5
    assert compare({'one': one}, 'one', 'other') is None


# The nodes

LATENCY = """
import json, sys
words = sys.argv[1:]
side = {{'p50': 1e-4, 'p99': 2e-4, 'p99.9': 3e-4, 'late': 0, 'sent': 9, 'answered': 9}}
rate = {{'allocator': side, 'echo': side, 'ratio_p50': 1.0, 'ratio_p99': 1.0}}
found = {{'rates': {{'250': rate, '1000': rate}}, 'repetitions': 1,
         'sustained': {{'allocator': 900.0, 'echo': 1000.0, 'ratio': 0.9}},
         'settings': {{'words': words[2:]}}}}
{fault}
with open(words[words.index('--out') + 1], 'w') as file:
    json.dump(found, file)
"""


def latency(tmp_path, fault=''):
    script = tmp_path / 'latency.py'
    script.write_text(LATENCY.format(fault=fault))
    return (sys.executable, str(script))


@pytest.fixture
def with_ros(monkeypatch):
    monkeypatch.setattr(node, 'find_spec', lambda name: object())


def test_what_the_process_with_ros_measures_is_merged(tmp_path, with_ros, figures):
    found = node.time_node('x8', True, latency(tmp_path))
    assert found['settings']['words'] == ['--vehicle', 'x8', '--quick']
    assert node.time_node('x8', False, latency(tmp_path))['settings']['words'] == [
        '--vehicle', 'x8']
    figures['node'] = found
    text = benchmark.document(figures)
    assert '| 250 Hz, allocator | 100 | 200 | 300 | 0 | 9 of 9 |' in text
    assert 'Highest sustained rate: 900 Hz, echo 1000 Hz, ratio 0.9.' in text


@pytest.mark.parametrize(('fault', 'words'), [
    ("sys.exit('latency: the allocator died')", 'exit code 1 .*: latency: the allocator died'),
    ('sys.exit(3)', 'exit code 3 .*: without a word'),
    ('sys.exit(0)', 'left no result'),
    ('found = 7', 'without rates'),
])
def test_a_failure_of_that_process_is_reported(tmp_path, with_ros, figures, fault, words):
    found = node.time_node('hexarotor', True, latency(tmp_path, fault))
    assert re.search(words, found['error'])
    figures['node'] = found
    assert f'**Not measured: {found["error"]}.**' in benchmark.document(figures)


def test_without_ros_that_is_said(monkeypatch):
    monkeypatch.setattr(node, 'find_spec', lambda name: None)
    assert node.time_node('hexarotor', True) == {'absent': 'rclpy is not installed'}


def test_an_interrupt_waits_for_that_process_to_end_its_nodes(tmp_path):
    child, ready, ended = (tmp_path / name for name in ('child.py', 'ready', 'ended'))
    child.write_text(f"""
import pathlib, signal, time
def end(*_):
    time.sleep(1.0)
    pathlib.Path({str(ended)!r}).touch()
    raise SystemExit
signal.signal(signal.SIGTERM, end)
pathlib.Path({str(ready)!r}).touch()
while True:
    signal.pause()
""")
    parent = f"""
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from ca_ros.evaluation.benchmark import node
node.find_spec = lambda name: object()
node.time_node('hexarotor', True, (sys.executable, {str(child)!r}))
"""
    with subprocess.Popen([sys.executable, '-c', parent], stderr=subprocess.DEVNULL) as process:
        while not ready.exists():
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        process.wait()
    assert ended.exists()


# The command line

def test_a_method_that_does_not_answer_with_thrusts_is_named(own, monkeypatch, capsys):
    (own / 'five.py').write_text("""
from types import SimpleNamespace
class Five:
    def __init__(self, vehicle):
        pass
    def allocate(self, u):
        return SimpleNamespace(thrusts=[1.0] * 5)
""")
    monkeypatch.setattr(benchmark, 'QUICK', TINY)
    assert main(['--quick', '--no-nodes', '--methods', 'five:Five', '--out', str(own)]) == 1
    err = capsys.readouterr().err
    assert err == 'benchmark: five:Five: expected thrusts of 6 rotors, got an array (5,)\n'


@pytest.mark.parametrize(('arguments', 'code', 'words'), [
    (['--vehicle', 'nowhere'], 1, 'nowhere: neither a file nor a shipped vehicle'),
    (['--methods', 'exakt'], 1, "no method 'exakt'"),
    (['-p', 'vehicle.mas:=1'], 1, 'vehicle.mas: no such parameter'),
    (['--seed', '-1'], 2, 'whole number'),
    (['--samples', '0'], 2, 'not a positive number'),
])
def test_what_is_wrong_is_said_in_one_line(arguments, code, words, tmp_path, capsys):
    try:
        found = main([*arguments, '--quick', '--no-nodes', '--out', str(tmp_path)])
    except SystemExit as end:
        found = end.code
    assert found == code
    out, err = capsys.readouterr()
    assert out == ''
    assert re.search(f'benchmark: .*{words}', err.splitlines()[-1])


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
class Threads:
    def __init__(self, vehicle):
        raise ValueError(' '.join(os.environ[name] for name in {THREADS}))
""")
    environment = {name: value for name, value in os.environ.items() if name not in THREADS}
    run = subprocess.run(
        [sys.executable, '-m', BENCHMARK, '--methods', 'threads:Threads'],
        env=environment, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (1, '', 'benchmark: 1 1 1\n')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_one_line(own, number):
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
        process.send_signal(number)
        _, err = process.communicate()
    assert process.returncode == 128 + number
    assert err == 'benchmark: interrupted; nothing is written\n'
    assert list((own / 'out').iterdir()) == []


def test_help_names_the_options(capsys):
    with pytest.raises(SystemExit) as end:
        main(['--help'])
    assert end.value.code == 0
    out = capsys.readouterr().out
    for option in ('--quick', '--no-nodes', '--samples', '--seed', '--vehicle', '--methods',
                   '--param', '--out'):
        assert option in out


# The pages

def test_a_full_run_fills_the_pages_between_their_marks_and_a_quick_one_does_not(
        folder, figures, tmp_path):
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
        figures['settings']['quick'] = quick
        (out / 'benchmark.json').write_text(json.dumps(figures))
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
    assert {line.count('|') for line in rows} == {6}
    assert '](benchmark.png)' in performance
    assert (tmp_path / 'docs' / 'benchmark.png').is_file()


def test_the_pages_have_their_marks():
    root = Path(__file__).resolve().parent.parent
    for name in ('README.md', 'docs/performance.md'):
        text = (root / name).read_text(encoding='utf-8')
        assert len(re.findall('<!-- benchmark -->\n.*?<!-- end of benchmark -->', text,
                              re.DOTALL)) == 1
