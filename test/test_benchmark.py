"""The benchmark: contenders are asked the right question; what they take is not judged here."""

import itertools
import time
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pytest

import benchmarks.__main__ as benchmark
from benchmarks import latency, timing
from benchmarks.answers import Answers, faults
from benchmarks.contenders import BASELINE, CONTENDERS, peer
from benchmarks.in_c import NAMES, compiled
from benchmarks.parts import SETS
from benchmarks.sizes import QUICK
from benchmarks.timing import Key
from ca_ros import AdmissibleSet, make_allocator
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.studies.wrench_sets import near_boundary, samples
from strategies import FLEET, HEXAROTOR

pytestmark = pytest.mark.slow

TINY = replace(
    QUICK, wrenches=12, flight=40, repetitions=2, least=1, budget=1e-4,
    batches={10: 3, 20: 1}, looped=6, rounds=1, rotors=(4, 6))
INSTALLED = [name for name, each in CONTENDERS.items() if each.package and find_spec(each.package)]


def careless(problem):
    """Answer at once, and always the same."""
    return lambda u: problem.upper.copy()


@pytest.mark.long
def test_a_run_measures_all_and_marks_who_is_wrong(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, 'QUICK', TINY)
    monkeypatch.setitem(CONTENDERS, 'careless', peer('', careless))
    assert benchmark.main(['--quick', '--no-nodes', '--out', str(tmp_path)]) == 0
    rows = pd.read_csv(tmp_path / 'results.csv')
    calls = rows[rows['part'] == 'calls']
    assert {(kind, name) for kind in SETS for name in (*INSTALLED, 'exact', 'careless')} <= set(
        zip(calls['wrenches'], calls['contender'], strict=True))
    assert (rows.loc[rows['repetition'] >= 0, 'time'] > 0.0).all()
    results = timing.summarize(rows, BASELINE)
    assert (results.xs('exact', level='contender')['faults'] == '').all()
    assert 'wrench' in results.loc[('calls', 'flight', 'careless', 6), 'faults']
    text = (tmp_path / 'results.md').read_text(encoding='utf-8')
    for words in ('## Limits', '## In C', '## Number of rotors', '## Batches', '| `careless` |'):
        assert words in text
    assert (tmp_path / 'results.png').stat().st_size > 20_000


@pytest.mark.parametrize('name', INSTALLED)
@pytest.mark.parametrize('vehicle', ['hexarotor', 'x8'])
def test_a_peer_gives_the_exact_answer(name, vehicle):
    admissible = AdmissibleSet(FLEET[vehicle])
    wrenches = admissible.sample(np.random.default_rng(0), 60)
    answers = Answers(admissible.problem, wrenches)
    call = CONTENDERS[name].call(admissible.problem)
    for _ in range(2):
        worst = answers.worst([np.array(call(u)) for u in wrenches])
        assert worst['failures'] == 0
        # What the default tolerances of OSQP and the slack of DAQP's levels are good for.
        limit = {'osqp': 0.1, 'daqp_hierarchical': 5e-6}.get(name, 1e-6)
        assert worst['error'] <= limit
        assert worst['violation'] <= limit
        assert name == 'osqp' or not worst['norm_excess'] > 1e-6


@pytest.mark.long
def test_contenders_in_c_give_the_exact_answer():
    admissible, rng = AdmissibleSet(HEXAROTOR), np.random.default_rng(0)
    calls, absent, about = compiled(admissible.problem)
    if not calls:
        pytest.skip(absent['exact'])
    assert set(calls) | set(absent) == set(NAMES)
    assert '-O3' in about
    wrenches = np.concatenate([admissible.sample(rng, 60), near_boundary(admissible, rng, 60)])
    answers = Answers(admissible.problem, wrenches)
    for name in set(calls) & {'exact', 'daqp_reused'}:
        times, given = calls[name].one_by_one(list(wrenches))
        assert min(times) >= 0
        assert 0 <= calls[name].together(list(wrenches)) < 1e9
        assert faults(answers.worst(given)) == '', name
    _, ours = calls['exact'].one_by_one(list(wrenches))
    wanted = make_allocator('exact', HEXAROTOR).allocate_batch(wrenches).thrusts
    np.testing.assert_allclose(ours, wanted, atol=1e-11)
    if 'daqp_hierarchical' in calls:
        _, served = calls['daqp_hierarchical'].one_by_one(list(wrenches))
        call = CONTENDERS['daqp_hierarchical'].call(admissible.problem)
        np.testing.assert_allclose(served, [call(u) for u in wrenches], atol=1e-6)
    _, clipped = calls[BASELINE].one_by_one(list(wrenches))
    wanted = make_allocator('pseudo_inverse', HEXAROTOR).allocate_batch(wrenches).thrusts
    np.testing.assert_allclose(clipped, wanted, atol=1e-14)


