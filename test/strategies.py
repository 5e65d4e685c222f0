"""What the tests share: lengths, vehicles, demands, and linear programs as oracles."""

import os
import shutil
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from ca_ros import ParameterError, Vehicle, control_allocation_matrix, make_allocator
from ca_ros.kernel import load
from ca_ros.parameter_files import FileSettings, load_for
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.settings import flat, read
from ca_ros.vehicle.settings import AXES

LONG = os.environ.get('CA_ROS_LONG', '')
SEED = int(os.environ.get('CA_ROS_SEED', '0'))  # of `make test-fresh`; 0: the fixed examples


def length(short, long, soak=None):
    """Return how long a test is to be in `make test`, in `make test-all` and in `make soak`."""
    if LONG == 'soak':
        return soak or long
    return long if LONG else short


settings.register_profile(
    'ca_ros', max_examples=length(12, 50), deadline=None, derandomize=not SEED, database=None,
    print_blob=False,
    suppress_health_check=[HealthCheck.too_slow],
    phases=[Phase.explicit, Phase.generate, Phase.shrink])
settings.load_profile('ca_ros')


def seeded(number):
    """Return the generator with a fixed number, or in `make test-fresh` one of its seed."""
    return np.random.default_rng([SEED, number] if SEED else number)


def solver(name):
    """Import a package that rosdep does not know, or skip the test that needs it."""
    return pytest.importorskip(name, reason=f'needs {name}, which rosdep does not know')


def need_kernel():
    """Skip the module that says so if the kernel is not built, and no compiler is there to do it.

    With a compiler the installation has failed, and so does the module.
    """
    missing = [name for name in ('double', 'double_4', 'single') if load(name) is None]
    compiler = (sysconfig.get_config_var('CC') or 'cc').split()[0]
    if missing and shutil.which(compiler):
        pytest.fail(f'{compiler} is there, but ca_ros.kernel has no {", ".join(missing)}: '
                    'python setup.py build_ext --inplace', pytrace=False)
    if missing:
        pytest.skip('needs a C compiler', allow_module_level=True)


def file_values(vehicle, node=None, kind=FileSettings):
    """Return the values of a vehicle's settings by full name."""
    return flat(load_for(kind, vehicle, node))


def settings_of(given):
    """Return the settings with values by full name, the others being those of the hexarotor."""
    return read(FileSettings, {**file_values('hexarotor'), **given})


# Vehicles by name

PARAMETERS = {
    'vehicle.mass': 1.0,
    'vehicle.inertia': [0.015, 0.015, 0.030],
    'rotors.thrust_coefficient': 2.5e-5,
    'rotors.torque_coefficient': 5.0e-7,
    'rotors.speed_min': 40.0,
    'rotors.speed_max': 400.0,
}


EVERY_EFFECT = {
    'simulator.sub_steps': 5.0,
    'simulator.seed': 7.0,
    'simulator.failures': ['1@0.1', '3@0.05=0.7'],
    'simulator.initial_position': [0.1, -0.1, 0.0],
    'simulator.initial_velocity': [0.1, 0.0, 0.0],
    'simulator.initial_angular_velocity': [0.0, 0.1, 0.0],
    'simulator.initial_attitude': [0.0, 0.0, 0.2, 1.0],
    'simulator.motor_time_constant': 0.03,
    'simulator.command_delay': 0.004,
    'simulator.state_delay': 0.012,
    'simulator.linear_drag': [0.2, 0.2, 0.1],
    'simulator.rotor_drag': 1e-5,
    'simulator.rotational_drag': 1e-4,
    'simulator.wind': [1.0, -0.5, 0.2],
    'simulator.gust_intensity': 0.5,
    'simulator.ground': 'flat',
    'simulator.mass_factor': 1.05,
    'simulator.thrust_factor': [0.95, 1.0, 1.02, 0.98, 1.0, 0.97],
    'simulator.torque_factor': 1.1,
    'simulator.position_noise': 2e-3,
    'simulator.velocity_noise': 5e-3,
    'simulator.attitude_noise': 1e-3,
    'simulator.angular_velocity_noise': 5e-3,
    'simulator.position_bias': [0.0, 0.0, 0.01],
    'simulator.velocity_bias': 1e-3,
    'simulator.attitude_bias': [1e-3, 0.0, 0.0],
    'simulator.angular_velocity_bias': 1e-3,
    'simulator.specific_force_bias': [0.1, 0.0, -0.1],
    'simulator.vibration': 2.0,
}
"""Parameters of the plant, none at its default; the vehicle flies all the same."""


