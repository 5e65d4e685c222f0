"""The engine of studies: chunks on one executor, of local processes or of a Dask cluster."""

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
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from multiprocessing import active_children, get_context, parent_process
from threading import Thread, local
from time import perf_counter
from typing import Any

from tqdm import tqdm

from ca_ros.allocation.exact import processors
from ca_ros.arguments import positive
from ca_ros.errors import CaRosError
from ca_ros.kernel import chosen
from ca_ros.studies.result_files import versions

CHUNKS_MAX = 500  # of a study: Dask's cost per chunk, some milliseconds, is small
ARRIVAL, NEWS = 30.0, 10.0  # wait for a cluster's first worker, time between two lines [s]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `compute` to a command line."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--workers', type=positive(int), metavar='N',
        help='processes that compute (default: one for each core)')
    where.add_argument('--scheduler', metavar='tcp://HOST:PORT',
        help='compute on a Dask cluster: the address of its scheduler')


def chunk_size(total: int, least: int) -> int:
    """Return the size of chunks, a multiple of `least` that makes at most `CHUNKS_MAX` of them."""
    return least * max(1, -(-total // (least * CHUNKS_MAX)))


def compute(
    task: Callable[[int], Any], count: int, options: argparse.Namespace, **bar: Any,
) -> list[Any]:
    """Return the results of chunks in the order of their numbers, whatever computed them.

    The task, which can be pickled, returns the result of a chunk.  It depends on the number of the
    chunk alone.  The options are those of `add_options`; the bar, which has further arguments,
    counts chunks.  Raises a CaRosError if a worker process was killed, the cluster cannot be
    reached, or has other versions.
    """
    given, done, news = (pickle.dumps(task), deciding_versions()), 0, perf_counter() + NEWS
    futures: list[Future[Any]] = []
    with _executor(options, count) as executor, tqdm(total=count, disable=None, **bar) as shown:
        try:
            futures += (executor.submit(compute_chunk, *given, number) for number in range(count))
            for done, future in enumerate(as_completed(futures), 1):
                future.result()
                shown.update()
                if shown.disable and perf_counter() > news:
                    print(f'{done} of {count} chunks', file=sys.stderr, flush=True)
                    news = perf_counter() + NEWS
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f' after {done} of {count} chunks') from None
        finally:
            if done < count and isinstance(executor, ProcessPoolExecutor):
                # A chunk that is being computed would hold up the end.  Without its processes the
                # executor ends the futures itself; to one that is cancelled it cannot tell so.
                for child in active_children():
                    child.terminate()
            else:
                for future in futures:
                    future.cancel()
    return [future.result() for future in futures]


@contextmanager
def _executor(options: argparse.Namespace, count: int) -> Iterator[Executor]:
    """Open the executor; report what the user can mend as a CaRosError."""
    workers = min(options.workers or processors(), count)
    opened: AbstractContextManager[Executor] = ThreadPoolExecutor(1)
    if options.scheduler:
        opened = _cluster(options.scheduler)
    elif workers > 1:
        opened = ProcessPoolExecutor(workers, get_context('spawn'), _start)
    try:
        with opened as executor:
            yield executor
    except BrokenExecutor:
        raise CaRosError('a worker was killed, perhaps for want of memory') from None


def _start() -> None:
    """Let Ctrl-C end a worker without a traceback, and let it end with its parent."""

    parent: Any = parent_process()

    def follow() -> None:
        parent.join()
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    Thread(target=follow, daemon=True).start()


@contextmanager
def _cluster(scheduler: str) -> Iterator[Executor]:
    """Connect to a Dask cluster, which itself repeats the chunks of lost workers."""
    from distributed import Client, KilledWorker

    try:
        client = Client(scheduler)
        client.wait_for_workers(1, timeout=ARRIVAL)
    except (OSError, ValueError, AsyncTimeoutError) as error:
        raise CaRosError(f'--scheduler {scheduler}: {error}') from None
    try:
        with client:
            yield client.get_executor(pure=False)
    except (CancelledError, KilledWorker) as error:
        raise CaRosError(f'--scheduler {scheduler}: {type(error).__name__}') from None


_last = local()  # the last task of a thread: solvers such as OSQP must not be shared by threads


def compute_chunk(pickled: bytes, expected: Mapping[str, str], number: int) -> Any:
    """Compute a chunk on a worker.

    Raises a CaRosError if the worker has other versions than `expected`: its digits might differ.
    """
    if (found := deciding_versions()) != expected:
        names = ', '.join(name for name in expected if found.get(name) != expected[name])
        raise CaRosError(f'a worker has another version of {names} than this process')
    if getattr(_last, 'pickled', None) != pickled:
        _last.task, _last.pickled = pickle.loads(pickled), pickled
    return _last.task(number)


@cache
def deciding_versions() -> dict[str, str]:
    """Return the versions on which digits depend, and the engine of `exact`."""
    installed = versions()
    found = {name: installed[name] for name in ('ca_ros', 'numpy', 'scipy', 'osqp')}
    return found | {'kernel': 'NumPy' if chosen(1, 1) is None else 'C'}
