"""The pytest plugin of `ca_ros.testing`: the fixture `graph`, and reports of failed tests.

A module of its own, because an import within the package would load NumPy in each run of pytest.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from ca_ros.testing import Graph


@pytest.fixture
def graph() -> Iterator[Graph]:
    """Give a test a ROS graph of its own (`ca_ros.testing.Graph`)."""
    try:
        from ca_ros.testing import Graph
    except ModuleNotFoundError as error:
        hint = "pip install 'ca_ros[ros,testing]', or source ROS 2 Jazzy"
        pytest.fail(f'the fixture graph needs {error.name}: {hint}', pytrace=False)
    with Graph() as graph:
        yield graph


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[Any]) -> None:
    """Add the output of the processes to the report of a failed test."""
    testing = sys.modules.get('ca_ros.testing.graph')
    failed = call.excinfo is not None and not call.excinfo.errisinstance(pytest.skip.Exception)
    for graph in testing.Graph.opened if failed and testing else ():
        graph.failed = True
        for title, text in graph.report():
            item.add_report_section(call.when, title, text)
