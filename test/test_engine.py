"""The engine of studies: the same bits on any workers, in processes or on a cluster."""

import json
import os
import pickle
import signal
from argparse import Namespace
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import active_children
from threading import Barrier

import pytest

from ca_ros.errors import CaRosError
from ca_ros.studies import engine, result_files
from ca_ros.studies.engine import compute, deciding_versions
from ca_ros.studies.static import study
from ca_ros.studies.static.study import main

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


def test_results_are_in_the_order_of_the_chunks(tmp_path):
    task = Thirds(tmp_path)
    assert compute(task, COUNT, SERIAL) == EXPECTED
    assert task.computed() == list(range(COUNT))


def test_an_interrupted_study_says_how_far_it_was(tmp_path):
    with pytest.raises(KeyboardInterrupt, match=r'after \d+ of 12 chunks'):
        compute(Thirds(tmp_path, 5, signal.SIGINT), COUNT, SERIAL)


@pytest.mark.filterwarnings('error::pytest.PytestUnhandledThreadExceptionWarning')
def test_an_interrupted_study_ends_its_processes_in_silence(tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(engine.tqdm, 'update', interrupt)
    with pytest.raises(KeyboardInterrupt, match='after 1 of 400 chunks'):
        compute(Thirds(tmp_path), 400, Namespace(workers=2, scheduler=None))
    assert not active_children()


def test_the_machine_is_described_where_there_is_no_list_of_processors(tmp_path, monkeypatch):
    monkeypatch.setattr(result_files, 'CPUS', tmp_path / 'missing')
    assert result_files.machine()['processor']


def test_where_there_is_no_terminal_lines_tell_of_progress(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(engine, 'NEWS', 0.0)
    compute(Thirds(tmp_path), COUNT, SERIAL)
    assert capsys.readouterr().err.splitlines()[-1] == '12 of 12 chunks'


@pytest.mark.long
def test_a_killed_worker_process_is_reported(tmp_path):
    options = Namespace(workers=2, scheduler=None)
    with pytest.raises(CaRosError, match='a worker was killed'):
        compute(Thirds(tmp_path, 5, signal.SIGKILL), COUNT, options)


def test_a_worker_with_other_code_is_refused():
    with pytest.raises(CaRosError, match='another version of numpy than this process'):
        engine.compute_chunk(b'', {**deciding_versions(), 'numpy': '0'}, 0)


def test_threads_of_a_worker_do_not_share_a_task(monkeypatch):
    """OSQP's workspace, for one, holds the wrench that is being solved for."""
    both = Barrier(2, timeout=30.0)
    monkeypatch.setattr(Who, 'met', both)
    given = pickle.dumps(Who()), deciding_versions()
    with ThreadPoolExecutor(2) as pool:
        for _ in range(2):
            made = [pool.submit(engine.compute_chunk, *given, i) for i in (0, 1)]
            found = [each.result() for each in made]
            assert found[0] != found[1]
    assert engine.compute_chunk(*given, -1) == engine.compute_chunk(*given, -1)


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
        patch.setattr(study, 'draw', lambda *_: None)
        patch.setattr(study, 'KEPT', 1000)
        yield


@pytest.fixture(scope='module')
def serial(tmp_path_factory):
    out = tmp_path_factory.mktemp('serial')
    assert main([*STUDY, str(out), '--workers', '1']) == 0
    return written(out)


@pytest.mark.slow
def test_the_static_study_has_the_same_bits_on_workers(serial, tmp_path, capsys, monkeypatch):
    assert main([*STUDY, str(tmp_path), '--workers', '2']) == 0
    assert written(tmp_path) == serial
    assert serial[0]['samples'] == 45_000
    assert len(serial[1]) == 1 + 2 * 1000
    assert 'static.csv has the rows of the first 1000 samples' in capsys.readouterr().out
    # Chunks of several batches: other sums, but nothing else.
    monkeypatch.setattr(engine, 'CHUNKS_MAX', 2)
    assert main([*STUDY, str(tmp_path), '--workers', '1']) == 0
    for name, own in written(tmp_path)[0]['methods'].items():
        for error in ('force_error', 'torque_error'):
            before = serial[0]['methods'][name][error]
            assert own[error]['mean'] == pytest.approx(before['mean'], rel=1e-12)
            assert own[error]['max'] == before['max']
        assert own['violations'] == serial[0]['methods'][name]['violations']


def test_more_rows_are_kept_on_request(tmp_path, capsys):
    few = ['--methods', 'fixed_pseudo_inverse', '--samples', '2000', '--workers', '1']
    assert main([*few, '--out', str(tmp_path), '--rows', '1200']) == 0
    assert len(written(tmp_path)[1]) == 1 + 1200
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


@pytest.mark.long
def test_dask_repeats_the_chunk_of_a_killed_worker(cluster, tmp_path):
    task = Thirds(tmp_path, 5, signal.SIGKILL)
    options = Namespace(workers=None, scheduler=cluster.scheduler_address)
    assert compute(task, COUNT, options) == EXPECTED
    assert (tmp_path / 'computed.sent').exists()


@pytest.mark.long
def test_the_static_study_has_the_same_bits_on_a_cluster(cluster, serial, tmp_path):
    assert main([*STUDY, str(tmp_path), '--scheduler', cluster.scheduler_address]) == 0
    assert written(tmp_path) == serial


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_named_in_one_line(tmp_path, capsys):
    distributed = pytest.importorskip('distributed')
    assert distributed
    assert main([*STUDY, str(tmp_path), '--scheduler', 'nowhere']) == 1
    assert capsys.readouterr().err.startswith('static_study: --scheduler nowhere: ')


@pytest.mark.long
def test_a_cluster_that_goes_away_is_reported(tmp_path):
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=':0') as cluster:
        options = Namespace(workers=None, scheduler=cluster.scheduler_address)
        # A chunk that kills each worker that tries it.
        with pytest.raises(CaRosError, match='KilledWorker'):
            compute(Deadly(tmp_path), COUNT, options)
