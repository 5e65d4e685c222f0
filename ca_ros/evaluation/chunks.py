"""Studies in chunks: on all cores or on a Dask cluster; an interrupted study continues."""

from __future__ import annotations

import argparse
import os
import pickle
import signal
import sys
from asyncio import TimeoutError as AsyncTimeoutError
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from threading import Thread, local
from time import perf_counter
from typing import Any

from tqdm import tqdm

from ca_ros.allocation.exact import processors
from ca_ros.evaluation.chunk_file import ChunkError, ChunkFile, code
from ca_ros.evaluation.options import positive

Task = Callable[[int], Any]
"""Returns the result of a chunk, which depends on its number alone, as JSON has it."""

CHUNKS_MAX = 500
"""Greatest number of chunks of a study: what waits for a worker is bounded, and Dask's cost per
chunk, some milliseconds, is small."""

SERIAL_TIME = 2.0
"""A study that takes no longer than this starts no processes: their start takes as long [s]."""

ARRIVAL = 30.0
"""How long to wait for the first worker of a cluster [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `compute` to a command line."""
    where = parser.add_mutually_exclusive_group()
    cores = 'processes that compute (default: one for each core)'
    where.add_argument('--workers', type=positive(int), metavar='N', help=cores)
    cluster = 'compute on a Dask cluster: the address of its scheduler'
    where.add_argument('--scheduler', metavar='tcp://HOST:PORT', help=cluster)


def chunk_size(total: int, least: int) -> int:
    """Return the size of chunks, a multiple of `least` that makes at most `CHUNKS_MAX` of them."""
    return least * max(1, -(-total // (least * CHUNKS_MAX)))


def compute(
    task: Task, count: int, file: ChunkFile, options: argparse.Namespace, **bar: Any
) -> list[Any]:
    """Compute the chunks that are not in the file, and add them to it.

    Parameters
    ----------
    task : callable
        Can be pickled; a worker loads it once.
    count : int
        Number of chunks.
    file : ChunkFile
    options : Namespace
        With `workers` and `scheduler`, see `add_options`.
    **bar
        Arguments of the progress bar, which counts chunks.

    Returns
    -------
    list
        The results in the order of the chunks' numbers, whatever computed them.  After Ctrl-C,
        those before the first chunk that is missing.

    Raises
    ------
    ChunkError
        If a local worker process was killed, the cluster cannot be reached, or it has other code.
    """
    done = file.read()
    if done:
        print(f'continues: {len(done)} of {count} chunks are in {file.path}', file=sys.stderr)
    left = [number for number in range(count) if number not in done]
    # Without a terminal no bar is shown.
    with tqdm(total=count, initial=len(done), disable=None, **bar) as shown:
        try:
            for number, result in _results(task, left, file.code, options):
                file.append(number, result)
                done[number] = result
                shown.update()
        except KeyboardInterrupt:
            pass
    missing = min(set(range(count)) - done.keys(), default=count)
    return [done[number] for number in range(missing)]


def _results(
    task: Task, left: list[int], expected: Mapping[str, str], options: argparse.Namespace
) -> Iterator[tuple[int, Any]]:
    """Yield the chunks as they are finished: a few in this process, then on the workers."""
    # Before the first call, which may leave in the task what cannot be pickled.
    pickled, end = pickle.dumps(task), perf_counter() + SERIAL_TIME
    workers = options.workers or processors()
    while left and not options.scheduler and (workers == 1 or perf_counter() < end):
        yield left[0], task(left[0])
        del left[0]
    if not left:
        return
    opened = _cluster(options.scheduler) if options.scheduler else _pool(workers)
    with opened as submit:
        futures = {submit(call, pickled, expected, number): number for number in left}
        for future in as_completed(list(futures)):
            yield futures.pop(future), future.result()


@contextmanager
def _pool(workers: int) -> Iterator[Callable[..., Future[Any]]]:
    """Open worker processes on this machine; after an error they are ended at once."""
    pool = ProcessPoolExecutor(workers, get_context('spawn'), initializer=_start)
    try:
        yield pool.submit
    except BrokenExecutor:
        raise ChunkError(
            'a worker process was killed, perhaps for want of memory; the same command continues'
        ) from None
    except BaseException:
        for child in active_children():
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _start() -> None:
    """Let Ctrl-C end a worker without a traceback, and let it end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    Thread(target=_follow, daemon=True).start()


def _follow() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


@contextmanager
def _cluster(scheduler: str) -> Iterator[Callable[..., Future[Any]]]:
    """Connect to a Dask cluster, which itself repeats the chunks of lost workers."""
    from distributed import Client, KilledWorker

    try:
        client = Client(scheduler)
        client.wait_for_workers(1, timeout=ARRIVAL)
    except (OSError, ValueError, AsyncTimeoutError) as error:
        raise ChunkError(f'--scheduler {scheduler}: {error}') from None
    with client:
        submit = client.get_executor(pure=False).submit
        # Without a priority, chunks that are submitted together run in any order.
        try:
            yield lambda *given: submit(*given, priority=-given[-1])
        except (CancelledError, KilledWorker) as error:
            lost = 'too many workers' if isinstance(error, KilledWorker) else 'the scheduler'
            raise ChunkError(
                f'--scheduler {scheduler}: {lost} went away; the same command continues'
            ) from None


def call(pickled: bytes, expected: Mapping[str, str], number: int) -> Any:
    """Compute a chunk on a worker.

    Raises a ChunkError if the worker has other code than `expected`: its results might differ.
    """
    found = code(*(name for name in expected if ':' in name))
    if found != expected:
        names = ', '.join(name for name in expected if found.get(name) != expected[name])
        raise ChunkError(f'a worker has another version of {names} than this process')
    return _loaded(pickled)(number)


class _Last(local):
    """The last task of a thread: solvers such as OSQP must not be shared by threads."""

    pickled: bytes = b''
    task: Task


_last = _Last()


def _loaded(pickled: bytes) -> Task:
    if _last.pickled != pickled:
        _last.task = pickle.loads(pickled)
        _last.pickled = pickled
    return _last.task
