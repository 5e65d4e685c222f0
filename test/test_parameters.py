"""Vehicle files: a fault is reported in one line that names the file, the key and the fault."""

import math
from contextlib import suppress
from copy import deepcopy

import numpy as np
import pytest
import yaml

from ca_ros import ALLOCATORS, ParameterError, Vehicle, make_allocator
from ca_ros.control.controller import Controller
from ca_ros.control.controller_settings import ControllerSettings
from ca_ros.detection.naming import WEAK_LOSS
from ca_ros.parameter_files import (
    DECLARED,
    AllocatorSettings,
    FileSettings,
    MonitorSettings,
    Px4NodeSettings,
    load,
    load_for,
)
from ca_ros.setting_names import REMOVED, renamed
from ca_ros.settings import REQUIRED, MissingParameterError, check, flat, read, table
from ca_ros.simulation.rigid_body import RigidBody
from ca_ros.studies.cases import Case
from ca_ros.vehicle.files import NoSectionError, find
from ca_ros.vehicle.settings import MovingVehicleSettings
from strategies import file_values, settings_of

PARAMETERS = table(FileSettings)
VEHICLE = table(MovingVehicleSettings)
NAN, INFINITY, MISSING = float('nan'), float('inf'), object()

FAULTS = [
    # key, value, words of the message
    *((name, MISSING, 'missing') for name in (
        'vehicle.mass', 'vehicle.inertia', 'rotors.positions', 'rotors.spins',
        'rotors.thrust_coefficient', 'rotors.torque_coefficient', 'rotors.speed_min',
        'rotors.speed_max')),
    ('rotors.positions', [0.4, 0.0], 'got 2'),
    ('rotors.positions', [], 'got none'),
    ('rotors.positions', [0.0] * 3 * 1001, 'up to 1000 rotors, got 1001'),
    ('vehicle.name', 'two\nlines', 'a word'),
    ('rotors.spins', ['cw', 'ccw'], '6'),
    ('rotors.spins', ['cw', 'ccw', 'cw', 'ccw', 'cw', 'up'], 'one of cw, ccw'),
    ('rotors.thrust_coefficient', [2.5e-5] * 5, '6'),
    ('rotors.health', [1.0, 1.0], '6'),
    ('rotors.axes', [0.0, 0.0, 1.0] * 2, '18'),
    ('rotors.axes', [0.0, 0.0, 0.0], 'zero'),
    ('vehicle.center_of_mass', [0.0, 0.0], '3'),
    ('vehicle.inertia', [0.015, 0.015], '3 or 9'),
    ('vehicle.mass', [1.0, 2.0], 'one value'),
    ('vehicle.mass', -1.0, 'positive'),
    ('vehicle.mass', 0.0, 'positive'),
    ('rotors.thrust_coefficient', [2.5e-5] * 5 + [0.0], 'positive'),
    ('rotors.torque_coefficient', -5e-7, 'at least 0'),
    ('rotors.speed_min', 401.0, 'rotors.speed_max'),
    ('rotors.speed_min', [40.0] * 5 + [500.0], 'rotor 6'),
    ('rotors.health', 1.5, '[0, 1]'),
    ('vehicle.mass', NAN, 'nan'),
    ('rotors.speed_max', INFINITY, 'inf'),
    ('vehicle.mass', 'heavy', 'heavy'),
    ('vehicle.mass', True, 'True'),
    ('rotors.speed_max', {'front': 400.0}, 'rotors.speed_max'),
    ('rotors.positions', [[0.4, 0.0, float(i)] for i in range(6)], 'rotors.positions'),
    pytest.param('vehicle.mass', 10**400, 'vehicle.mass', id='a number beyond all floats'),
    ('vehicle.inertia', [0.015, 0.015, -0.03], 'positive'),
    ('vehicle.inertia', [0.01, 0.01, 0.03], 'sum'),
    ('vehicle.inertia', [0.02, 0.01, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.03], 'symmetric'),
    ('rotors.speed_mim', 40.0, 'did you mean rotors.speed_min'),
    ('allocation.method', 'exactly', 'exact, pseudo_inverse, conventional, direct'),
    ('allocation.axes', ['thrust', 'thrust'], 'different'),
    ('allocation.axes', [], 'axes'),
    ('allocation.axes', ['lift'], 'thrust'),
    ('controller.speed_max', 0.0, 'positive'),
    ('rotors.thrust_coefficient', 1e300, 'up to 1e+09, got 1e+300'),
    ('allocation.conventional.weight', 1.7e308, 'up to 1e+09, got 1.7e+308'),
]


