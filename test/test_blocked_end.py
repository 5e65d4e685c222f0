"""A node that Fast DDS blocks at its end is an expected failure, and nothing else is one."""

import sys

import pytest

from ca_ros.testing import Graph

SCRIPT = """
import faulthandler, time
def {name}():
    faulthandler.dump_traceback_later(0.01, exit=True)
    time.sleep(60.0)
{name}()
"""


def blocking(folder, name):
    """Return the path of a program that blocks in a function of a file like one of rclpy."""
    (folder / 'rclpy').mkdir()
    file = folder / 'rclpy' / 'node.py'
    file.write_text(SCRIPT.format(name=name), encoding='utf-8')
    return str(file)


def test_a_blocked_end_is_an_expected_failure(tmp_path):
    with Graph() as graph:
        process = graph.start(sys.executable, blocking(tmp_path, 'destroy_node'))
        with pytest.raises(pytest.xfail.Exception, match='issue 6513'):
            graph.outlive(process)
        assert process.returncode == 1


def test_a_block_elsewhere_is_none(tmp_path):
    with Graph() as graph:
        process = graph.start(sys.executable, blocking(tmp_path, 'publish'))
        assert 'in publish' in graph.outlive(process)[1]
        assert process.returncode == 1
