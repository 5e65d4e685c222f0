"""The explorer without a browser: its binding of the kernel in C."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ca_ros import Exact, Vehicle
from ca_ros.allocation.slew import reached
from ca_ros.firmware.export import FILES, KERNEL
from ca_ros.problem.vehicle_problem import VehicleProblem

BINDING = Path(__file__).resolve().parents[1] / 'explorer' / 'flight.c'  # includes binding.c


@pytest.fixture(scope='module')
def library(tmp_path_factory):
    """Return the page's kernel, compiled for this machine."""
    if not (shutil.which('gcc') and BINDING.is_file()):
        pytest.skip('needs gcc and the sources of the explorer')
    target = tmp_path_factory.mktemp('explorer') / 'binding.so'
    parts = (KERNEL / name for name in FILES['exact']['sources'] if name != 'exact.c')
    subprocess.run(['gcc', '-std=c99', '-O1', '-shared', '-fPIC', f'-I{KERNEL}', BINDING,
                    *parts, '-lm', '-o', target], check=True)
    return ctypes.CDLL(target)


def numbers(library, name, size, kind='ca_real'):
    """Return the numbers of a variable of the binding, which can be written."""
    of = ctypes.c_int if kind == 'int' else ctypes.c_double
    place = ctypes.POINTER(of).in_dll(library, f'{kind}_{name}')
    return np.ctypeslib.as_array(place, (size,))


@pytest.mark.parametrize('name', ['hexarotor', 'hexarotor_realistic'])
@pytest.mark.parametrize('elapsed', [0.01, 0.05, 0.2])
def test_rotors_reach_from_hover_what_their_rates_allow(name, elapsed, library):
    vehicle = Vehicle.load(name)
    problem, curve, n = VehicleProblem(vehicle), vehicle.curve, vehicle.n
    m, rate = len(problem.axes), np.full(n, 2000.0)
    k_f = vehicle.thrust_per_squared_speed
    given = {
        'gamma': problem.gamma.ravel(), 'lower': problem.lower, 'upper': problem.upper,
        'forward': k_f, 'reverse': k_f, 'speed_min': vehicle.speed_min,
        'speed_max': vehicle.speed_max, 'acceleration': rate, 'deceleration': rate,
        'unit': [curve.coefficient], 'elapsed': [elapsed], 'hover': problem.hover,
        'weight': np.ones(n), 'preferred': np.zeros(n), 'slack': [1e-9], 'airmode': np.ones(2),
    }
    if not curve.square:
        given['segment'] = np.column_stack([curve.starts, curve.segments]).ravel()
    axes = ['force_x', 'force_y', 'thrust', 'roll', 'pitch', 'yaw']
    whole = {
        'n': [n], 'm': [m], 'axis': [axes.index(axis) for axis in problem.axes], 'policy': [1],
        'segments': [0 if curve.square else len(curve.starts)], 'order': range(m),
        'group': range(m), 'keep_sense': np.zeros(m), 'weighted': [0], 'thrust': [0],
    }
    for field, values in given.items():
        numbers(library, field, len(values))[:] = values
    for field, values in whole.items():
        numbers(library, field, len(values), 'int')[:] = list(values)
    assert library.prepare_vehicle() == 0
    hover = Exact(vehicle).allocate(problem.hover).speeds
    limits = reached(hover, elapsed, rate, rate, vehicle.speed_min, vehicle.speed_max)
    for bound, speeds in zip(('lower', 'upper'), limits, strict=True):
        np.testing.assert_allclose(
            numbers(library, bound, n), vehicle.thrusts(speeds), rtol=1e-9, atol=1e-12)
