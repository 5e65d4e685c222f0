"""The tables of the detector, with which docs/scripts/detection.py fills both pages."""

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'docs' / 'scripts'))
import detection
import pages
from detection_page import page_tables, read


def marks(text):
    """Return the marks of a page's parts."""
    return [*re.findall(r'<!-- ([\w ]+) -->\n', text)]


def layout(text, mark):
    """Return titles, and the first cell of each row, of the tables of a marked part."""
    return [([*rows[0]], [next(iter(row.values())) for row in rows])
            for rows in read(text, mark)]


@pytest.fixture(scope='module')
def results():
    return detection.RESULTS.read_text(encoding='utf-8')


@pytest.fixture
def trial(tmp_path, monkeypatch):
    """Return the copy of results.md that a trial writes; the pages are not written."""
    before = [path.read_bytes() for path in (detection.RESULTS, detection.PAGE)]
    monkeypatch.setattr(detection, 'OUT', tmp_path)

    def run(*only):
        detection.main(['--hours', '0.01', '--jobs', '1', '--only', *only])
        return (tmp_path / 'results.md').read_text(encoding='utf-8')

    yield run
    assert before == [path.read_bytes() for path in (detection.RESULTS, detection.PAGE)]


def test_the_marks_of_both_pages_are_those_of_the_script(results):
    # Flights of PX4 are flown by hand.
    names = {*detection.PARTS, *detection.OTHERS, 'propellers', 'px4'}
    assert sorted(marks(results)) == sorted(
        end + name.replace('_', ' ') for name in names for end in ('', 'end of '))
    page = detection.PAGE.read_text(encoding='utf-8')
    found = [mark for mark in marks(page) if not mark.startswith(('end of ', 'needs', 'long'))]
    assert found == [name.replace('_', ' ') for name in page_tables(results)]


def test_the_page_has_what_the_results_say(results):
    page = detection.PAGE.read_text(encoding='utf-8')
    text = page
    for name, content in page_tables(results).items():
        text = pages.filled(text, name.replace('_', ' '), content)
    assert text == page


def test_other_results_make_another_page(results):
    row = r'(\| `hexarotor` \| total \| )(\S+)(.*?\| )(\d+)(/)'  # how many are named, and right
    before = page_tables(results)
    after = page_tables(re.sub(row, r'\g<1>1/402:\3\4\5', results, count=1))
    assert [name for name in before if before[name] != after[name]] == []
    after = page_tables(re.sub(row, r'\1\2\g<3>17\5', results, count=1))
    assert [name for name in before if before[name] != after[name]] == ['losses']
    assert '| `hexarotor` | 17/402 |' in after['losses']


@pytest.mark.parametrize('name', [
    'total', *(pytest.param(name, marks=pytest.mark.slow) for name in ('pushes', 'left')),
    *(pytest.param(name, marks=pytest.mark.long) for name in (
        'pooled', 'landings', 'pushes_elsewhere', 'latency', 'kinds', 'mujoco', 'imu', 'stopped',
        'told', 'acting', 'afterwards', 'own_plant', 'rotorpy'))])
def test_a_small_trial_has_the_same_tables(name, results, trial, capsys):
    if name in ('mujoco', 'rotorpy'):
        pytest.importorskip(name)
    mark = name.replace('_', ' ')
    found = trial(name)
    assert layout(found, mark) == layout(results, mark)
    assert read(found, mark) != read(results, mark)
    assert '--publish' not in found.split(f'<!-- {mark} -->')[1].split('\n|')[0]
    others = [each for each in marks(results) if each != mark and not each.startswith('end of ')]
    assert all(read(found, each) == read(results, each) for each in others)
    assert capsys.readouterr().err == ''


def test_what_cannot_be_flown_stays_and_is_said(results, trial, capsys):
    assert trial('real_flights') == results
    out, err = capsys.readouterr()
    assert (out, err) == ('', 'real_flights: left as it is: needs --flights\n')
    with pytest.raises(SystemExit, match='2'):
        detection.main(['--only', 'real_flights', '--flights', '/nosuch'])
    assert 'error: --flights: no such folder: /nosuch' in capsys.readouterr().err


def test_an_incomplete_set_of_real_flights_is_said(results):
    [sound], [propellers] = (
        read(results, name) for name in ('real flights', 'propellers'))
    found = {name: {row: [None] * 100}
             for name, row in (each['set'].partition(', ')[::2] for each in sound)}
    for row in propellers:
        found['CrazyPAD'][row['propellers']] = [None] * 100
    assert detection.fewer(found) == []
    found['ACSL'][''] = [None]
    del found['CrazyPAD']['tape']
    assert detection.fewer(found) == ['ACSL 1 of 2', 'CrazyPAD tape 0 of 15']


@pytest.mark.parametrize(('share', 'command'), [
    (0.01, '--hours 0.034 --losses 4 --kinds x --mujoco 0.0333'), (2, '--hours 6.8 --losses 800 '
     '--kinds x --mujoco 2.6')])
def test_hours_and_failures_are_scaled_together(share, command):
    given = '--publish --hours 3.4 --losses 400 --kinds x --mujoco 1.3'
    assert detection.scaled(given, share, share < 1) == '--publish ' * (share > 1) + command
    assert detection.scaled('--hours 0 --losses 0', share, False) == '--hours 0 --losses 0'
