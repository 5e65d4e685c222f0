"""The vehicles of examples/px4 are those of PX4's simulator SIH."""

from pathlib import Path

import numpy as np
import pytest

from ca_ros import Vehicle
from ca_ros.studies.replay import settings_of
from ca_ros.vehicle.effectiveness import rotor_wrenches

FOLDER = Path(__file__).resolve().parent.parent / 'examples' / 'px4'
if not FOLDER.exists():
    pytest.skip('examples/ is not beside the tests', allow_module_level=True)

THRUST, TORQUE, ARM, ROOT = 5.0, 0.1, 0.2, np.sqrt(3.0) / 2.0  # SIH_T_MAX, _Q_MAX, _L_ROLL
# Sih::generate_force_and_torques: roll, pitch and yaw, forward-right-down, of each motor's output.
TORQUES = {
    'quadx': ([-1, 1, 1, -1], [1, -1, 1, -1], [1, 1, -1, -1]),
    'hex': (
        [-0.5, -1, -0.5, 0.5, 1, 0.5], [ROOT, 0, -ROOT, -ROOT, 0, ROOT], [1, -1, 1, -1, 1, -1]
    ),
}


@pytest.mark.parametrize('model', TORQUES)
def test_full_throttle_gives_the_wrench_of_sih(model):
    vehicle = Vehicle.load(str(FOLDER / f'sih_{model}.yaml'))
    roll, pitch, yaw = (np.array(row, dtype=float) for row in TORQUES[model])
    full = vehicle.thrusts(vehicle.speed_max)
    np.testing.assert_allclose(full, THRUST, rtol=1e-12)
    expected = [full, ARM * THRUST * roll, -ARM * THRUST * pitch, -TORQUE * yaw]
    np.testing.assert_allclose(rotor_wrenches(vehicle)[2:] * full, expected, atol=1e-5)


@pytest.mark.parametrize('model', TORQUES)
def test_the_monitor_takes_the_settings_of_its_detector(model):
    assert settings_of(str(FOLDER / f'sih_{model}.yaml')).delay == 0.01
