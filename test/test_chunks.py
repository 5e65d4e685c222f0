"""Studies in chunks: the same bits on any workers, after a kill and after an interruption."""

import json
import os
import pickle
import signal
from argparse import Namespace
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from threading import Barrier

import pytest

from ca_ros.evaluation import chunk_file, chunks, static_study
from ca_ros.evaluation.chunk_file import ChunkError, ChunkFile, code
from ca_ros.evaluation.chunks import chunk_size, compute
from ca_ros.evaluation.static_study import main

COUNT = 12
EXPECTED = [[number, 1.0 / (number + 3.0)] for number in range(COUNT)]
SERIAL = Namespace(workers=1, scheduler=None)


class Thirds:
    """A task whose process is sent a signal, once, in a given chunk."""

    def __init__(self, folder, chunk=None, number=None):
        self.log, self.chunk, self.number = folder / 'computed', chunk, number

    def __call__(self, chunk):
        if chunk == self.chunk and not self.log.with_suffix('.sent').exists():
            self.log.with_suffix('.sent').touch()
            os.kill(os.getpid(), self.number)
        with self.log.open('a') as file:
            file.write(f'{chunk}\n')
        return [chunk, 1.0 / (chunk + 3.0)]

    def computed(self):
        """Return the chunks that were computed, in their order."""
        return [int(line) for line in self.log.read_text().split()]


class Deadly(Thirds):
    """A task that kills its process in chunk 5, whenever that is computed."""

    def __call__(self, chunk):
        if chunk == 5:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__(chunk)


class Who:
    """A task that tells which copy of it computes, once two threads do."""

    met = None

    def __call__(self, chunk):
        if chunk >= 0:
            self.met.wait()
        return id(self)


@pytest.fixture
def file(tmp_path):
    return ChunkFile(tmp_path, {'study': 'thirds'})


@pytest.fixture
def on_workers(monkeypatch):
    """Start workers at once, not after the first seconds."""
    monkeypatch.setattr(chunks, 'SERIAL_TIME', 0.0)


@pytest.mark.parametrize(('total', 'least', 'size'), [
    (300, 100, 100), (1, 100, 100), (5_000_000, 10_000, 10_000), (5_000_001, 10_000, 20_000),
    (100_000_000, 10_000, 200_000)])
