"""What every test gets: ROS to itself, on this machine alone."""

import os
import signal
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Before numpy, rclpy and the messages are imported, which read some of it only then.
os.environ |= {
    # Several processes share the processors.
    'OPENBLAS_NUM_THREADS': '1',
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    'ROS_PYTHON_CHECK_FIELDS': '1',
    'CA_ROS_TEST_DEADLINE': '240',
}



def kernel_in(folder):
    """Return whether a folder has the package with its kernel."""
    kernel = folder / 'ca_ros' / 'kernel'
    return any((kernel / f'_double{suffix}').is_file() for suffix in EXTENSION_SUFFIXES)


# colcon builds the kernel where it installs the package, and starts the tests among the sources:
# these come last then, for this process and for those that it starts.
installed = [path for path in sys.path if path and Path(path).resolve() != ROOT]
if not kernel_in(ROOT) and any(kernel_in(Path(path)) for path in installed):
    sys.path[:] = [*installed, str(ROOT)]
    os.environ['PYTHONSAFEPATH'] = '1'

# Otherwise each process of the tests compiles all that it imports, if the installer has not.
os.environ.pop('PYTHONDONTWRITEBYTECODE', None)
sys.dont_write_bytecode = False

# What nohup or a shell in the background ignores, the processes of the tests would ignore, too.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope='session', autouse=True)
def _own_ros(tmp_path_factory):
    """Keep the logs of ROS out of the user's own, and what flies without `graph` to itself."""
    if find_spec('rclpy') is None:
        yield
        return
    # Here, because the path and the environment above come first.
    from ca_ros.testing import domain

    os.environ['ROS_LOG_DIR'] = str(tmp_path_factory.mktemp('log'))
    with domain.claim() as number:
        os.environ['ROS_DOMAIN_ID'] = str(number)
        yield


NODES = {'graph', 'nodes', 'client', 'shared'}
"""Fixtures that start nodes."""

FLIGHTS = {'exported', 'failing', 'flights', 'study'}
"""Fixtures that take seconds."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark what takes seconds as slow; leave out what is long, but in `make test-all`."""
    for item in items:
        if item.get_closest_marker('slow'):
            continue
        if NODES & {*item.fixturenames}:
            item.add_marker('nodes')
        if (NODES | FLIGHTS) & {*item.fixturenames}:
            item.add_marker('slow')
    if not os.environ.get('CA_ROS_LONG'):
        long = [item for item in items if item.get_closest_marker('long')]
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if item not in long]
