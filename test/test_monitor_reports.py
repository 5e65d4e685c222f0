"""What several monitors have found, taken together."""

import numpy as np
import pytest

from ca_ros.allocation.reconfiguration import Failures
from ca_ros.nodes.monitor_reports import MONITORS_MAX, MonitorReports, report_of


def report(*lost, arms=()):
    health = np.ones(6)
    health[[rotor - 1 for rotor in lost]] = 0.0
    return Failures(health, arms, {})


def lost(reports):
    return (np.flatnonzero(reports.together.health == 0.0) + 1).tolist()


def test_a_reset_ends_what_others_have_found_once_however_often_they_speak():
    reports = MonitorReports()
    for origin, failed, together in (
        ('start 1', [2], [2]), ('start 2', [], [2]), ('start 2', [3], [2, 3]),
        ('reset 3', [], []), ('start 1', [2], [2]), ('reset 4', [6], [6]),
        # This monitor was reset before the other one.
        ('reset 3', [5], [5, 6]), ('reset 4', [], [5]), ('start 1', [], [5]),
    ):
        reports.take(origin, report(*failed))
        assert lost(reports) == together
        assert reports.has(origin, report(*failed))


def test_the_newest_is_told_what_others_have_found_and_all_are_told_of_a_reset():
    reports = MonitorReports()
    for origin, failed, told in (
        ('start 1', [2], None), ('start 1', [3], None), ('start 2', [], ('start 2', [3])),
        # What it has found itself is no news to it; what another one finds is.
        ('start 2', [4], None), ('start 1', [3, 5], ('start 2', [3, 5])),
        ('start 1', [], ('start 2', [])), ('reset 6', [], ('reset 6', [])),
        ('start 1', [2], ('reset 6', [2])),
    ):
        reports.take(origin, report(*failed))
        word = reports.word_to_newest()
        assert (word is None) == (told is None)
        if told:
            to, said = report_of(word)
            assert (to, said.key) == (told[0], report(*told[1]).key)


@pytest.mark.parametrize('kind', ['start', 'reset'])
def test_of_many_monitors_few_are_known_one_by_one_and_none_is_forgotten(kind):
    reports = MonitorReports()
    reports.take('start 1', report(1))
    for k in range(2, 1000):
        reports.take(f'{kind} {k}', report(k % 3 + 2))
        assert len(reports.others) < MONITORS_MAX
        assert lost(reports) == (
            [k % 3 + 2] if kind == 'reset' else sorted({1, *(i % 3 + 2 for i in range(2, k + 1))}))
    reports.take('reset 1000', report())
    assert lost(reports) == []


def test_a_reset_counts_once_also_after_many_starts():
    reports = MonitorReports()
    reports.take('reset 1', report())
    reports.take('start 2', report(1))
    for k in range(3, 3 + 2 * MONITORS_MAX):
        reports.take(f'start {k}', report())
    assert reports.has('reset 1', report())
    reports.take('reset 1', report(4))
    assert lost(reports) == [1, 4]