def build(positions, spins, others=(), **rotors):
    """Make a vehicle of rotors at positions (n, 3); P in spins is a positive yaw, N a negative."""
    return Vehicle.from_parameters(PARAMETERS | {
        'rotors.positions': np.ravel(positions).tolist(),
        'rotors.spins': ['cw' if spin == 'P' else 'ccw' for spin in spins],
        **{f'rotors.{name}': value for name, value in rotors.items()}, **dict(others)})


def ring(n, radius=0.4, first=0.0, height=0.0):
    """Return positions (n, 3) on a circle, counter-clockwise from the angle of the first."""
    angles = first + 2.0 * np.pi * np.arange(n) / n
    return np.column_stack([
        radius * np.cos(angles), radius * np.sin(angles), np.full(n, height)])


def tilted_axes(n, tilt):
    """Return axes (n, 3) tilted about the arms of a ring, to one side and the other in turn."""
    angles = 2.0 * np.pi * np.arange(n) / n
    sines = np.sin(tilt) * (-1.0) ** np.arange(n)
    return np.column_stack([
        -sines * np.sin(angles), sines * np.cos(angles), np.full(n, np.cos(tilt))])


# ROMFS/px4fmu_common of PX4-Autopilot: init.d/airframes/4001_quad_x (as in PX4's guide, "Adding a
# Frame Configuration") and init.d/airframes/1105_rc_hexa_x_sih.hil.
QUAD_X = """\
param set-default CA_ROTOR_COUNT 4
param set-default CA_ROTOR0_PX 0.15
param set-default CA_ROTOR0_PY 0.15
param set-default CA_ROTOR1_PX -0.15
param set-default CA_ROTOR1_PY -0.15
param set-default CA_ROTOR2_PX 0.15
param set-default CA_ROTOR2_PY -0.15
param set-default CA_ROTOR2_KM -0.05
param set-default CA_ROTOR3_PX -0.15
param set-default CA_ROTOR3_PY 0.15
param set-default CA_ROTOR3_KM -0.05
"""

HEXAROTOR = Vehicle.load('hexarotor')

FLEET = {
    'quadrotor': build(ring(4, first=np.pi / 4), 'PNPN'),
    'hexarotor': HEXAROTOR,
    'hexarotor_ppnnpn': build(ring(6), 'PPNNPN'),
    'octorotor': build(ring(8), 'PNPNPNPN'),
    'x8': build(np.vstack([ring(4, height=0.05), ring(4, height=-0.05)]), 'PNPNNPNP'),
    'x8_identical_columns': build(np.vstack([ring(4), ring(4)]), 'PNPNPNPN'),
    'y6': build(np.vstack([ring(3), ring(3)]), 'PPPNNN'),
    'asymmetric': build(
        [[0.5, 0.3, 0.0], [-0.2, 0.4, 0.1], [-0.4, -0.1, 0.0], [0.1, -0.6, 0.0], [0.3, 0.0, 0.1]],
        'PNPNP', {'vehicle.center_of_mass': [0.02, -0.03, 0.01]},
        thrust_coefficient=[2e-5, 3e-5, 2.5e-5, 4e-5, 1e-5], health=[1.0, 0.7, 1.0, 1.0, 0.9],
        speed_min=[0, 40, 30, 0, 50], speed_max=[400, 300, 500, 350, 600]),
    'tilted_hexarotor': build(
        ring(6), 'PNPNPN', {'allocation.axes': list(AXES)},
        axes=np.ravel(tilted_axes(6, np.radians(30.0))).tolist()),
}

SOME = length(['quadrotor', 'asymmetric', 'x8_identical_columns', 'tilted_hexarotor'], [*FLEET])
"""Names of a square problem, one with rotors unlike each other, with equal ones, with six axes."""


