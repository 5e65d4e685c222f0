"""The instructions of the kernel on an emulated microcontroller: docs/scripts/firmware.py."""

import sys
from pathlib import Path

import numpy as np
import pytest

from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.vehicle import Vehicle

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'docs' / 'scripts'))
firmware = pytest.importorskip('firmware', reason='needs packages that rosdep does not know')

pytestmark = [
    pytest.mark.long,
    pytest.mark.slow,
    pytest.mark.skipif(bool(firmware.missing()),
                       reason=f'needs {", ".join(firmware.missing())}'),
]

PRODUCT_WORST, OSQP_MEDIAN = 100.0, 0.1
"""What a call may take: clipped pseudo-inverses, and a share of OSQP's calls."""


@pytest.mark.parametrize('words', firmware.FLAGS_OF_USERS)
@pytest.mark.parametrize('name', firmware.VEHICLES)
def test_firmware_keeps_its_promise_with_the_flags_of_autopilots(name, words):
    _, exact, others, changed = firmware.compare_flags(name, words.split(), 30)
    assert exact < 1e-4
    assert others < 1e-3
    assert changed == 0


@pytest.mark.parametrize('name', firmware.VEHICLES)
def test_the_kernel_takes_few_instructions(name):
    counts = firmware.count(VehicleProblem(Vehicle.load(name)), tuple(firmware.METHODS), 100)
    for kind in firmware.KINDS:
        product, kernel, osqp = (counts[method, kind][:, 0] for method in firmware.METHODS)
        # A product of 6 x 4 takes about 250, whatever the wrench.
        assert 200 < product.min() == product.max() < 400
        assert kernel.max() <= PRODUCT_WORST * product[0]
        assert np.median(kernel) <= OSQP_MEDIAN * np.median(osqp)