@pytest.mark.parametrize(('number', 'change', 'fault'), [
    (3, lambda f: f, ''),
    (3, lambda f: f + 1e-5, 'wrench'),
    (3, lambda f: None, 'no answer to 1'),
    (22, lambda f: np.full(6, 4.1), 'bounds'),
    (22, lambda f: np.full(6, 2.0), ''),
])
def test_every_fault_is_found(number, change, fault):
    admissible = AdmissibleSet(HEXAROTOR)
    sets = {'volume': 20, 'outside': 5}
    parts = [samples(admissible, kind, 0, 0, size) for kind, size in sets.items()]
    answers = Answers(admissible.problem, np.concatenate(parts))
    given = [*make_allocator('exact', HEXAROTOR).allocate_batch(parts[0]).thrusts, *[None] * 5]
    given[number] = change(given[number])
    assert faults(answers.worst(given)) == fault


def test_thrusts_that_are_not_the_least_are_found():
    problem = VehicleProblem(HEXAROTOR)
    null = np.linalg.svd(problem.gamma)[2][-1]
    least = np.full(6, problem.hover[0] / 6.0)
    worst = Answers(problem, problem.hover[None]).worst([least + 0.1 * null])
    assert faults(worst) == 'norm'
    assert worst['norm_excess'] == pytest.approx(
        np.linalg.norm(least + 0.1 * null) - np.linalg.norm(least))


def test_a_ratio_is_that_of_neighbours_in_time():
    # A machine that slows down threefold, and stalls once, does not show in the ratios 2, 9 and 2.
    one, other = Key('calls', 'flight', 'exact', 6), Key('calls', 'flight', BASELINE, 6)
    rows = pd.DataFrame(
        {**key._asdict(), 'repetition': i, 'time': time}
        for key, times in ((one, (2.0, 9.0, 6.0)), (other, (1.0, 1.0, 3.0)))
        for i, time in enumerate(times))
    assert timing.ratio(rows, one, other) == 2.0
    assert timing.ratio(rows, one, other._replace(contender='absent')) is None


def test_an_interruption_decides_no_percentile():
    problem = VehicleProblem(HEXAROTOR)
    exact, asked = make_allocator('exact', HEXAROTOR), itertools.count()

    def interrupted(u):
        # In each repetition another wrench.
        time.sleep(0.02 * (next(asked) % 61 == 0))
        return exact.allocate(u)

    wrenches = AdmissibleSet(problem).sample(np.random.default_rng(0), 20)
    key = Key('calls', 'uniform', BASELINE, 6)
    sizes = replace(TINY, repetitions=5, least=5)
    rows = timing.measure({key: interrupted}, {key: Answers(problem, wrenches)}, sizes, 0)
    assert (rows['time'].dropna() > 0.0).all()
    assert rows['worst'].max() < 0.02


# The nodes

def block(latencies, delays=0.0):
    return pd.DataFrame({'delay': delays, 'latency': latencies})


def test_metrics_of_latency_by_hand():
    latencies = np.array([1e-3, 2e-3, 3e-3, 2e-3, np.nan])
    found = latency.metrics(block(latencies, [0.0, 0.0, 0.0, 1e-3, 0.0]), 2.5e-3)
    assert (found['p50'], found['sent'], found['answered']) == (2e-3, 5, 4)
    # The third is late, the fourth because it was sent late, and the fifth was never answered.
    assert found['late'] == 3
    with pytest.raises(latency.CaRosError):
        latency.metrics(block(np.full(3, np.nan)), 1.0)


@pytest.mark.long
def test_the_node_is_measured_beside_the_echo_node(graph, monkeypatch):
    monkeypatch.setattr(latency, 'RATES', (50.0,))
    rows = latency.measure_nodes('hexarotor', replace(TINY, blocks=(2, 0.2)))
    assert sorted(rows['contender']) == ['allocator'] * 2 + ['echo'] * 2
    assert ((rows['p50'] > 0.0) & (rows['p50'] <= rows['p99'])).all()
    assert (rows['answered'] > 0).all()
