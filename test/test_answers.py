"""Answers do not change from one version to the next, whichever engine gives them.

`make compare` compares all answers of two versions bit for bit; this table has a few of them.
"""

import csv
import itertools
from pathlib import Path

import numpy as np
import pytest

import ca_ros
from benchmarks.release import compare, speed
from benchmarks.release.table import rows

TABLE = Path(__file__).with_name('answers.csv')


def test_the_answers_are_those_of_the_table():
    with TABLE.open(encoding='utf-8', newline='') as file:
        wanted = list(csv.reader(file))
    found = list(rows())
    assert [row[:3] for row in found] == [row[:3] for row in wanted]
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(
            np.array(one[3:], float), np.array(other[3:], float), rtol=0.0,
            atol=1e-9 * max(1.0, np.abs(np.array(other[3:], float)).max()), err_msg=one[0])


@pytest.mark.parametrize(('other', 'words'), [
    ([1.0, np.nan, 0.0], ''),
    ([1.0, np.nan, -0.0], '1 of 3, at most 0'),
    ([1.0 + 2e-16, np.nan, 0.0], '1 of 3, at most 2.2e-16'),
    ([1.0, 2.0, 0.0], '1 of 3, at most nan'),
    ([1.0, np.nan], 'shape (3,), then (2,)'),
])
def test_a_difference_of_one_bit_is_named(other, words):
    assert compare.difference(np.array([1.0, np.nan, 0.0]), np.array(other)) == words


def test_a_text_that_differs_is_shown():
    found = compare.difference(np.array(['as it was', 'a']), np.array(['as it was', 'b']))
    assert found == '1 of 2, first a -> b'


BENCHMARKS = [each for each in vars(speed).values() if isinstance(each, type) and any(
    name.startswith('time_') for name in vars(each))]


@pytest.mark.parametrize('kind', BENCHMARKS, ids=lambda kind: kind.__name__)
def test_this_version_runs_each_benchmark_of_speed(kind, monkeypatch):
    monkeypatch.setattr(speed, 'CALLS', 3)
    params = getattr(kind, 'params', ())
    for values in itertools.product(*params):
        benchmark = kind()
        benchmark.setup(*values)
        for name in vars(kind):
            if name.startswith('time_'):
                getattr(benchmark, name)(*values)


def test_what_a_version_lacks_is_left_out():
    with pytest.raises(NotImplementedError), speed.optional():
        ca_ros.no_such_name  # noqa: B018
