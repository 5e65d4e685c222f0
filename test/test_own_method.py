"""The example of a user's own method in docs/own_method.md."""

import json
import pickle
import re
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml

from ca_ros import ParameterError, Status, make_allocator
from ca_ros.studies.cases import Case
from ca_ros.studies.static import study as static_study
from strategies import HEXAROTOR, file_values

PAGE = Path(__file__).resolve().parent.parent / 'docs' / 'own_method.md'
OWN = 'my_methods:Scaled'
RESERVE = 'allocation.Scaled.reserve'


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


def test_python_has_it(example):
    # 12 N and 0.24 N m are 2 +- 2 N; the middles are 2.02 N, and the ranges 1.98 N to each side.
    a = make_allocator(OWN, HEXAROTOR).allocate([12.0, 0.0, 0.0, 0.24])
    share = 1.98 / 2.02
    np.testing.assert_allclose(a.thrusts, 2.02 + share * np.array([1.98, -2.02] * 3))
    assert a.status is Status.INEXACT
    a = make_allocator(OWN, HEXAROTOR, reserve=0.5).allocate([12.0, 0.0, 0.0, 0.24])
    assert a.thrusts.min() == pytest.approx(2.02 - 0.99)


def test_a_study_has_it_beside_the_others(example, monkeypatch):
    monkeypatch.setattr(static_study, 'draw', lambda *_: None)
    command = ['--methods', f'exact,pseudo_inverse,{OWN}', '--samples', '50']
    assert static_study.main([*command, '--sampling', 'boundary']) == 0
    found = json.loads(Path('static.json').read_text())['methods']
    assert list(found)[-1] == OWN
    # As the page says: it misses the wrench where the pseudo-inverse violates a bound.
    assert found[OWN]['status'] == found['pseudo_inverse']['status'] == {'INEXACT': 50}


def test_its_options_are_parameters(example):
    case = Case.load('hexarotor', [f'{RESERVE}:=0.3'], [OWN])
    assert pickle.loads(pickle.dumps(case.settings)) == case.settings
    allocator = case.allocator(OWN)
    np.testing.assert_allclose(allocator.range, 0.7 * 1.98)
    with pytest.raises(ParameterError, match=rf'{RESERVE}: must be in \[0, 0.9\], got 2'):
        Case.load('hexarotor', [f'{RESERVE}:=2'], [OWN])
    with pytest.raises(ParameterError, match=f'{RESERVE}: no such parameter'):
        Case.load('hexarotor', [f'{RESERVE}:=0.3'])
    values = file_values('hexarotor') | {'allocation.method': OWN, RESERVE: 0.1}
    Path('mine.yaml').write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    assert file_values('mine.yaml') == values
    values['allocation.Scaled.reserv'] = values.pop(RESERVE)
    Path('mine.yaml').write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    with pytest.raises(ParameterError, match=rf'mine.yaml: .*did you mean {RESERVE}\?'):
        file_values('mine.yaml')


@pytest.mark.parametrize(('method', 'words'), [
    ('nowhere:Mine', 'nowhere:Mine: No module named'),
    ('my_methods:Mine', "my_methods:Mine: .* no attribute 'Mine'"),
    ('json:loads', 'json:loads: not a class'),
    ('json:JSONDecoder', 'json:JSONDecoder: expected a subclass of ca_ros.Allocator'),
    ('ca_ros:Allocator', 'ca_ros:Allocator: the class does not define _allocate'),
    ('broken:Any', 'broken:Any: division by zero'),
    ('magic', r"no allocation method 'magic' \(there are exact, .* and module:Class for your own"),
])
def test_what_is_no_method_is_named(example, method, words):
    Path('broken.py').write_text('1 / 0\n')
    with pytest.raises(ValueError, match=words):
        make_allocator(method, HEXAROTOR)


# Over ROS

@pytest.mark.skipif(find_spec('rclpy') is None, reason='needs rclpy')
def test_a_running_node_takes_it(example, graph):
    graph.start(
        'allocator', '--vehicle', 'hexarotor', '--ros-args', '-p', f'allocation.method:={OWN}',
        '-p', f'{RESERVE}:=0.2')
    parameters = graph.connect('allocator')
    assert parameters.get('allocation.method', RESERVE) == [OWN, 0.2]
    # In flight the node loads no code.
    Path('intruder.py').write_text("open('loaded', 'w').close()\n")
    for values, words in (
            ({'allocation.method': 'intruder:Mine'}, 'was not loaded at the start'),
            ({RESERVE: 2.0}, f'{RESERVE} out of range')):
        [result] = parameters.set(values)
        assert not result.successful
        assert words in result.reason
    for values in ({RESERVE: 0.3}, {'allocation.method': 'exact'}, {'allocation.method': OWN}):
        [result] = parameters.set(values)
        assert result.successful, result.reason
    assert not Path('loaded').exists()


@pytest.mark.skipif(find_spec('rclpy') is None, reason='needs rclpy')
def test_a_method_that_is_slow_to_build_is_not_built_in_flight(example, graph, monkeypatch):
    from rclpy.parameter import Parameter

    from nodes import host

    Path('slow.py').write_text(
        'import time\nfrom my_methods import Scaled\n\n\nclass Slow(Scaled):\n'
        '    def __init__(self, *given, **options):\n'
        '        super().__init__(*given, **options)\n        time.sleep(0.15)\n')
    monkeypatch.syspath_prepend(str(Path.cwd()))
    monkeypatch.delitem(sys.modules, 'slow', raising=False)
    node = host(
        graph, 'allocator', '-p', 'allocation.method:=slow:Slow',
        '-p', 'allocation.Slow.reserve:=0.2')
    health = Parameter('rotors.health', value=[0.8, 1.0, 1.0, 1.0, 1.0, 1.0])
    [result] = node.set_parameters([health])
    assert not result.successful
    assert re.fullmatch(
        r'allocation.method: slow:Slow took 0\.\d+ s to build at the start, longer than '
        r'command_timeout \(0.1 s\): it is not built in flight', result.reason)
    assert node.get_parameter('rotors.health').value == 1.0
    for change in (Parameter('command_timeout', value=5.0), health):
        [result] = node.set_parameters([change])
        assert result.successful, result.reason
    assert node.belief.built.method.settings.reserve == 0.2
    # Its own settings are in force at once, too.
    [result] = node.set_parameters([Parameter('allocation.Slow.reserve', value=0.3)])
    assert result.successful, result.reason
    assert node.belief.built.method.settings.reserve == 0.3
