"""The flights of examples/rotorpy, where rotorpy is installed (make test-all installs it)."""

import sys
from pathlib import Path

import numpy as np
import pytest

from ca_ros import control_allocation_matrix

pytest.importorskip('rotorpy')
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'examples' / 'rotorpy'))
import study


@pytest.mark.parametrize('name', ['crazyflie', 'hummingbird', *study.OURS])
def test_the_matrix_is_that_of_rotorpy(name):
    params, vehicle = study.parameters(name)
    plant = study.AnyMultirotor(params, {})
    np.testing.assert_array_equal(control_allocation_matrix(vehicle), plant.f_to_TM)


@pytest.mark.parametrize(('method', 'recovers'), [('exact', True), ("rotorpy's own", False)])
def test_a_hexarotor_flies_on_after_a_lost_rotor(method, recovers):
    flown = study.fly(study.Flight('hexarotor', 'rotor lost', method, study.FIRST_SEED))
    assert flown['recovered'] is recovers
    assert flown['recovered'] == (flown['error'] < study.STILL_ERROR_MAX)