UNIT = PARAMETERS | {
    'vehicle.mass': 2.0 / 9.81,
    'rotors.positions': [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0],
    'rotors.spins': ['cw', 'ccw', 'cw', 'ccw'],
    'rotors.thrust_coefficient': 1.0, 'rotors.torque_coefficient': 1.0,
    'rotors.speed_min': 0.0, 'rotors.speed_max': 1.0}

UNIT_QUADROTOR = Vehicle.from_parameters(UNIT)
"""All effectivenesses 1: thrust is the sum of four thrusts from 0 to 1 N; it hovers at half."""

PX4_ROWS = np.loadtxt(
    Path(__file__).with_name('px4_desaturation.csv'), delimiter=',', skiprows=1)
"""The rows of PX4's test of its sequential desaturation.

Source: ControlAllocationSequentialDesaturationTest.cpp of PX4-Autopilot, PreviousMixingTests:
roll, pitch, yaw, mean thrust; then four thrusts without airmode, with that of roll and pitch, and
with that of roll, pitch and yaw.
"""


def unaudited(method, vehicle, **options):
    """Make an allocator for any vehicle, also one that `make_allocator` would refuse."""
    return make_allocator(method, VehicleProblem(vehicle), **options)


# Vehicles by chance

def random_vehicle(rng, n):
    """Return a vehicle with n rotors anywhere and unlike each other."""
    axes = rng.normal([0.0, 0.0, 1.0], rng.choice([0.0, 0.3]), (n, 3))
    low = rng.choice([0.0, 1.0]) * rng.uniform(0.0, 200.0, n)
    six = n >= 6 and np.any(axes[:, :2]) and rng.random() < 0.5
    return build(
        rng.uniform([-0.6, -0.6, -0.1], [0.6, 0.6, 0.1], (n, 3)), rng.choice(['P', 'N'], n),
        {'allocation.axes': list(AXES if six else AXES[2:])},
        axes=axes.ravel().tolist(),
        thrust_coefficient=(2.5e-5 * rng.uniform(0.3, 3.0, n)).tolist(),
        torque_coefficient=(5e-7 * rng.uniform(0.3, 3.0, n)).tolist(),
        speed_min=low.tolist(),
        speed_max=(low + rng.uniform(100.0, 500.0, n)).tolist())


def full_rank(vehicle):
    """Tell whether the rotors that can move command all axes, none by a mere trace."""
    columns = control_allocation_matrix(vehicle) * (vehicle.thrust_max - vehicle.thrust_min)
    extent = np.abs(columns).sum(axis=1, keepdims=True)
    return bool(np.all(extent > 0.0)) and np.linalg.svd(columns / extent)[1][-1] > 1e-4


generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@st.composite
def vehicles(draw, rank=True):
    """Draw a vehicle on a grid, where rotors meet, line up, are lost or cannot move."""
    n, rng = draw(st.integers(4, 12)), draw(generators)
    leaning = rng.choice([0.0, 0.0, 1.0]) * rng.choice([0.0, 0.25, -0.5], (n, 2))
    steps = draw(st.sampled_from([1, 4, 10]))
    plane = rng.integers(-steps, steps, (n, 2), endpoint=True) / 20.0
    try:
        vehicle = build(
            np.column_stack([plane, np.zeros(n)]),
            rng.choice(['P', 'N'], n),
            axes=np.column_stack([leaning, np.ones(n)]).ravel().tolist(),
            thrust_coefficient=rng.choice([2.5e-5, 1e-5, 6e-5], n).tolist(),
            torque_coefficient=rng.choice([5e-7, 2e-7, 1.2e-6], n).tolist(),
            speed_min=rng.choice([40.0, 0.0, 300.0], n).tolist(),
            speed_max=rng.choice([400.0, 300.0, 950.0], n).tolist(),
            health=rng.choice([1.0, 1.0, 1.0, 1.0, 0.3, 0.0], n).tolist())
    except ParameterError:
        assume(False)
    assume(full_rank(vehicle) or not rank)
    return vehicle