def test_there_are_at_most_500_chunks(total, least, size):
    assert chunk_size(total, least) == size
    assert -(-total // size) <= chunks.CHUNKS_MAX


@pytest.mark.parametrize('workers', [1, 2])
def test_results_are_in_the_order_of_the_chunks_on_any_number_of_workers(
        workers, file, tmp_path, on_workers):
    task = Thirds(tmp_path)
    assert compute(task, COUNT, file, Namespace(workers=workers, scheduler=None)) == EXPECTED
    assert sorted(task.computed()) == list(range(COUNT))


def test_an_interrupted_study_continues_where_it_was(file, tmp_path, capsys):
    task = Thirds(tmp_path, 5, signal.SIGINT)
    assert compute(task, COUNT, file, SERIAL) == EXPECTED[:5]
    assert capsys.readouterr().err == ''
    assert compute(task, COUNT, file, SERIAL) == EXPECTED
    assert task.computed() == list(range(COUNT))
    assert f'continues: 5 of 12 chunks are in {file.path}' in capsys.readouterr().err
    with pytest.raises(KeyboardInterrupt, match='after 5 of 12 chunks, which are'):
        file.conclude(5, COUNT, 'chunks')
    file.conclude(COUNT, COUNT, 'chunks')
    assert compute(task, COUNT, file, SERIAL) == EXPECTED
    assert len(task.computed()) == 2 * COUNT


@pytest.mark.parametrize('cut', [1, 5, 10_000])
def test_a_line_cut_off_by_a_kill_is_computed_again(cut, file, tmp_path):
    compute(Thirds(tmp_path), COUNT, file, SERIAL)
    whole = file.path.read_bytes()
    file.path.write_bytes(whole[:-cut])
    assert len(file.read()) == (0 if cut == 10_000 else COUNT - 1)
    assert compute(Thirds(tmp_path), COUNT, file, SERIAL) == EXPECTED
    assert file.path.read_bytes() == whole


@pytest.mark.parametrize('damage', [b'', b'\0\0', b'[4, {"a', b'\xff', b'4'])
def test_a_damaged_line_is_computed_again(damage, file, tmp_path):
    compute(Thirds(tmp_path), COUNT, file, SERIAL)
    lines = file.path.read_bytes().splitlines()
    assert json.loads(lines[5])[0] == 4
    lines[5] = damage
    file.path.write_bytes(b'\n'.join(lines) + b'\n')
    assert file.read().keys() == set(range(COUNT)) - {4}
    assert compute(Thirds(tmp_path), COUNT, file, SERIAL) == EXPECTED


def test_another_study_or_other_code_starts_anew_and_keeps_the_chunks_of_the_first(
        file, tmp_path, monkeypatch):
    compute(Thirds(tmp_path), COUNT, file, SERIAL)
    assert len(file.read()) == COUNT
    assert ChunkFile(tmp_path, {'study': 'halves'}).read() == {}
    monkeypatch.setattr(chunk_file, 'code', lambda: {'numpy': '0'})
    assert ChunkFile(tmp_path, {'study': 'thirds'}).read() == {}
    assert len(file.read()) == COUNT


def test_a_killed_worker_process_is_reported_and_the_study_continues(
        file, tmp_path, on_workers):
    task, options = Thirds(tmp_path, 5, signal.SIGKILL), Namespace(workers=2, scheduler=None)
    with pytest.raises(ChunkError, match=r'killed.*the same command continues'):
        compute(task, COUNT, file, options)
    assert 0 < len(file.read()) < COUNT
    assert compute(task, COUNT, file, SERIAL) == EXPECTED


def test_a_worker_with_other_code_is_refused():
    with pytest.raises(ChunkError, match='another version of numpy than this process'):
        chunks.call(b'', {**code(), 'numpy': '0'}, 0)


def test_a_worker_with_another_source_of_ones_own_method_is_refused(tmp_path, monkeypatch):
    """A Dask worker keeps the module that it imported for an earlier study."""
    module, head = tmp_path / 'own_of_chunks.py', 'from ca_ros.allocation import Direct\n'
    module.write_text(f'{head}class Own(Direct):\n    version = 1\n')
    monkeypatch.syspath_prepend(tmp_path)
    method = 'own_of_chunks:Own'
    file = ChunkFile(tmp_path, {}, [method])
    task = pickle.dumps(Thirds(tmp_path))
    assert chunks.call(task, file.code, 0) == EXPECTED[0]
    # What another process finds after a change of the file.
    module.write_text(f'{head}class Own(Direct):\n    version = 2\n')
    changed = {**file.code, method: sha256(module.read_bytes()).hexdigest()}
    with pytest.raises(ChunkError, match=f'another version of {method} than this process'):
        chunks.call(task, changed, 0)
    with pytest.raises(ChunkError, match='No module named'):
        chunks.call(task, {**code(), 'absent_of_chunks:Own': ''}, 0)


def test_threads_of_a_worker_do_not_share_a_task(monkeypatch):
    """OSQP's workspace, for one, holds the wrench that is being solved for."""
    both = Barrier(2, timeout=30.0)
    monkeypatch.setattr(Who, 'met', both)
    pickled = pickle.dumps(Who())
    with ThreadPoolExecutor(2) as pool:
        for _ in range(2):
            made = [pool.submit(chunks.call, pickled, code(), i) for i in (0, 1)]
            found = [each.result() for each in made]
            assert found[0] != found[1]
    assert chunks.call(pickled, code(), -1) == chunks.call(pickled, code(), -1)


# The static study

STUDY = ['--methods', 'exact,fixed_pseudo_inverse', '--samples', '4.5e4', '--out']


def written(folder):
    """Return what a study wrote, apart from times."""
    found = json.loads((folder / 'static.json').read_text())
    for own in found['methods'].values():
        del own['time']
    rows = (folder / 'static.csv').read_text().splitlines()
    place = rows[0].split(',').index('time')
    return found, [[word for i, word in enumerate(row.split(',')) if i != place] for row in rows]


@pytest.fixture(scope='module', autouse=True)
def plain():
    """Draw no plots, and keep few rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(static_study, 'draw', lambda *_: None)
        patch.setattr(static_study, 'KEPT', 1000)
        yield


@pytest.fixture(scope='module')
def serial(tmp_path_factory):
    out = tmp_path_factory.mktemp('serial')
    assert main([*STUDY, str(out), '--workers', '1']) == 0
    return written(out)


@pytest.mark.slow
def test_the_static_study_has_the_same_bits_on_workers(
        serial, tmp_path, on_workers, capsys, monkeypatch):
    assert main([*STUDY, str(tmp_path), '--workers', '2']) == 0
    assert written(tmp_path) == serial
    assert serial[0]['samples'] == 45_000
    assert len(serial[1]) == 1 + 2 * 1000
    assert 'static.csv has the rows of the first 1000 samples' in capsys.readouterr().out
    assert list(tmp_path.glob('chunks*')) == []
    # Chunks of several batches: other sums, but nothing else.
    monkeypatch.setattr(chunks, 'CHUNKS_MAX', 2)
    assert main([*STUDY, str(tmp_path), '--workers', '1']) == 0
    for name, own in written(tmp_path)[0]['methods'].items():
        for error in ('force_error', 'torque_error'):
            before = serial[0]['methods'][name][error]
            assert own[error]['mean'] == pytest.approx(before['mean'], rel=1e-12)
            assert own[error]['max'] == before['max']
        assert own['violations'] == serial[0]['methods'][name]['violations']


def test_more_rows_are_kept_on_request(tmp_path, capsys):
    assert main([*STUDY, str(tmp_path), '--rows', '12000']) == 0
    assert len(written(tmp_path)[1]) == 1 + 2 * 12_000
    with pytest.raises(SystemExit):
        main([*STUDY, str(tmp_path), '--rows', '999'])
    assert 'need at least 1000' in capsys.readouterr().err


# Dask

@pytest.fixture(scope='module')
def cluster():
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=':0') as cluster:
        yield cluster


@pytest.mark.slow
def test_dask_repeats_the_chunk_of_a_killed_worker(cluster, file, tmp_path):
    task = Thirds(tmp_path, 5, signal.SIGKILL)
    options = Namespace(workers=None, scheduler=cluster.scheduler_address)
    assert compute(task, COUNT, file, options) == EXPECTED
    assert (tmp_path / 'computed.sent').exists()
    # In the order of their numbers, so that an interrupted study has the first samples.
    assert {0, 1, 2, 3} <= set(task.computed()[:7])


@pytest.mark.slow
def test_the_static_study_has_the_same_bits_on_a_cluster(cluster, serial, tmp_path):
    assert main([*STUDY, str(tmp_path), '--scheduler', cluster.scheduler_address]) == 0
    assert written(tmp_path) == serial


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_named_in_one_line(tmp_path, capsys):
    distributed = pytest.importorskip('distributed')
    assert distributed
    assert main([*STUDY, str(tmp_path), '--scheduler', 'nowhere']) == 1
    assert capsys.readouterr().err.startswith('static_study: --scheduler nowhere: ')


@pytest.mark.slow
def test_a_cluster_that_goes_away_is_reported_and_the_study_continues(file, tmp_path):
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=':0') as cluster:
        options = Namespace(workers=None, scheduler=cluster.scheduler_address)
        # A chunk that kills each worker that tries it.
        with pytest.raises(ChunkError, match='too many workers went away; the same command cont'):
            compute(Deadly(tmp_path), COUNT, file, options)
    assert compute(Thirds(tmp_path), COUNT, file, SERIAL) == EXPECTED
