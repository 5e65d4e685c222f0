"""The example of a user's own method in docs/reproduction.md."""

import json
import re
import sys
from pathlib import Path

import pytest

from ca_ros.evaluation import dynamic_study, static_study

PAGE = Path(__file__).resolve().parent.parent / 'docs' / 'reproduction.md'
METHODS = 'all,my_methods:Redistributed'


@pytest.fixture
def example(tmp_path, monkeypatch):
    """The example where the user stands, which is not where an installed script lies."""
    fenced = r'<!-- file my_methods.py -->\n```python\n(.*?)```'
    (code,) = re.findall(fenced, PAGE.read_text(), re.DOTALL)
    (tmp_path / 'my_methods.py').write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'path', [place for place in sys.path if place])
    monkeypatch.delitem(sys.modules, 'my_methods', raising=False)
    yield code
    sys.modules.pop('my_methods', None)


def test_it_has_twenty_lines(example):
    assert len(example.splitlines()) <= 20


def test_it_stands_in_the_table_beside_the_others(example, capsys):
    command = ['--methods', METHODS, '--samples', '400', '--vehicle', 'hexarotor_ppnnpn']
    assert static_study.main([*command, '--sampling', 'boundary']) == 0
    methods = json.loads(Path('static.json').read_text())['methods']
    assert list(methods)[-1] == 'my_methods:Redistributed'
    own, exact = methods['my_methods:Redistributed'], methods['exact']
    # As the page says: better than the pseudo-inverse, and not exact.
    assert exact['status'] == {'EXACT': 400}
    assert 0 < own['status']['INEXACT'] < methods['pseudo_inverse']['status']['INEXACT']
    assert own['force_error']['mean'] < methods['pseudo_inverse']['force_error']['mean']
    assert 'my_methods:Redistributed' in capsys.readouterr().out


def test_it_flies_beside_the_others(example):
    assert dynamic_study.main(['--methods', METHODS, '--duration', '1']) == 0
    methods = json.loads(Path('dynamic.json').read_text())['methods']
    assert list(methods)[-1] == 'my_methods:Redistributed'
    assert methods['my_methods:Redistributed']['worst_force_residual'] < 1e-12
    assert '\nmy_methods:Redistributed,1.0,' in Path('dynamic.csv').read_text()


def test_the_nodes_do_not_know_it(example, capsys):
    assert dynamic_study.main(['--methods', METHODS, '--ros']) == 1
    message = capsys.readouterr().err
    assert 'my_methods:Redistributed' in message or 'rclpy' in message
