"""The instructions of the kernel on an emulated microcontroller: docs/scripts/firmware.py."""

import sys
from pathlib import Path

import numpy as np
import pytest

from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.vehicle import Vehicle

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'docs' / 'scripts'))
firmware = pytest.importorskip('firmware', reason='needs packages that rosdep does not know')
instruction_bound = pytest.importorskip('instruction_bound')

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


@pytest.mark.parametrize('name', ['hexarotor', 'octorotor'])
def test_calls_within_rates_are_hardly_longer(name):
    """A zero that rounding errors hide would have to be found in double precision."""
    without, within = firmware.count_rates(name, 'single')
    assert np.median(within) < 1.6 * np.median(without)
    assert within.max() < 2.0 * without.max()


def test_no_call_takes_more_than_the_bound():
    # Of the tilted hexarotor 1 in 50 of the wrenches outside is served in double precision.
    vehicle = Vehicle.load('hexarotor_tilted')
    once, twice = instruction_bound.bounds_of('hexarotor_tilted')
    counts = firmware.count(VehicleProblem(vehicle), ('kernel',), 500)
    taken = np.concatenate([found[:, 0] for found in counts.values()])
    typical = np.percentile(taken, 90)
    assert typical < taken.max() / 3
    assert typical < once < twice < 1e9
    assert taken.max() < twice


def test_the_bound_of_nested_loops_is_that_by_hand(tmp_path):
    source = """
    int ca_allocate(const int *x);
    int ca_allocate(const int *x)
    {
        int sum = 0;
        for (int k = 0; k < m; k++)
            for (int i = 0; i < n; i++)
                sum += x[i] * k;
        return sum;
    }
    void run(void) {}
    """
    (tmp_path / 'least_norm.c').write_text(
        'extern int n, m;\n' + source + 'int n = 6, m = 4;', encoding='utf-8')
    flags = [*firmware.FLAGS, '-g', '-O1', tmp_path / 'least_norm.c']
    program = firmware.compiled(tmp_path / 'program.elf', *flags)
    sizes = instruction_bound.Sizes(n=6, m=4, rows=4, columns=7, variables=12)
    code = instruction_bound.Code(program, 'ca_allocate')
    bound = instruction_bound.Program(code, sizes).greatest({})
    blocks = code.functions[code.root].values()
    whole = sum(len(block.addresses) for block in blocks)
    inner = min(
        len(block.addresses) for head, block in code.functions[code.root].items()
        if head in block.after)
    # The inner loop runs 24 times, in each repetition of it at least these instructions.
    assert 24 * inner < bound < 7 * 5 * whole