@st.composite
def demands(draw, vehicle):
    """Draw a wrench in the admissible set, often on its boundary, or anywhere beyond it."""
    rng, n = draw(generators), vehicle.n
    share = np.where(rng.random(n) < draw(st.sampled_from([0.0, 0.5, 0.9, 1.0])),
                     rng.choice([0.0, 0.5, 1.0], n), rng.random(n))
    low, high = vehicle.thrust_min, vehicle.thrust_max
    u = control_allocation_matrix(vehicle) @ (low + share * (high - low))
    push = rng.choice([0.0, 1.0]) * rng.choice([0.0, 1.0], len(u)) * rng.normal(0.0, 5.0, len(u))
    return draw(st.sampled_from([1.0, 1.0, 1.5, 10.0, 1e6])) * (u + push)


def around(problem, rng, size):
    """Draw u (size, m) inside the set, on its boundary and up to three times as far outside."""
    inside = rng.uniform(problem.lower, problem.upper, (size, problem.n)) @ problem.gamma.T
    ways = inside - problem.center
    ways *= np.array([problem.reach(problem.center, way) for way in ways])[:, None]
    return (inside, problem.center + ways,
            problem.center + rng.uniform(1.01, 3.0, (size, 1)) * ways)


# Oracles

def extreme(cost, matrix, right, low, high, method='highs'):
    """Return the x of least cost with matrix x = right and low <= x <= high, or None."""
    answer = linprog(cost, A_eq=matrix, b_eq=right, bounds=np.column_stack([low, high]),
                     method=method, options={'primal_feasibility_tolerance': 1e-10,
                                             'dual_feasibility_tolerance': 1e-10})
    return answer.x if answer.status == 0 else None


def by_quadprog(gamma, u, low, high, squares=None, linear=None):
    """Return the f of least f squares f / 2 - linear f with gamma f = u and low <= f <= high.

    Without `squares` the norm is least.  Raises ValueError where quadprog finds none.
    """
    n = len(low)
    rows = np.vstack([gamma, np.eye(n), -np.eye(n)])
    return solver('quadprog').solve_qp(
        np.eye(n) if squares is None else squares, np.zeros(n) if linear is None else linear,
        rows.T, np.concatenate([u, low, -high]), len(u))[0]


def by_daqp(gamma, u, low, high, squares=None, linear=None, **options):
    """Return the same, or raise the same, of DAQP."""
    n = len(low)
    thrusts, _, flag, _ = solver('daqp').solve(
        np.eye(n) if squares is None else squares, np.zeros(n) if linear is None else -linear,
        np.array(gamma, order='C'), np.concatenate([high, u]), np.concatenate([low, u]),
        np.array([0] * n + [5] * len(u), np.int32), **options)
    if flag < 1:
        raise ValueError(f'daqp ended with {flag}')
    return thrusts


def reach(vehicle, start, direction, limit=np.inf, method='highs'):
    """Return the greatest t <= limit for which the rotors give start + t direction, or None."""
    gamma = control_allocation_matrix(vehicle)
    answer = extreme(
        np.append(np.zeros(vehicle.n), -1.0), np.column_stack([gamma, -np.asarray(direction)]),
        start, np.append(vehicle.thrust_min, 0.0), np.append(vehicle.thrust_max, limit), method)
    return None if answer is None else answer[-1]


def middle(vehicle):
    """Return the wrench of the thrusts half-way between their bounds."""
    return control_allocation_matrix(vehicle) @ (vehicle.thrust_min + vehicle.thrust_max) / 2.0


def sixteen_rotors():
    """Return the parameters of a vehicle with 16 rotors, tilted so as to command six axes."""
    positions = ring(16, radius=0.5)
    x, y, _ = positions.T / 0.5
    tilts = np.where(np.arange(16) % 4 < 2, 0.4, -0.4)
    axes = np.column_stack([-np.sin(tilts) * y, np.sin(tilts) * x, np.cos(tilts)])
    return PARAMETERS | {
        'vehicle.mass': 4.0, 'vehicle.inertia': [0.1, 0.1, 0.2],
        'rotors.positions': positions.ravel().tolist(), 'rotors.axes': axes.ravel().tolist(),
        'rotors.spins': ['cw', 'ccw'] * 8, 'allocation.axes': list(AXES)}


# Integration

def rk4(derivative, state, step):
    """Return the state after a step of the classical Runge-Kutta method, of order 4."""
    k1 = derivative(state)
    k2 = derivative(state + 0.5 * step * k1)
    k3 = derivative(state + 0.5 * step * k2)
    k4 = derivative(state + step * k3)
    return state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
