"""The steps and pivots of the kernel, and the bounds of its loops."""

from shutil import which

import numpy as np
import pytest

from ca_ros.firmware.command import checked, main
from ca_ros.firmware.export import write
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.firmware import Firmware
from ca_ros.firmware.footprint import EMULATED, instructions
from ca_ros.firmware.worst_case import Bounds, found, measure
from ca_ros.vehicle.files import read
from ca_ros.vehicle.vehicle import Vehicle
from strategies import length, need_kernel

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
    sample, searched, bounds = measure(
        firmware, size=length(10_000, 100_000), generations=length(2, 10))
    for each in (sample, searched):
        assert 0 < each.steps <= min(STEPS_MAX, bounds.steps)
        assert 0 < each.pivots <= bounds.pivots / 10
        assert each.inexact == 0


@pytest.mark.parametrize('faults', ['none', 'single'])
def test_the_worst_wrenches_take_what_is_said_of_them(faults):
    cases = faults_of(Vehicle.load('hexarotor'), [faults])
    firmware = Firmware.make(cases, checked(read('hexarotor')).allocation, 'single')
    worst = found(firmware, size=5000, generations=1)
    assert worst.count >= 5000
    for k, name in enumerate(('steps', 'pivots')):
        fault, wrench, *said = worst.calls[name]
        work = np.empty((1, 2), np.int32)
        firmware.kernels[fault].allocate_batch(
            wrench[None], np.empty((1, 6), np.float32), np.empty(1, np.int8),
            np.empty(1, np.float32), work)
        assert work[0].tolist() == said
        assert work[0, k] == getattr(worst, name) > 0


@pytest.mark.long
def test_the_export_states_the_bound_and_the_instructions_of_the_worst_calls(tmp_path):
    firmware = Firmware.make(
        faults_of(Vehicle.load('hexarotor'), ['none']), checked(read('hexarotor')).allocation,
        'single')
    worst, bound = found(firmware, size=5000, generations=1), Bounds.greatest(firmware)
    write(firmware, 'hexarotor', tmp_path / 'out', worst=worst)
    text = (tmp_path / 'out' / 'README.md').read_text(encoding='utf-8')
    assert f'| any: the bound of the loops | {bound.steps} | {bound.pivots} |' in text
    if missing := [tool for tool in EMULATED if not which(tool)]:
        assert f'{", ".join(missing)} not installed' in text
        pytest.skip(f'needs {", ".join(missing)}')
    counts = instructions(tmp_path / 'out')
    assert len(counts) == 2
    for count, call in zip(counts, worst.calls.values(), strict=True):
        # A pseudo-inverse of 6 x 4 takes about 250.
        assert 500 * (call.steps + call.pivots) < count < 1e5
        assert f'| {call.steps} | {call.pivots} | {count} |' in text
    most = worst.at_bounds(bound, counts)
    assert max(counts) < most < 1e7
    assert f'would take {most:,} instructions'.replace(',', ' ') in text


def test_rotors_that_tilt_have_no_worst_case(tmp_path, capsys):
    given = ['--vehicle', 'tricopter', '--out', str(tmp_path / 'out'), '--worst-case']
    assert main(given) == 1
    assert '--worst-case: rotors that tilt' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
