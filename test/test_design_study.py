"""The design study: designs against numbers by hand and shipped vehicles, ranks, workers."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from ca_ros import AdmissibleSet, Vehicle, control_allocation_matrix
from ca_ros.evaluation import chunks
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.design_study import main
from ca_ros.evaluation.designs import Design, DesignChunks, DesignSpace, spin_orders

PARAMETERS = Case.load('hexarotor').parameters


def rows_of(design):
    """Return the rows of one design, without a failure and without each rotor."""
    space = DesignSpace((design.arm,), (design.tilt,), (design.spin,), None)
    return DesignChunks(PARAMETERS, space, 1, 1)(0)


def vehicle_of(design):
    return Vehicle.from_parameters({**PARAMETERS, **design.parameters()})


@pytest.mark.parametrize(('name', 'design'), [
    ('hexarotor', Design(0.4, 0.0, 'PNPNPN')),
    ('hexarotor_ppnnpn', Design(0.4, 0.0, 'PPNNPN')),
    ('hexarotor_tilted', Design(0.4, 25.0, 'PNPNPN'))])
def test_designs_are_the_shipped_vehicles(name, design):
    shipped = Vehicle.load(name)
    made = replace(vehicle_of(design), axes=shipped.axes)
    np.testing.assert_allclose(made.arms, shipped.arms, atol=1e-11)
    np.testing.assert_allclose(
        control_allocation_matrix(made), control_allocation_matrix(shipped), atol=1e-11)


def test_a_lost_rotor_takes_hover_from_pnpnpn_and_not_from_ppnnpn():
    """Without rotor 1: pitch f2 + f6 = f3 + f5 + 2 f4; roll f2 + f3 = f5 + f6.

    PNPNPN, yaw f3 + f5 = f2 + f4 + f6: with pitch, f4 = 0, below its bound of 0.04 N; without
    yaw it hovers.  PPNNPN, yaw f2 + f5 = f3 + f4 + f6: f4 = 0.04, f2 = 2.4725, f3 = f2 - 0.06,
    f5 = f2 - 0.04, f6 = f2 - 0.02 carry 9.81 N.
    """
    whole, *failed = rows_of(Design(0.4, 0.0, 'PNPNPN'))
    assert (whole['hovers'], whole['lost']) == (1, '')
    for row in failed:
        assert (row['hovers'], row['keeps_hovering'], row['lost']) == (0, 1, 'yaw')
        assert row['hover_margin'] < 0.0
        assert (row['yaw_low'], row['yaw_high']) == (0.0, 0.0)
    design = Design(0.4, 0.0, 'PPNNPN')
    rows = rows_of(design)
    assert [row['hovers'] for row in rows] == [1, 1, 1, 1, 1, 0, 0]
    assert (rows[1]['lost'], rows[5]['lost']) == ('', 'yaw')
    thrusts = np.array([0.0, 2.4725, 2.4125, 0.04, 2.4325, 2.4525])
    wrench = control_allocation_matrix(vehicle_of(design)) @ thrusts
    np.testing.assert_allclose(wrench, [9.81, 0.0, 0.0, 0.0], atol=1e-12)


def test_margin_and_authority_are_those_of_the_admissible_set():
    for design in (Design(0.3, 12.0, 'PPNNPN'), Design(0.55, 0.0, 'PPPNNN')):
        row, hover = rows_of(design)[0], [9.81, 0.0, 0.0, 0.0]
        admissible = AdmissibleSet(vehicle_of(design))
        assert row['hover_margin'] == pytest.approx(float(admissible.margin(hover)), abs=1e-9)
        for i, (axis, ends) in enumerate(admissible.authority(hover).items()):
            found = row[f'{axis}_low'], row[f'{axis}_high']
            np.testing.assert_allclose(found, np.array(ends) - hover[i], atol=1e-8)


def test_one_spin_order_stands_for_those_that_do_the_same():
    assert spin_orders(3) == ['PPN']
    assert spin_orders(4) == ['PNPN', 'PPNN']
    assert spin_orders(6) == ['PNPNPN', 'PPNPNN', 'PPPNNN']
    with pytest.raises(ValueError, match='too many orders of 32 rotors'):
        spin_orders(32)
    # Turned, mirrored, all rotors reversed.
    margins = [
        sorted(row['hover_margin'] for row in rows_of(Design(0.35, 10.0, spin)))
        for spin in ('PPNPNN', 'PNPNNP', 'PPNNPN', 'NNPNPP')]
    np.testing.assert_allclose(margins, [margins[0]] * 4, atol=1e-12)


def test_random_designs_depend_on_seed_and_number_alone():
    space = DesignSpace((0.2, 0.6), (0.0, 30.0), ('PNPNPN', 'PPNNPN'), 7)
    designs = [space[k] for k in range(400)]
    assert space[399] == designs[399]
    assert DesignSpace((0.2, 0.6), (0.0, 30.0), ('PNPNPN', 'PPNNPN'), 8)[0] != designs[0]
    arms, tilts = np.array([design[:2] for design in designs]).T
    assert 0.2 < arms.min() < 0.21 < 0.59 < arms.max() < 0.6
    # The mean of 400: within four standard errors.
    assert arms.mean() == pytest.approx(0.4, abs=4 * 0.4 / np.sqrt(12 * 400))
    assert tilts.mean() == pytest.approx(15.0, abs=4 * 30.0 / np.sqrt(12 * 400))
    assert 160 < sum(design.spin == 'PNPNPN' for design in designs) < 240


GRID = ['--grid', '--arm', '0.3:0.5:3', '--tilt', '0:20:2', '--spin', 'PNPNPN,PPNNPN']


@pytest.fixture(scope='module')
def study(tmp_path_factory):
    out = tmp_path_factory.mktemp('designs')
    assert main([*GRID, '--best', '3', '--workers', '1', '--out', str(out)]) == 0
    return out


def test_a_grid_has_all_combinations_and_the_best_are_the_best_of_the_rows(study):
    rows = list(csv.DictReader((study / 'design.csv').open(newline='')))
    assert len(rows) == 3 * 2 * 2 * 7
    assert [row['failed'] for row in rows[:7]] == list('0123456')
    assert {row['arm'] for row in rows} == {'0.3', '0.4', '0.5'}
    found = json.loads((study / 'design.json').read_text())
    assert found['command'][:2] == ['design_study', '--vehicle']
    assert '--random' not in found['command']
    best = found['best']['Greatest hover margin']
    margins = [float(row['hover_margin']) for row in rows if row['failed'] == '0']
    assert [own['hover_margin'] for own in best] == sorted(margins, reverse=True)[:3]
    authority = {}
    for row in rows:
        for axis in ('roll', 'pitch'):
            weaker = min(-float(row[f'{axis}_low']), float(row[f'{axis}_high']))
            if row['failed'] != '0':
                k = int(row['design'])
                authority[k] = min(authority.get(k, np.inf), weaker)
    best = found['best']['Greatest roll and pitch authority after the worst failure']
    assert [own['tilting_after'] for own in best] == sorted(authority.values(), reverse=True)[:3]
    best = found['best']['Most failures with hover on all axes']
    assert {(own['spin'], own['hovers'], own['keeps_hovering']) for own in best} == {
        ('PPNNPN', 4, 6)}
    text = (study / 'design.md').read_text()
    assert '12 designs with the mass and the rotors of `hexarotor`: all combinations' in text
    assert text.count('| PPNNPN |') >= 3


def test_two_workers_give_the_same_bytes(study, tmp_path, monkeypatch):
    monkeypatch.setattr(chunks, 'SERIAL_TIME', 0.0)
    assert main([*GRID, '--best', '3', '--workers', '2', '--out', str(tmp_path)]) == 0
    for name in ('design.csv', 'design.md'):
        assert (tmp_path / name).read_bytes() == (study / name).read_bytes()
    assert list(tmp_path.glob('chunks*')) == []


def test_octorotors_hover_after_every_failure(tmp_path, capsys):
    command = ['--vehicle', 'octorotor', '--random', '1', '--spin', 'PNPNPNPN', '--tilt', '5']
    assert main([*command, '--out', str(tmp_path)]) == 0
    assert '8 / 8 of 8' in capsys.readouterr().out


@pytest.mark.parametrize(('arguments', 'code', 'words'), [
    (['--spin', 'PNP'], 1, 'a letter P or N for each of 6 rotors'),
    (['--tilt', '0:90'], 1, 'below 90 degrees'),
    (['--arm', '0:1'], 1, 'expected positive lengths'),
    (['--vehicle', 'admire'], 1, 'no rotors to fly with'),
    (['--arm', '0.2:0.4:5'], 1, '--arm 0.2:0.4:5: expected LOW:HIGH or one value'),
    (['--arm', 'a:b'], 1, '--arm a:b: expected LOW:HIGH or one value'),
    (['--tilt', '3:nan'], 1, '--tilt 3:nan: expected LOW:HIGH'),
    (['--arm', '3:2'], 1, 'expected LOW:HIGH'),
    (['--grid', '--arm', '2:3:0'], 1, 'expected LOW:HIGH, LOW:HIGH:COUNT or one value'),
    (['--grid', '--random', '5'], 2, 'not allowed with'),
])
def test_what_is_wrong_is_said_in_one_line(arguments, code, words, tmp_path, capsys):
    try:
        found = main([*arguments, '--out', str(tmp_path)])
    except SystemExit as end:
        found = end.code
    assert found == code
    assert words in capsys.readouterr().err.splitlines()[-1]