def write(path, changes):
    """Write the hexarotor's file with some values changed or missing."""
    tree = {}
    for name, value in (file_values('hexarotor') | changes).items():
        if value is not MISSING:
            group = tree
            *parents, last = name.split('.')
            for parent in parents:
                group = group.setdefault(parent, {})
            group[last] = value
    path.write_text(yaml.dump(
        {'/**': {'ros__parameters': tree}}, Dumper=getattr(yaml, 'CSafeDumper', yaml.SafeDumper)))
    return path


def complaint(path):
    """Return the one line with which a vehicle's file is refused."""
    with pytest.raises(ParameterError) as caught:  # noqa: PT012
        load(path)
        Vehicle.load(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert path.name in message
    return message


@pytest.mark.parametrize(('key', 'value', 'words'), FAULTS)
def test_a_fault_is_named_with_its_key(tmp_path, key, value, words):
    message = complaint(write(tmp_path / 'wrong.yaml', {key: value}))
    assert key in message
    assert words in message


@pytest.mark.parametrize('change', [
    {'rotors.positions': [0.1, 0.0, 0.0] * 3 + [0.2, 0.0, 0.0] * 3},
    {'rotors.spins': ['cw'] * 6},
    {'rotors.torque_coefficient': 0.0},
    {'rotors.axes': [0.0, 1.0, 0.0]},
    {'allocation.axes': ['force_x', 'thrust', 'roll', 'pitch', 'yaw']},
])
def test_rotors_that_cannot_command_all_axes_are_refused(tmp_path, change):
    vehicle = Vehicle.load(write(tmp_path / 'wrong.yaml', change))
    with pytest.raises(ParameterError, match=r'is refused: .* lost .*rank [0-4] for [45] axes'):
        make_allocator('exact', vehicle)


@pytest.mark.parametrize(('text', 'words'), [
    ('a: [1, 2', 'not readable YAML'),
    ('\x00', 'not readable YAML'),
    ('', 'ros__parameters'),
    ('vehicle: {mass: 1.0}', 'ros__parameters'),
    ("'/**': {vehicle: {mass: 1.0}}", 'ros__parameters'),
    ("'/**': {ros__parameters: }", 'ros__parameters'),
    ("'/**': {ros__parameters: {vehicle: }}", 'vehicle'),
    ("'/**': {ros__parameters: {vehicle: {mass: 1, mass: 2}}}", "key 'mass' is there twice"),
    ("'/**': {ros__parameters: {'rotors.a\\nb': 1.0}}", 'no such parameter'),
])
def test_what_is_no_parameter_file_is_refused(tmp_path, text, words):
    path = tmp_path / 'wrong.yaml'
    path.write_text(text)
    assert words in complaint(path)


@pytest.mark.parametrize(('value', 'words'), [
    ('&a [*a]', 'aliases'),
    ('[' * 100_000, 'nested'),
    ('{a: ' * 3000 + '}' * 3000, 'nested'),
    ('!!timestamp foo', 'timestamp'),
    ('!!bool foo', "'foo' is not of the type bool"),
    ("!!int ''", "'' is not of the type int"),
    ('!!float foo', 'float'),
    ('9' * 5000, 'is not of the type int'),
    ('2001-13-41', "vehicle.mass: '2001-13-41' is no number"),
    ('!!binary eA==', 'binary'),
    ('!!python/name:os.system', 'python'),
    ('{[a]: 1}', 'unhashable key'),
    ('9' * 400, 'vehicle.mass'),
    ('"' + 'x' * 10_000 + '"', 'vehicle.mass'),
], ids=lambda text: text[:12])
def test_a_value_that_cannot_be_read_is_refused_wherever_it_stands(tmp_path, value, words):
    path = write(tmp_path / 'wrong.yaml', {'vehicle.mass': 'here'})
    path.write_text(path.read_text().replace('here', value))
    message = complaint(path)
    assert words in message
    assert len(message) < 400
    with pytest.raises(ParameterError, match=r'vehicle\.mass') as caught:
        Case.load('hexarotor', [f'vehicle.mass:={value}'])
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


HEXAROTOR = file_values('hexarotor')
OTHER = {'vehicle': {'mass': 2.0}, 'rotors.health': 0.5}


def sections(tmp_path, *names):
    """Write a file with a section for each name: the hexarotor first, then `OTHER`."""
    path = tmp_path / 'sections.yaml'
    content = {}
    for name in names:
        group = content
        for part in name.split(' '):
            group = group.setdefault(part, {})
        # Copies, which PyYAML does not write as aliases.
        group['ros__parameters'] = deepcopy(OTHER if len(content) > 1 else HEXAROTOR)
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


# As rclpy has it: see test_node_parameters.py.
SECTIONS = [
    ('/**', ['/allocator', '/a/allocator', '/a/b/allocator']),
    ('**', ['/allocator', '/a/allocator', '/a/b/allocator']),
    ('/*', ['/allocator']),
    ('allocator', ['/allocator']),
    ('/allocator', ['/allocator']),
    ('/a/allocator', ['/a/allocator']),
    ('a allocator', ['/a/allocator']),
    ('/a allocator', ['/a/allocator']),
    ('/*/allocator', ['/a/allocator']),
    ('/**/allocator', ['/allocator', '/a/allocator', '/a/b/allocator']),
    ('/a/**', ['/a/allocator', '/a/b/allocator']),
    ('/** allocator', ['/allocator', '/a/allocator', '/a/b/allocator']),
]


@pytest.mark.parametrize(('name', 'nodes'), SECTIONS)
def test_a_section_is_for_the_nodes_for_which_ros_takes_it(tmp_path, name, nodes):
    path = sections(tmp_path, name)
    for node in ('/allocator', '/a/allocator', '/a/b/allocator'):
        if node in nodes:
            assert file_values(path, node) == HEXAROTOR
        else:
            with pytest.raises(NoSectionError, match=f'sections.yaml: no section for {node}'):
                load(path, node)
    # Without the name of a node there is only one that can be meant.
    assert file_values(path) == HEXAROTOR


def test_later_sections_override(tmp_path):
    overridden = HEXAROTOR | {'vehicle.mass': 2.0, 'rotors.health': 0.5}
    assert file_values(sections(tmp_path, '/**', '/allocator')) == overridden
    assert file_values(sections(tmp_path, '/allocator', '/**')) == overridden
    assert file_values(sections(tmp_path, '/**', '/simulator'), '/simulator') == overridden


def test_a_vehicle_is_what_the_allocator_believes(tmp_path):
    assert file_values(sections(tmp_path, '/**', '/simulator', '/a/controller')) == HEXAROTOR
    assert file_values(sections(tmp_path, '/simulator')) == HEXAROTOR


def test_a_file_of_two_vehicles_is_refused_unless_a_node_is_named(tmp_path):
    path = sections(tmp_path, '/**', '/a/allocator')
    line = complaint(path)
    assert '/allocator, /a/allocator' in line
    assert Vehicle.load(path, '/a/allocator').mass == 2.0
    assert Vehicle.load(path, '/b/allocator').mass == 1.0


def test_what_is_no_text_is_refused(tmp_path):
    path = tmp_path / 'wrong.yaml'
    path.write_bytes('# Größe\n'.encode('latin-1'))
    assert 'not readable text' in complaint(path)
    complaint(tmp_path)


@pytest.mark.parametrize('text', ['1e-4', '1.0e-4', '0.0001'])
def test_a_number_without_a_point_is_a_number_as_in_ros(tmp_path, text):
    path = write(tmp_path / 'right.yaml', {'rotors.torque_coefficient': 'here'})
    path.write_text(path.read_text().replace('here', text))
    assert load(path).rotors.torque_coefficient == 1e-4


def test_parameters_left_out_have_their_defaults(tmp_path):
    path = write(tmp_path / 'short.yaml', {'vehicle.gravity': MISSING, 'rotors.health': MISSING})
    settings = load(path)
    assert settings.vehicle.gravity == 9.81
    assert settings.rotors.health == 1.0
    assert flat(settings).keys() == PARAMETERS.keys()


def test_every_parameter_is_described_with_its_default():
    for name, parameter in PARAMETERS.items():
        assert parameter.description, name
        if parameter.default is not REQUIRED:
            checked = check(name, parameter.default, parameter)
            assert (tuple(checked) if isinstance(checked, list) else checked) == parameter.default
            assert type(checked) in (*parameter.kinds, list), name


@pytest.mark.parametrize(
    'name', ['controler.speed_max', 'rotor.health', 'Vehicle.mass', 'speed_max',
             'allocation.axis'])
def test_a_name_that_looks_like_one_of_ours_is_not_passed_over(tmp_path, name):
    words = f'{name}: no such parameter .did you mean'
    with pytest.raises(ParameterError, match=words):
        load(write(tmp_path / 'wrong.yaml', {name: 1.0}))
    if name in ('rotor.health', 'Vehicle.mass', 'allocation.axis'):
        with pytest.raises(ParameterError, match=words):
            Vehicle.from_parameters({**HEXAROTOR, name: 1.0})


def test_a_file_may_have_what_the_nodes_declare():
    kinds = (*DECLARED.values(), MonitorSettings, Px4NodeSettings)
    assert set().union(*map(table, kinds)) == PARAMETERS.keys()


def test_a_node_declares_only_what_it_uses_of_a_vehicle():
    allocator, controller, simulator = (table(DECLARED[node]) for node in (
        'allocator', 'controller', 'simulator'))
    assert VEHICLE.keys() - allocator == {'vehicle.inertia'}
    assert VEHICLE.keys() - simulator == {'allocation.axes', 'allocation.lost_axes'}
    assert VEHICLE.keys() <= controller.keys()
    assert not [name for name in simulator if name.startswith('allocation')]


def test_only_control_and_simulation_need_the_inertia(tmp_path):
    path = write(tmp_path / 'onboard.yaml', {'vehicle.inertia': MISSING})
    vehicle, complete_vehicle = Vehicle.load(path), Vehicle.load('hexarotor')
    given = load_for(AllocatorSettings, path)
    assert flat(given) == {name: HEXAROTOR[name] for name in table(AllocatorSettings)}
    u = [9.81, 0.05, -0.02, 0.01]
    np.testing.assert_array_equal(*(
        make_allocator('exact', each).allocate(u).thrusts for each in (vehicle, complete_vehicle)))
    missing = '^vehicle.inertia: missing; the controller and the simulation need it$'
    with pytest.raises(MissingParameterError, match=missing):
        RigidBody(vehicle)
    with pytest.raises(MissingParameterError, match=missing):
        Controller(vehicle, ControllerSettings())
    for kind in (DECLARED['controller'], DECLARED['simulator'], FileSettings):
        with pytest.raises(ParameterError, match=r'onboard\.yaml: vehicle\.inertia: missing'):
            load_for(kind, path)


def test_what_is_read_is_flat_again_and_frozen():
    settings = load('hexarotor')
    assert read(FileSettings, flat(settings)) == settings
    assert flat(settings) == HEXAROTOR
    with pytest.raises(AttributeError):
        settings.command_timeout = 1.0
    assert isinstance(settings.rotors.positions, tuple)


@pytest.mark.parametrize(('given', 'words'), [
    ({'controller.attitude': 'level'}, 'controller.attitude: level needs force_x, force_y in'),
    ({'allocation.exact.weights': [1.0, 1e5]}, 'allocation.exact.weights: 100000 is more than'),
    ({'simulator.initial_attitude': [0.0] * 4}, 'simulator.initial_attitude: .*quaternion'),
    ({'simulator.seed': 0.5}, 'simulator.seed: must be a whole number, at least 0, got 0.5'),
    ({'simulator.publish_clock': 'yes'}, "simulator.publish_clock: must be true or false, got 'y"),
    ({'allocation.exact.airmode_limit': [0.5, 0.1, 0.2, 0.0]},
     'allocation.exact.airmode_limit: expected 1 or 2 numbers, got 4'),
    ({'simulator.publish_clock': 1.0}, 'simulator.publish_clock: must be true or false, got 1.0'),
])
def test_a_limit_between_settings_and_a_type_are_named(given, words):
    with pytest.raises(ParameterError, match=f'^{words}'):
        settings_of(given)


def test_settings_have_the_types_of_their_declaration():
    settings = settings_of({'simulator.seed': 7.0, 'simulator.mass_factor': 1})
    assert repr(settings.simulator.seed) == '7'
    assert repr(settings.simulator.mass_factor) == '1.0'
    assert settings.simulator.publish_clock is False


OLD = {
    'allocation.exact.thrust_deviation': 'allow', 'bridge.px4_input': 'state',
    'bridge.px4_thrust_factor': 0.3}


def test_old_names_are_read_with_one_warning(tmp_path):
    path = write(tmp_path / 'old.yaml', {'allocation.exact.axis_reversal': MISSING, **OLD})
    with pytest.warns(FutureWarning, match='old settings: .* is now ') as warned:
        settings = load(path)
    assert len(warned) == 1
    assert settings.allocation.exact.axis_reversal == 'allow'
    assert settings.px4.interface == 'offboard'
    assert settings.px4.thrust_factor == 0.3
    assert renamed(flat(settings)) == flat(settings)


@pytest.mark.parametrize('name', REMOVED)
def test_a_name_that_is_no_more_is_refused_with_what_to_do(tmp_path, name):
    name, _, value = name.partition(': ')
    assert bool(value) == (name in PARAMETERS)
    with pytest.raises(ParameterError, match=f'{name}: no such parameter or value any') as error:
        load(write(tmp_path / 'old.yaml', {name: value or 1.0}))
    assert '\n' not in str(error.value)


def test_the_least_loss_is_that_from_which_a_rotor_is_named():
    assert f' {100.0 * WEAK_LOSS:.0f} % ' in REMOVED['detector.least_loss']


@pytest.mark.parametrize('method', ALLOCATORS)
def test_a_class_takes_the_settings_of_its_method(method):
    if method == 'osqp':
        pytest.importorskip('osqp')
    kind = ALLOCATORS[method]
    fields, vehicle = table(kind.settings_type), Vehicle.load('hexarotor')
    for name in fields:
        assert f'    {name} : ' in kind.__doc__, name
    allocator = kind(vehicle)
    assert allocator.settings == kind.settings_type()
    assert kind(vehicle, allocator.settings).settings is allocator.settings
    with pytest.raises(TypeError, match='colour'):
        kind(vehicle, colour='red')
    with pytest.raises(TypeError, match=r'by keyword \(.*\), or one \w*Settings; got '):
        kind(vehicle, 'red')
    if fields:
        assert kind(vehicle, **vars(allocator.settings)).settings == allocator.settings


def test_a_method_checks_its_options_as_its_parameters():
    for wrong in ({'policy': 'hope'}, {'residual_slack': 0.5},
                  {'residual_slack': math.nan}):
        [(name, value)] = wrong.items()
        with pytest.raises(ParameterError, match=f'^{name}: must be .*, got {value!r}$'):
            make_allocator('exact', Vehicle.load('hexarotor'), **wrong)


def test_a_name_for_another_node_is_left_alone():
    Vehicle.from_parameters({**HEXAROTOR, 'use_sim_time': True, 'camera.exposure': 3})


def test_ros_takes_the_same_sections_of_a_file_as_we_do(graph, tmp_path):
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    for name, nodes in SECTIONS:
        path = sections(tmp_path, name)
        context = rclpy.Context()
        rclpy.init(
            args=['--ros-args', '--params-file', str(path)], context=context,
            domain_id=graph.domain, signal_handler_options=SignalHandlerOptions.NO)
        for node in ('/allocator', '/a/allocator', '/a/b/allocator'):
            made = rclpy.create_node(
                'allocator', namespace=node.removesuffix('/allocator'), context=context,
                automatically_declare_parameters_from_overrides=True)
            assert made.has_parameter('vehicle.mass') == (node in nodes), (name, node)
            made.destroy_node()
        rclpy.shutdown(context=context)


def test_a_list_in_a_list_is_refused_as_ros_refuses_it(tmp_path):
    file = tmp_path / 'own.yaml'
    text = find('hexarotor').read_text(encoding='utf-8')
    groups = 'exact: {order: [[roll, pitch], [thrust], [yaw]]}'
    file.write_text(text.replace('method: exact', groups), encoding='utf-8')
    with pytest.raises(ParameterError, match=r'order: expected one list .* got a list in a list'):
        Vehicle.load(file)
    file.write_text(text.replace('mass: 1.0', 'mass: [[0, 0, 0]]'), encoding='utf-8')
    with pytest.raises(ParameterError, match=r'mass: .*, such as \[0\.0, 0\.5, 1\.0\] or .* got'):
        Vehicle.load(file)
    file.write_text(text.replace('mass: 1.0', 'mass: 6.8kg'), encoding='utf-8')
    with pytest.raises(ParameterError, match=r"vehicle\.mass: '6\.8kg' is no number"):
        Vehicle.load(file)


TEXTS = [
    *(('vehicle.gravity', text) for text in (
        '9.81', '10', '"10"', "'9.81'", '6.8kg', '1:30', '1:30.5', '1e1', '1.0e1', '"1e1"', '0x10',
        '010', '08', "'nan'", '.inf', '2026-01-01', 'true')),
    *(('vehicle.center_of_mass', text) for text in (
        '[0.01, 0.01, 0.02]', '["0.01", "0.01", "0.02"]', '[0.01, "0.01", 0.02]', '[1, 1.0, 1.0]',
        '[1, 1, 1]', '[1e-2, 0.01, 1.0e-2]', '"[0.01, 0.01, 0.02]"', '[0.01, true, 0.01]')),
    *(('allocation.exact.order', text) for text in (
        '[roll pitch, thrust, yaw]', '[[roll, pitch], [thrust], [yaw]]',
        '[[roll, pitch], thrust, yaw]', '[roll pitch, [thrust], yaw]', '[{roll: pitch}, yaw]')),
]


@pytest.mark.parametrize(('name', 'text'), TEXTS)
def test_a_node_and_python_read_the_same_of_a_value_or_both_refuse_it(
        graph, tmp_path, name, text):
    import rclpy
    from rclpy.exceptions import ParameterException
    from rclpy.signals import SignalHandlerOptions

    from ca_ros.nodes.parameters import Parameters
    from ca_ros.nodes.rclpy_internals import RCLError

    path = write(tmp_path / 'given.yaml', {name: 'here'})
    path.write_text(path.read_text().replace('here', text))
    expected = found = None
    with suppress(ParameterError):
        expected = flat(load_for(AllocatorSettings, path))[name]
    context = rclpy.Context()
    with suppress(RCLError, ParameterError, ParameterException):
        rclpy.init(
            args=['--ros-args', '--params-file', str(path)], context=context,
            domain_id=graph.domain, signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node('allocator', context=context)
        try:
            found = flat(Parameters(node, AllocatorSettings).settings)[name]
        finally:
            node.destroy_node()
            rclpy.shutdown(context=context)
    assert found == expected
    assert expected is not None or name in complaint(path)
