"""The command that plots admissible sets."""

import numpy as np
import pytest
from matplotlib import image

from ca_ros import AdmissibleSet, Vehicle
from ca_ros.studies.sets.attainable import draw, main
from strategies import length


def grey(path):
    """Return the brightness of a picture, (height, width)."""
    return image.imread(path)[..., :3].mean(axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize('arguments', [
    ['--axes', 'thrust,yaw', '--projection', '--figure-width', 'column', '--fail', '3=0.6'],
    ['--vehicle', 'rov', '--axes', 'force_x,force_y,thrust', '--at', 'yaw=5,roll=-3'],
    *length([], [['--axes', 'roll,pitch,yaw', '--fail', '3'], ['--vehicle', 'admire']]),
])
def test_it_draws_what_it_states(arguments, tmp_path, capsys):
    assert main([*arguments, '--out', str(tmp_path / 'set'), '--figures', 'png,pdf']) == 0
    out = capsys.readouterr().out
    assert f'written: {tmp_path}/set.png, {tmp_path}/set.pdf' in out
    # The areas are filled: without a set, lines and letters are 2 % of the picture.
    shade = grey(tmp_path / 'set.png')
    assert np.mean((shade > 0.4) & (shade < 0.92)) > 0.05


def test_the_numbers_are_those_of_the_section(tmp_path, capsys):
    assert main(['--fail', '3', '--at', 'thrust=12', '--out', str(tmp_path / 'set')]) == 0
    hexarotor = Vehicle.load('hexarotor')
    lines = capsys.readouterr().out.splitlines()
    for line, health in zip(lines, (np.ones(6), [1, 1, 0, 1, 1, 1]), strict=False):
        cut = AdmissibleSet(hexarotor.with_health(health)).section(
            ['roll', 'pitch'], [12.0, 0.0, 0.0, 0.0])
        low, high = cut.vertices.min(axis=0), cut.vertices.max(axis=0)
        assert line.endswith(
            f'roll {low[0]:+.3g} to {high[0]:+.3g} N m, pitch {low[1]:+.3g} to {high[1]:+.3g} N m')
    assert lines[1].startswith('without rotor 3: ')


def test_the_axes_of_a_problem_have_its_units(tmp_path, capsys):
    assert main(['--vehicle', 'admire', '--out', str(tmp_path / 'set')]) == 0
    out = capsys.readouterr().out
    assert 'admire: roll -4.94 to +4.94 rad/s², pitch' in out
    assert 'N m' not in out


def test_a_body_has_the_faces_of_its_hull():
    image_of = AdmissibleSet(Vehicle.load('hexarotor'))
    body = image_of.section(['roll', 'pitch', 'yaw'])
    normals, _ = body.facets
    faces = body.corners()
    assert len(faces) == len(normals)
    # Each edge belongs to two faces.
    edges = [frozenset(edge) for face in faces for edge in zip(face, [*face[1:], face[0]],
                                                               strict=True)]
    assert all(edges.count(edge) == 2 for edge in edges)
    assert len(body.vertices) - len(set(edges)) + len(faces) == 2
    assert len(draw({'hexarotor': body}, np.zeros(3), body.axes).axes) == 1


@pytest.mark.parametrize(('arguments', 'fault'), [
    (['--axes', 'roll'], 'expected two or three axes'),
    (['--axes', 'roll,up'], 'axes: expected different ones of'),
    (['--at', 'up=3'], "--at: no axis 'up'"),
    (['--at', 'thrust'], 'expected AXIS=NUMBER'),
    (['--at', 'roll=1'], '--at: roll is drawn'),
    (['--at', 'thrust=5', '--projection'], '--at: in a projection'),
    (['--at', 'thrust=500'], '--at: nothing is attainable there for any roll and pitch'),
    (['--fail', '9'], 'no rotor 9: the vehicle has rotors 1 to 6'),
    (['--fail', '3=2'], 'expected a health in [0, 1]'),
    (['--vehicle', 'admire', '--fail', '1'], 'effectors of a problem have no health'),
    (['--vehicle', 'nowhere'], 'neither a file nor a shipped vehicle'),
    (['--vehicle', 'quadrotor', '--fail', '1'], 'the admissible set has no volume'),
])
def test_a_wrong_argument_is_named_in_one_line(
        arguments, fault, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(arguments)
    except SystemExit as stop:
        code = stop.code
    assert code in (1, 2)
    assert fault in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
