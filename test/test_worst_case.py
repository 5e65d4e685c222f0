"""The steps and pivots of the kernel, and the bounds of its loops: docs/scripts/worst_case.py."""

import sys
from pathlib import Path

import pytest

from ca_ros.firmware.command import checked
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.firmware import Firmware
from ca_ros.vehicle.files import read
from ca_ros.vehicle.vehicle import Vehicle
from strategies import length, need_kernel

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'docs' / 'scripts'))
import worst_case

need_kernel()
pytestmark = pytest.mark.slow

STEPS_MAX = 100
"""More than any wrench is known to take, and less than half of the bound in double precision."""


@pytest.mark.parametrize(
    'name', length(['hexarotor'], ['hexarotor', 'octorotor', 'hexarotor_tilted']))
@pytest.mark.parametrize('precision', ['double', 'single'])
def test_no_wrench_comes_near_the_bounds_or_is_inexact(name, precision):
    faults = faults_of(Vehicle.load(name), ['single'])
    firmware = Firmware.make(faults, checked(read(name)).allocation, precision)
    sample, searched, bounds = worst_case.measure(
        firmware, size=length(10_000, 100_000), generations=length(2, 10))
    for found in (sample, searched):
        assert 0 < found.steps <= min(STEPS_MAX, bounds.steps)
        assert 0 < found.pivots <= bounds.pivots / 10
        assert found.inexact == 0
