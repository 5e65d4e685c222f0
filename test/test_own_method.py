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
    """Write the example to the current directory, which is not in the path of a script."""
    fenced = r'<!-- file my_methods.py -->\n```python\n(.*?)```'
    (code,) = re.findall(fenced, PAGE.read_text(), re.DOTALL)
    (tmp_path / 'my_methods.py').write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'path', [place for place in sys.path if place])
    monkeypatch.delitem(sys.modules, 'my_methods', raising=False)
    yield
    sys.modules.pop('my_methods', None)


def test_the_studies_have_it_beside_the_others(example, capsys):
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
    assert dynamic_study.main(['--methods', METHODS, '--duration', '1']) == 0
    assert '\nmy_methods:Redistributed,1.0,' in Path('dynamic.csv').read_text()


def test_the_nodes_do_not_know_it(example, capsys):
    assert dynamic_study.main(['--methods', METHODS, '--ros']) == 1
    message = capsys.readouterr().err
    assert 'my_methods:Redistributed' in message or 'rclpy' in message
