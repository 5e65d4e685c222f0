"""examples/design_study.py: designs against numbers by hand and shipped vehicles."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ca_ros import AdmissibleSet, Vehicle, control_allocation_matrix
from strategies import HEXAROTOR

FILE = Path(__file__).resolve().parent.parent / 'examples' / 'design_study.py'
if not FILE.is_file():
    pytest.skip('examples/ is not beside the tests', allow_module_level=True)
spec = importlib.util.spec_from_file_location('design_study', FILE)
example = importlib.util.module_from_spec(spec)
spec.loader.exec_module(example)


@pytest.mark.parametrize(('name', 'design'), [
    ('hexarotor', (0.4, 0.0, 'PNPNPN')),
    ('hexarotor_ppnnpn', (0.4, 0.0, 'PPNNPN')),
    ('hexarotor_tilted', (0.4, 25.0, 'PNPNPN'))])
def test_designs_are_the_shipped_vehicles(name, design):
    shipped = Vehicle.load(name)
    made = replace(example.Design(*design).vehicle(HEXAROTOR), axes=shipped.axes)
    np.testing.assert_allclose(made.arms, shipped.arms, atol=1e-11)
    np.testing.assert_allclose(
        control_allocation_matrix(made), control_allocation_matrix(shipped), atol=1e-11)


def test_a_lost_rotor_takes_hover_from_pnpnpn_and_not_from_ppnnpn():
    """Without rotor 1: pitch f2 + f6 = f3 + f5 + 2 f4; roll f2 + f3 = f5 + f6.

    PNPNPN, yaw f3 + f5 = f2 + f4 + f6: with pitch, f4 = 0, below its bound of 0.04 N; without
    yaw it hovers.  PPNNPN, yaw f2 + f5 = f3 + f4 + f6: f4 = 0.04, f2 = 2.4725, f3 = f2 - 0.06,
    f5 = f2 - 0.04, f6 = f2 - 0.02 carry 9.81 N.
    """
    row = example.examine(example.Design(0.4, 0.0, 'PNPNPN'), HEXAROTOR)
    assert (row['hovers'], row['keeps_hovering'], row['yaw'][1]) == (0, 6, 0.0)
    assert row['hover margin'][0] > 0.0 > row['hover margin'][1]
    design = example.Design(0.4, 0.0, 'PPNNPN')
    assert example.examine(design, HEXAROTOR)['hovers'] == 4
    thrusts = np.array([0.0, 2.4725, 2.4125, 0.04, 2.4325, 2.4525])
    wrench = control_allocation_matrix(design.vehicle(HEXAROTOR)) @ thrusts
    np.testing.assert_allclose(wrench, [9.81, 0.0, 0.0, 0.0], atol=1e-12)


def test_margin_and_authority_are_those_of_the_admissible_set():
    design, hover = example.Design(0.55, 0.0, 'PPPNNN'), [9.81, 0.0, 0.0, 0.0]
    row, admissible = example.examine(design, HEXAROTOR), AdmissibleSet(design.vehicle(HEXAROTOR))
    assert row['hover margin'][0] == pytest.approx(float(admissible.margin(hover)), abs=1e-9)
    for i, (axis, (low, high)) in enumerate(admissible.authority(hover).items()):
        assert row[axis][0] == pytest.approx(min(hover[i] - low, high - hover[i]), abs=1e-8)


def test_one_spin_order_stands_for_those_that_do_the_same():
    assert example.spin_orders(4) == ['PNPN', 'PPNN']
    assert example.spin_orders(6) == ['PNPNPN', 'PPNPNN', 'PPPNNN']


def test_the_best_designs_are_printed_and_a_wrong_order_is_refused(capsys):
    example.main(['--designs', '4', '--best', '2', '--spin', 'PNPNPN', 'PPNNPN'])
    out = capsys.readouterr().out
    assert out.count('### ') == 3
    assert out.count('of 6 |') == 6
    with pytest.raises(SystemExit):
        example.main(['--spin', 'PNP'])
    assert 'expected 6 letters, P or N' in capsys.readouterr().err
