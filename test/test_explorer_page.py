"""The explorer without a browser: its binding of the kernel in C, and files that it refuses."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

import ca_ros
from ca_ros import Vehicle, explore
from ca_ros.__main__ import main
from ca_ros.allocation.slew import reached
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.files import find

KERNEL = Path(ca_ros.__file__).parent / 'kernel'
BINDING = Path(__file__).resolve().parents[1] / 'explorer' / 'flight.c'  # includes binding.c


@pytest.fixture(scope='module')
def library(tmp_path_factory):
    """Return the page's kernel, compiled for this machine."""
    if not (shutil.which('gcc') and BINDING.is_file()):
        pytest.skip('needs gcc and the sources of the explorer')
    target = tmp_path_factory.mktemp('explorer') / 'binding.so'
    parts = (KERNEL / f'{name}.c' for name in ('least_norm', 'priorities', 'facet', 'explanation'))
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
    hover = ca_ros.Exact(vehicle).allocate(problem.hover).speeds
    limits = reached(hover, elapsed, rate, rate, vehicle.speed_min, vehicle.speed_max)
    for bound, speeds in zip(('lower', 'upper'), limits, strict=True):
        np.testing.assert_allclose(
            numbers(library, bound, n), vehicle.thrusts(speeds), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(('table', 'curve'), [
    ('throttles', {'throttles': [0.05, 0.5, 0.9], 'speeds': [0.0, 200.0, 400.0]}),
    ('thrusts', {'speeds': [50.0, 100.0, 400.0], 'thrusts': [0.06, 0.3, 3.9]}),
])
def test_a_file_with_tables_of_thrust_is_refused_in_one_line(
        table, curve, tmp_path, capsys, monkeypatch):
    page = tmp_path / 'built.html'
    page.write_text(explore.NO_VEHICLE, encoding='utf-8')
    monkeypatch.setattr(explore, 'PAGE', page)
    content = yaml.safe_load(find('hexarotor').read_text(encoding='utf-8'))
    content['/**']['ros__parameters']['rotors']['thrust_curve'] = curve
    file, out = tmp_path / 'measured.yaml', tmp_path / 'out.html'
    file.write_text(yaml.safe_dump(content), encoding='utf-8')
    assert main(['explore', str(file), '--out', str(out)]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert 'rotors.thrust_curve.' in line
    assert 'does not read tables' in line
    assert not out.exists()
    assert main(['explore', 'hexarotor', '--out', str(out)]) == 0
