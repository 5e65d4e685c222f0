"""The exported firmware reproduces its golden vectors, here and on emulated boards."""

import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import yaml

from ca_ros import AdmissibleSet, ParameterError, Status, Vehicle, make_allocator
from ca_ros.allocation.exact_settings import POLICIES
from ca_ros.detection.motor_model import settling_of
from ca_ros.firmware import firmware as module
from ca_ros.firmware import footprint, golden
from ca_ros.firmware.command import checked, main
from ca_ros.firmware.detector import STATES, detector_of
from ca_ros.firmware.export import UNATTAINABLE, identifier
from ca_ros.firmware.faults import arms_of, faults_of
from ca_ros.firmware.firmware import Firmware
from ca_ros.firmware.literals import literal
from ca_ros.firmware.throttles import throttles
from ca_ros.firmware.tilting import firmware_of as firmware_of_any
from ca_ros.kernel import INVALID
from ca_ros.problem.audit import audit
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.files import find, read
from strategies import LONG, length, need_kernel

VEHICLES = ('hexarotor', 'octorotor', 'hexarotor_tilted')
PRECISIONS = ('single', 'double')
ARM = ('make', 'arm-none-eabi-gcc', 'qemu-system-arm')

need_kernel()


@pytest.fixture(autouse=True)
def no_footprint(monkeypatch):
    """Leave out the footprint, which takes seconds; a test of it undoes this."""
    if not LONG:
        monkeypatch.setattr(footprint, 'which', lambda tool: None)


@pytest.fixture(scope='module')
def exported(tmp_path_factory):
    """Return a function that exports a vehicle, each once, and returns its folder."""
    @cache
    def export(name, precision='single'):
        out = tmp_path_factory.mktemp('firmware') / f'{name}_{precision}'
        assert main(['--vehicle', name, '--out', str(out), '--precision', precision]) == 0
        return out
    return export


@cache
def firmware_of(name, precision='double'):
    """Return the firmware of a vehicle, with the loss of each rotor as its faults."""
    parameters = checked(read(name)).allocation
    return Firmware.make(faults_of(Vehicle.load(name), ['single']), parameters, precision)


@pytest.fixture
def variant(tmp_path):
    """Return a function that writes the hexarotor's file with other parameters."""
    def write(**changes):
        content = yaml.safe_load(find('hexarotor').read_text(encoding='utf-8'))
        parameters = content['/**']['ros__parameters']
        for name, value in changes.items():
            *groups, key = name.split('__')
            section = parameters
            for group in groups:
                section = section.setdefault(group, {})
            section[key] = value
        file = tmp_path / 'variant.yaml'
        file.write_text(yaml.safe_dump(content), encoding='utf-8')
        return str(file)
    return write


def needs(*tools):
    missing = [tool for tool in tools if not shutil.which(tool)]
    if missing:
        pytest.skip(f'needs {", ".join(missing)}')


def make(folder, *arguments, flags='-O1 -Werror'):
    """Run make without a warning, and return what it prints."""
    done = subprocess.run(
        ['make', '-s', '-C', str(folder), f'CFLAGS={flags}', *arguments],
        capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, ''), done.stderr
    return done.stdout


def reproduced(text):
    """Return how many golden vectors there are, if all are reproduced in each check."""
    found = re.findall(r'(\d+) of (\d+) golden vectors are reproduced to the last bit', text)
    assert found
    assert all(right == count for right, count in found)
    return [int(count) for _, count in found]


# Firmware

@pytest.mark.slow
@pytest.mark.parametrize(('compiler', 'precision'), length(
    [('gcc', 'double')], [('gcc', 'single'), ('gcc', 'double'), ('clang', 'single')]))
@pytest.mark.parametrize('name', length(['hexarotor'], VEHICLES))
def test_golden_vectors_are_reproduced_here(name, compiler, precision, exported):
    needs('make', compiler)
    [count] = reproduced(make(exported(name, precision), f'CC={compiler}', f'BUILD={compiler}'))
    faults = Vehicle.load(name).n + 1
    assert count >= 3 * golden.SIZE * faults


@pytest.mark.long
@pytest.mark.parametrize('precision', PRECISIONS)
@pytest.mark.parametrize('name', [*VEHICLES, 'rov'])
def test_golden_vectors_are_reproduced_on_emulated_boards(name, precision, exported):
    needs(*ARM)
    assert len(reproduced(make(exported(name, precision), 'qemu'))) == 2


@pytest.mark.long
@pytest.mark.parametrize(('name', 'precision', 'arguments'), [
    ('octorotor', 'single', ['qemu']), ('octorotor', 'double', ['qemu-m7']),
    ('hexarotor_realistic', 'single', []), ('hexarotor_realistic', 'single', ['qemu-m4']),
])
def test_the_detector_finds_the_same_failure_in_the_golden_flight(
        name, precision, arguments, tmp_path):
    needs(*(ARM if arguments else ('make', 'gcc')))
    out = tmp_path / name
    given = ['--vehicle', name, '--faults', 'none', '--out', str(out)]
    assert main([*given, '--precision', precision, '--detector']) == 0
    counts = reproduced(make(out, *arguments))
    settled = settling_of(detector_of(Vehicle.load(name), read(name)).settings) // 10_000_000
    assert counts[1::2] == [settled + STATES] * (len(counts) // 2)
    # The last state's health and certainty.
    last = (out / 'golden_flight.h').read_text(encoding='utf-8').split('{')[-2:]
    assert last[0].startswith('0x0p+0')
    assert last[0].count('0x1p+0') == Vehicle.load(name).n - 1
    assert float.fromhex(last[1].split('f')[0].split(',')[0]) >= 0.99


BARE = {
    'gcc': ['gcc'], 'g++': ['g++', '-xc++', '-std=c++17'], 'clang': ['clang'],
    'arm-none-eabi-gcc': ['arm-none-eabi-gcc', '-c'],
}
STRICT = [
    '-Werror', '-Wall', '-Wextra', '-Wpedantic', '-Wshadow', '-Wfloat-equal', '-Wconversion',
    '-Wdouble-promotion', '-Wundef', '-Wcast-align', '-Wmissing-declarations', '-Wpointer-arith',
    '-Winit-self',
]


@pytest.mark.slow
@pytest.mark.parametrize('warnings', length([STRICT], [[], STRICT]))
@pytest.mark.parametrize('compiler', length(['g++'], BARE))
@pytest.mark.parametrize(('name', 'options'), length(
    [('hexarotor_realistic', ['--faults', 'none', '--detector'])],
    [('hexarotor_realistic', ['--detector']), ('hexarotor_realistic', ['--precision', 'double']),
     ('hexarotor', []), ('x8', []), ('tricopter', []),
     ('azimuth_boat', ['--precision', 'double'])],
))
def test_an_export_needs_no_flags_and_gives_no_warning(
        name, options, compiler, warnings, tmp_path):
    """As users build it: all files of a folder, in C or C++, to the last bit."""
    needs(BARE[compiler][0])
    out, program = tmp_path / name, tmp_path / 'check'
    assert main(['--vehicle', name, '--out', str(out), *options]) == 0
    for check in ('check.c', 'check_detector.c')[: 1 + ('--detector' in options)]:
        mains = {'check.c', 'check_detector.c', 'startup.c', 'worst_case.c'} - {check}
        sources = [file for file in out.glob('*.c') if file.name not in mains]
        command = [*BARE[compiler], *warnings]
        if '-c' not in command:
            command += ['-o', program]
        done = subprocess.run([*command, *sources, *['-lm'] * ('-c' not in command)],
                              capture_output=True, text=True, cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, ''), done.stderr
        if '-c' not in command:
            reproduced(subprocess.check_output([program], text=True))


@pytest.mark.long
def test_a_difference_in_one_bit_is_found(exported, tmp_path):
    needs('make', 'gcc')
    folder = tmp_path / 'changed'
    shutil.copytree(exported('hexarotor'), folder, ignore=shutil.ignore_patterns('gcc', 'clang'))
    golden_h = folder / 'golden.h'
    text = golden_h.read_text(encoding='utf-8')
    last = text.rindex('0x1.')
    exponent = text.index('p', last)
    # The last bit of single precision is the third one of the sixth digit.
    digit = int(text[exponent - 1], 16) ^ 2
    golden_h.write_text(
        f'{text[:exponent - 1]}{digit:x}{text[exponent:]}', encoding='utf-8')
    done = subprocess.run(
        ['make', '-s', '-C', str(folder), 'CFLAGS=-O1', 'check'], capture_output=True, text=True)
    assert done.returncode != 0
    assert 'hexarotor: 449 of 450 golden vectors' in done.stdout
    assert 'the first difference is in golden vector 449' in done.stdout


@pytest.mark.long
def test_the_header_is_for_cpp(exported, tmp_path):
    needs('make', 'gcc', 'g++')
    folder = exported('hexarotor')
    make(folder, 'CC=gcc', 'BUILD=gcc')
    library = folder / 'gcc' / 'libhexarotor.a'
    source = tmp_path / 'caller.cpp'
    source.write_text("""
        #include "hexarotor.h"
        int main()
        {
            const float wrench[HEXAROTOR_AXES] = {9.81f, 0.0f, 0.0f, 0.0f};
            float speeds[HEXAROTOR_ROTORS];
            return hexarotor_allocate(HEXAROTOR_ROTOR_1_LOST, wrench, speeds);
        }
        """, encoding='utf-8')
    program = tmp_path / 'caller'
    flags = ['-std=c++14', '-Wall', '-Wextra', '-Wpedantic', '-Werror', f'-I{folder}']
    subprocess.run(['g++', *flags, source, library, '-o', program], check=True)
    # Hover after the loss of rotor 1 leaves a yaw torque.
    assert subprocess.run([program]).returncode == Status.PRIORITIZED


EXAMPLE = re.compile(r'^ \*     \S.*\n(?:^ \*(?:     .*)?\n)*', re.MULTILINE)
DOCS = Path(__file__).parent.parent / 'docs'


def examples(folder, name):
    """Return the examples in C of the headers of an export, and those of its README."""
    headers = ''.join(file.read_text(encoding='utf-8') for file in folder.glob(f'{name}*.h'))
    found = [re.sub('(?m)^ \\*', '', block) for block in EXAMPLE.findall(headers)]
    readme = (folder / 'README.md').read_text(encoding='utf-8')
    return found, re.findall(r'^```c\n(.*?)^```$', readme, re.MULTILINE | re.DOTALL)


def run_example(folder, declared, body):
    """Compile a program with the library of an export, and return its exit code."""
    make(folder)
    source, program = folder / 'build' / 'example.c', folder / 'build' / 'example'
    source.write_text(f'{declared}\nint main(void)\n{{\n{body}\n}}\n', encoding='utf-8')
    [library] = (folder / 'build').glob('*.a')
    options = ['-std=c99', '-Wall', '-Wextra', '-Wpedantic', '-Werror', f'-I{folder}']
    subprocess.run(['gcc', *options, source, library, '-lm', '-o', program], check=True)
    return subprocess.run([program]).returncode


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'options'), [
    ('hexarotor', []), ('azimuth_boat', ['--precision', 'double'])])
def test_the_examples_of_readme_and_page_run(name, options, tmp_path):
    needs('make', 'gcc')
    assert main(['--vehicle', name, '--out', str(tmp_path), *options]) == 0
    headers, readme = examples(tmp_path, name)
    assert not headers
    assert len(readme) == 1
    if name == 'hexarotor':
        page = (DOCS / 'firmware.md').read_text(encoding='utf-8')
        readme += re.findall(r'^```c\n(.*?)^```$', page, re.MULTILINE | re.DOTALL)
        assert len(readme) == 2
    for text in readme:
        body = f'{text}return status;'
        assert run_example(tmp_path, f'#include "{name}.h"', body) == Status.EXACT


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'precision', 'hidden', 'fault'), [
    ('hexarotor', 'single', '', 'ROTOR_1_LOST'), ('x8', 'single', 'state[9] = 0;', 'ARM_1_2'),
    ('quadrotor', 'single', '', 'NO_FAULT'),
    *length([], [('x8', 'single', '', 'ROTOR_1_LOST'),
                 ('y6', 'double', 'state[9] = 0;', 'ARM_1_2')]),
])
def test_the_example_of_the_header_flies_on_with_what_the_detector_names(
        name, precision, hidden, fault, tmp_path):
    """In the golden flight rotor 1 is lost; where yaw does not show that, its arm is named.

    Of faults with which the vehicle cannot hover level none is chosen.
    """
    needs('make', 'gcc')
    given = ['--vehicle', name, '--out', str(tmp_path), '--precision', precision]
    assert main([*given, '--detector']) == 0
    [example], _ = examples(tmp_path, name)
    declared = f'#include <string.h>\n#include "golden_flight.h"\n{example}'
    vehicle = Vehicle.load(name)
    health = firmware_of(name, precision).health
    level = [name != 'quadrotor' or not fault for fault in range(len(health))]
    healths = f'{{{", ".join(literal(each, precision) for each in health)}}}'
    assert run_example(tmp_path, declared, f"""
        const ca_real wrench[CA_M] = {{{vehicle.weight}f}}, all[][CA_N] = {healths};
        const int level[] = {{{", ".join(str(int(each)) for each in level)}}};
        ca_real speeds[CA_N], wanted[CA_N];
        for (int fault = 0; fault < {len(health)}; fault++)
            if ({name}_fault_of(all[fault]) != (level[fault] ? fault : -1))
                return 2;
        {name}_allocate({name.upper()}_{fault}, wrench, wanted);
        start();
        for (int i = 0; i < (int)(sizeof flight / sizeof *flight); i++) {{
            ca_real state[13];
            memcpy(state, flight[i].state, sizeof state);
            {hidden}
            step((int64_t)i * 10000000, state, state + 4, state + 10, wrench, speeds);
            if (detector.health[0] < 1)
                break;
        }}
        return !memcmp(speeds, wanted, sizeof speeds) ? 7 : 8;
        """) == 7


@pytest.mark.parametrize('name', ['x8', 'y6'])
def test_each_arm_is_a_fault_that_is_served_as_by_the_allocator(name):
    """With either of its rotors dead the wrench is that demanded, but for yaw."""
    firmware, vehicle = firmware_of(name), Vehicle.load(name)
    sound = make_allocator('exact', vehicle)
    arms = [(i, i + 1) for i in range(1, vehicle.n, 2)]
    constants = [fault.constant for fault in firmware.faults]
    assert constants[vehicle.n + 1:] == [f'ARM_{i}_{j}' for i, j in arms]
    for fault, arm in enumerate(arms, vehicle.n + 1):
        pair, health = [i - 1 for i in arm], np.ones(vehicle.n)
        health[pair] = 0.5
        allocator = sound.with_health(health, [arm])
        for u in golden.wrenches(firmware, fault, golden.SIZE):
            status, speeds = firmware.allocate(fault, u)
            answer = allocator.allocate(u)
            assert status == answer.status
            np.testing.assert_allclose(speeds**2, answer.speeds**2, rtol=1e-9, atol=1e-6)
            for dead in pair if status == Status.EXACT else ():
                thrusts = vehicle.thrusts(speeds)
                thrusts[dead] = 0.0
                np.testing.assert_allclose((sound.problem.gamma @ thrusts - u)[:3], 0.0, atol=1e-9)


def test_what_is_no_exported_fault_is_said_and_taken_for_none():
    """Two lost rotors are no loss of one, and what is not a number is not sound.

    A fault with which the vehicle cannot hover level is not acted on.
    """
    single, sound = firmware_of('x8', 'single'), np.ones(8)
    vehicle, parameters = Vehicle.load('x8'), checked(read('x8')).allocation
    both = Firmware.make(faults_of(vehicle, ['single', 'pairs']), parameters, 'single')
    names = [fault.constant for fault in both.faults]
    for i, j in combinations(range(8), 2):
        health = sound.copy()
        health[[i, j]] = 0.0
        assert single.fault_of(health) == -1
        whole_arm = i // 2 == j // 2
        named = 'OTHER_FAULT' if whole_arm else f'ROTORS_{i + 1}_{j + 1}_LOST'
        assert [*names, 'OTHER_FAULT'][both.fault_of(health)] == named
    for weak, constant in (0.2, 'ROTOR_3_LOST'), (0.8, 'NO_FAULT'):
        assert names[single.fault_of(np.r_[1.0, 1.0, weak, sound[3:]])] == constant
    for number in np.nan, np.inf, -np.inf:
        assert single.fault_of(np.r_[sound[1:], number]) == -1


def test_rotors_side_by_side_are_no_arm():
    for name in ('rov', 'azimuth_boat', 'octorotor'):
        assert not arms_of(Vehicle.load(name))


# Golden vectors

@pytest.mark.parametrize('name', length(['rov'], [*VEHICLES, 'quadrotor', 'rov']))
def test_golden_vectors_are_the_answers_of_the_allocator(name):
    """The wrenches are inside, on and outside, and the answers those of `exact` after a fault."""
    firmware = firmware_of(name)
    single = firmware_of(name, 'single')
    vehicle = Vehicle.load(name)
    for i in (0, 1, vehicle.n):
        health = np.ones(vehicle.n)
        health[i - 1 if i else []] = 0.0
        problem = audit(vehicle.with_health(health)).independent
        assert firmware.faults[i].problem.axes == problem.axes
        allocator = make_allocator('exact', problem)
        rows = firmware.rows[i]
        demands = golden.wrenches(firmware, i, golden.SIZE)
        margins = AdmissibleSet(problem).margin(demands[:, rows])
        inside, on, outside = np.split(margins, 3)
        assert inside.min() > -1e-9
        assert np.abs(on).max() < 1e-9
        assert outside.max() < 1e-9
        for u, margin in zip(demands, margins, strict=True):
            assert firmware.margin(i, u) == pytest.approx(margin, abs=1e-9)
            answer = allocator.allocate(u[rows])
            status, speeds = firmware.allocate(i, u)
            assert status == answer.status
            # Thrusts, as at rest their rounding errors are great in the speeds.
            squares = [array * np.abs(array) for array in (speeds, answer.speeds)]
            np.testing.assert_allclose(*squares, rtol=1e-9, atol=1e-6)
            speeds = single.allocate(i, u.astype(np.float32))[1]
            *_, least, greatest = single.rotors[i]
            assert np.all((least <= speeds) & (speeds <= greatest))


@pytest.mark.parametrize('options', [
    {'policy': 'scale'}, {'policy': 'reject'}, {'order': ['yaw', 'roll pitch', 'thrust']},
], ids=str)
@pytest.mark.parametrize('name', ['hexarotor', 'quadrotor'])
def test_a_fault_leaves_lost_axes_out_as_the_allocator_does(name, options):
    given = read(name) | {f'allocation.exact.{key}': value for key, value in options.items()}
    vehicle, settings = Vehicle.load(name), checked(given).allocation
    firmware = Firmware.make(faults_of(vehicle, ['single']), settings, 'double')
    whole = make_allocator('exact', vehicle, **options)
    for fault in range(1, vehicle.n + 1):
        health = np.ones(vehicle.n)
        health[fault - 1] = 0.0
        allocator = whole.with_health(health)
        for u in golden.wrenches(firmware, fault, golden.SIZE):
            status, speeds = firmware.allocate(fault, u)
            answer = allocator.allocate(u)
            if answer.status != status:
                # A lost axis is missed, which the status of the firmware does not concern.
                assert status == Status.EXACT
                assert not np.allclose(answer.wrench, u)
            np.testing.assert_allclose(speeds**2, answer.speeds**2, rtol=1e-9, atol=1e-6)


def test_what_is_no_wrench_or_no_fault_gets_idle_speeds():
    firmware = firmware_of('quadrotor', 'single')
    special = golden.special(firmware)
    wrong = ~(np.abs(special) <= 1e12).all(axis=1)
    assert wrong.sum() == 4 * 5
    for fault in range(5):
        for u in special[wrong]:
            status, speeds = firmware.allocate(fault, u)
            assert status == INVALID
            idle = np.full(4, Vehicle.load('quadrotor').speed_min[0], np.float32)
            idle[fault - 1 if fault else []] = 0.0
            np.testing.assert_array_equal(speeds, idle)
    hover = firmware.problem.hover.astype(np.float32)
    for fault in (-1, 5):
        assert firmware.allocate(fault, hover)[0] == INVALID


def test_an_axis_that_a_fault_takes_away_is_ignored():
    firmware = firmware_of('quadrotor')
    assert firmware.rows == [[0, 1, 2, 3], *[[0, 1, 2]] * 4]
    speeds = [firmware.allocate(1, np.array([6.0, 0.1, 0.0, yaw]))[1] for yaw in (0.0, 0.7)]
    np.testing.assert_array_equal(*speeds)


@pytest.mark.parametrize('value', [0.1, -1.0, 3e-40, 1e30, 0.0, -0.0, 400.0])
def test_literals_keep_every_bit(value):
    number = float(np.float32(value))
    text = literal(number, 'single')
    assert text.endswith('f')
    assert np.float32(float.fromhex(text[:-1])).tobytes() == np.float32(value).tobytes()
    assert float.fromhex(literal(value, 'double')) == value
    assert literal(-np.inf, 'single') == '-INFINITY'


# Options of the vehicle's file

OPTIONS = [
    {},
    *({'policy': policy} for policy in POLICIES),
    {'axis_reversal': 'allow'},
    {'order': ['yaw', 'roll pitch', 'thrust']},
    {'residual_slack': 1e-4},
]


@pytest.mark.parametrize('options', OPTIONS, ids=str)
def test_the_options_of_the_file_are_those_of_the_firmware(options, variant):
    file = variant(**{f'allocation__exact__{name}': value for name, value in options.items()})
    vehicle = Vehicle.load(file)
    settings = checked(read(file)).allocation
    firmware = Firmware.make(faults_of(vehicle, ['none']), settings, 'double')
    allocator = make_allocator('exact', VehicleProblem(vehicle), **options)
    assert firmware.kernels[0].fields()['slack'][2] == [options.get('residual_slack', 1e-9)]
    for u in golden.wrenches(firmware, 0, golden.SIZE)[golden.SIZE:]:
        answer = allocator.allocate(u)
        status, speeds = firmware.allocate(0, u)
        assert status == answer.status
        np.testing.assert_allclose(speeds, answer.speeds, rtol=1e-9)


def test_the_readme_of_an_export_describes_every_policy():
    assert UNATTAINABLE.keys() == POLICIES.keys()


@pytest.mark.slow
def test_faults_are_none_or_have_any_health_and_the_size_can_be_measured_later(
        tmp_path, capsys, monkeypatch):
    assert len(faults_of(Vehicle.load('hexarotor'), ['none'])) == 1
    monkeypatch.setattr(footprint, 'which', lambda tool: None)
    faults = ['--faults', 'single', '1,2=0.5']
    assert main(['--vehicle', 'quadrotor', '--out', str(tmp_path), *faults]) == 0
    header = (tmp_path / 'quadrotor.h').read_text(encoding='utf-8')
    assert '#define QUADROTOR_FAULTS 6\n' in header
    assert 'QUADROTOR_ROTOR_2_LOST = 2, /* rotor 2 is lost; not commanded: yaw */' in header
    assert 'QUADROTOR_FAULT_5 = 5, /* without rotor 1, rotor 2 at 50 %' in header
    assert 'quadrotor with 5 faults' in capsys.readouterr().out
    text = (tmp_path / 'README.md').read_text(encoding='utf-8')
    assert 'arm-none-eabi-gcc, arm-none-eabi-size not installed.\n`make size` prints them' in text


@pytest.mark.long
def test_a_vehicle_of_one_axis_is_exported(variant, tmp_path):
    needs('make', 'gcc')
    file = variant(allocation__axes=['thrust'])
    out = tmp_path / 'out'
    assert main(['--vehicle', file, '--out', str(out)]) == 0
    # GCC takes an array of ca_margin that has one entry for one without.
    reproduced(make(out, flags='-O1 -Werror -Wno-maybe-uninitialized'))


@pytest.mark.slow
@pytest.mark.parametrize(('setting', 'value'), [
    ('acceleration_max', 2000.0), ('tilt_rate_max', 3.0)])
def test_firmware_of_rotors_that_tilt_refuses_limits_of_rates(setting, value, tmp_path, capsys):
    content, file = with_policy('hexarotor_tilting', 'prioritize'), tmp_path / 'vehicle.yaml'
    content['/**']['ros__parameters']['rotors'][setting] = value
    file.write_text(yaml.safe_dump(content), encoding='utf-8')
    assert main(['--vehicle', str(file), '--out', str(tmp_path / 'out')]) == 1
    error = capsys.readouterr().err
    assert f'rotors.{setting}: ' in error
    assert error.count('\n') == 1
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(('curve', 'precision'), [
    (True, 'single'), *length([], [(True, 'double'), (False, 'single'), (False, 'double')]),
])
def test_rates_are_exported_with_a_sequence_of_answers(curve, precision, variant, tmp_path):
    needs('make', 'gcc')
    rates = {'rotors__acceleration_max': 3000.0, 'rotors__deceleration_max': 1500.0}
    file, out = 'hexarotor_realistic' if curve else variant(**rates), tmp_path / 'out'
    assert main(['--vehicle', file, '--out', str(out), '--precision', precision]) == 0
    text = (out / 'golden.h').read_text(encoding='utf-8')
    assert 'ALLOCATE_WITHIN' in text
    assert ('THROTTLES' in text) == curve
    text = (out / 'README.md').read_text(encoding='utf-8')
    assert '_allocate_within`. No memory' in text
    # The copy of the problem.
    ram = re.search(r'(\d+) bytes \| \d+ bytes \|$', text, re.MULTILINE)
    assert 'not installed' in text or int(ram[1]) > 1000
    reproduced(make(out))


MEASURED = {'speeds': [0.0, 150.0, 300.0, 400.0], 'throttles': [0.05, 0.2, 0.6, 0.9]}


@pytest.mark.slow
@pytest.mark.parametrize(('precision', 'curve', 'rotors'), length(
    [('single', {'expo': 0.3}, {'speed_min': -300.0})],
    [('single', {'expo': 0.3}, {'speed_min': -300.0}), ('single', MEASURED, {}),
     ('double', {**MEASURED, 'pwm': [1100.0, 1900.0]},
      {'speed_max_per_volt': 28.0, 'battery_voltage': 14.0})],
))
def test_throttles_and_pulses_are_exported(precision, curve, rotors, variant, tmp_path):
    needs('make', 'gcc')
    changes = {f'rotors__{name}': value for name, value in rotors.items()}
    file, out = variant(rotors__thrust_curve=curve, **changes), tmp_path / 'out'
    given = ['--out', str(out), '--precision', precision, '--faults', 'none']
    assert main(['--vehicle', file, *given]) == 0
    reproduced(make(out))


@pytest.mark.parametrize('curve', [{'expo': 0.3}, {'polynomial': [2.2e-5, 1.4e-3, 0.0]}, MEASURED])
@pytest.mark.parametrize('volts', [{}, {'speed_max_per_volt': 28.0, 'battery_voltage': 14.0}])
def test_throttles_of_firmware_are_those_of_the_vehicle(curve, volts, variant):
    rotors = {'thrust_curve': curve, 'speed_min': 40.0} | volts
    changes = {f'rotors__{name}': value for name, value in rotors.items()}
    parameters = read(variant(**changes))
    vehicle = Vehicle.from_parameters(parameters)
    firmware = Firmware.make(
        faults_of(vehicle, ['none']), checked(parameters).allocation, 'double')
    for speeds in np.random.default_rng(0).uniform(0.0, vehicle.speed_max, (20, vehicle.n)):
        found, pulses = throttles(firmware, speeds)
        np.testing.assert_allclose(found, vehicle.throttles(speeds), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(pulses, vehicle.pulses(speeds), rtol=1e-12)


def with_policy(name, policy):
    """Return the content of a vehicle's file with a policy."""
    content = yaml.safe_load(find(name).read_text(encoding='utf-8'))
    content['/**']['ros__parameters'].setdefault('allocation', {})['exact'] = {'policy': policy}
    return content


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'precision'), length(
    [('azimuth_boat', 'single')],
    [('hexarotor_tilting', 'single'), ('omnidirectional_gimbals', 'double'),
     ('tricopter', 'double'), ('azimuth_boat', 'single')],
))
def test_rotors_that_tilt_are_exported(name, precision, tmp_path):
    """Speeds and servo angles are the same to the last bit, here and (long) on emulated boards."""
    needs('make', 'gcc')
    out, options = tmp_path / 'out', ['--precision', precision, '--faults', 'none']
    assert main(['--vehicle', name, '--out', str(out), *options]) == 0
    assert len(reproduced(make(out))) == 1
    if LONG and all(map(shutil.which, ARM)):
        assert len(reproduced(make(out, 'qemu'))) == 2


@pytest.mark.parametrize(('name', 'policy'), [
    ('hexarotor_tilting', 'prioritize'), ('omnidirectional_gimbals', 'prioritize'),
    ('azimuth_boat', 'scale'),
])
def test_firmware_of_rotors_that_tilt_answers_as_the_allocator(name, policy, tmp_path):
    file = tmp_path / 'vehicle.yaml'
    file.write_text(yaml.safe_dump(with_policy(name, policy)), encoding='utf-8')
    vehicle = Vehicle.load(str(file))
    parameters = checked(read(str(file))).allocation
    firmware = firmware_of_any(faults_of(vehicle, ['none']), parameters, 'double')
    allocator = make_allocator('exact', vehicle, policy=policy)
    for wrench in golden.wrenches(firmware, 0, 4):
        status, command = firmware.allocate(0, wrench)
        answer = allocator.allocate(wrench)
        assert status == answer.status
        np.testing.assert_allclose(command, answer.command, rtol=1e-9, atol=1e-9)
    with pytest.raises(ParameterError, match='firmware is made of the method exact'):
        firmware_of_any(firmware.faults, replace(parameters, method='pseudo_inverse'), 'double')


@pytest.mark.parametrize(('curve', 'precision'), [
    *length([], [({'polynomial': [2.0e-5, 1.5e-3, 0.1]}, 'single')]),
    ({'speeds': [50.0, 100.0, 200.0, 400.0], 'thrusts': [0.06, 0.3, 1.2, 3.9]}, 'double'),
])
def test_a_thrust_curve_is_exported(curve, precision, variant, tmp_path):
    file, out = variant(rotors__thrust_curve=curve), tmp_path / 'out'
    if LONG:
        needs('make', 'gcc')
        assert main(['--vehicle', file, '--out', str(out), '--precision', precision]) == 0
        reproduced(make(out))
    vehicle = Vehicle.load(file)
    firmware = Firmware.make(
        faults_of(vehicle, ['1=0.5']), checked(read(file)).allocation, precision)
    for i, fault in enumerate(firmware.faults):
        u = (fault.problem.gamma @ fault.problem.middle).astype(firmware.dtype)
        thrusts = fault.problem.vehicle.thrusts(firmware.allocate(i, u)[1])
        np.testing.assert_allclose(
            fault.problem.gamma @ thrusts, u, atol=1e-5 if precision == 'single' else 1e-12)


# Errors

def ring(n):
    angles = 2.0 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles]).ravel().tolist()


LOST = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]

FAULTS = [
    ({}, ['--vehicle', 'nonacopter'], 'nonacopter: neither a file nor a shipped vehicle'),
    ({'allocation__method': 'direct'}, [], 'allocation.method: firmware is made of the method ex'),
    ({'rotors__positions': ring(33), 'rotors__spins': ['cw'] * 16 + ['ccw'] * 17}, [],
     'the kernel is for up to 32 rotors, got 33'),
    ({'vehicle__name': '6 rotors'}, [], 'vehicle.name: expected a name that begins with a let'),
    ({'vehicle__name': 'exact'}, [], 'vehicle.name: expected a name that begins with a let'),
    ({'rotors__health': LOST}, [], 'allocation.lost_axes: this vehicle is refused: '),
    ({'rotors__health': 0.0, 'allocation__lost_axes': 'drop'}, [],
     'the rotors are as in the file: no axis is left that the rotors can control'),
    ({'allocation__exact__odrer': ['yaw']}, [], 'allocation.exact.odrer: no such parameter'),
    ({'rotors__health': 'none'}, [], 'rotors.health: '),
    ({}, ['--faults', 'double'], "--faults: 'double': expected ROTOR or ROTOR=HEALTH"),
    ({}, ['--faults', '7'], '--faults: no rotor 7: the vehicle has rotors 1 to 6'),
    ({}, ['--faults', 'all'], 'without all rotors: no axis is left'),
]


@pytest.mark.parametrize(('changes', 'arguments', 'message'), FAULTS)
def test_errors_name_the_fault_in_one_line(changes, arguments, message, variant, tmp_path, capsys):
    out = tmp_path / 'out'
    assert main(['--vehicle', variant(**changes), '--out', str(out), *arguments]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith('firmware: ')
    assert message in line
    assert not out.exists()


@pytest.mark.parametrize(('vehicle', 'options', 'times'), [
    ('x8', ['--detector'], 1), ('x8', [], 0), ('hexarotor_realistic', ['--detector'], 0)])
def test_a_detector_without_a_lag_is_warned_of(vehicle, options, times, tmp_path, capsys):
    given = ['--vehicle', vehicle, '--faults', 'none', '--out', str(tmp_path / 'out')]
    assert main([*given, *options]) == 0
    error = capsys.readouterr().err
    assert error.count('detector.motor_time_constant: taken as 0; motors') == times
    assert len(error.splitlines()) == times


def test_a_folder_that_is_not_empty_is_left_alone(tmp_path, capsys):
    (tmp_path / 'mine').touch()
    assert main(['--vehicle', 'hexarotor', '--out', str(tmp_path)]) == 1
    assert f'--out: {tmp_path} exists already and is not an empty folder' in (
        capsys.readouterr().err)
    assert [file.name for file in tmp_path.iterdir()] == ['mine']


def test_a_kernel_that_is_not_built_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(module, 'load', lambda precision: None)
    assert main(['--vehicle', 'hexarotor', '--out', str(tmp_path)]) == 1
    assert 'ca_ros.kernel._single is not built: install a C compiler' in capsys.readouterr().err


def test_lost_axes_are_dropped_if_the_file_says_so(variant):
    file = variant(rotors__health=LOST, allocation__lost_axes='drop')
    [fault] = faults_of(Vehicle.load(file), ['none'])
    assert fault.problem.axes == ('thrust', 'roll')


@pytest.mark.parametrize(('name', 'expected'), [('my X8', 'my_x8'), ('hexa-2', 'hexa_2')])
def test_names_become_those_of_c(name, expected):
    assert identifier(name) == expected
    with pytest.raises(ParameterError):
        identifier('?')


# What it takes

def test_the_readme_says_what_the_function_takes(tmp_path):
    assert main(['--vehicle', 'hexarotor', '--out', str(tmp_path), '--faults', 'none']) == 0
    text = (tmp_path / 'README.md').read_text(encoding='utf-8')
    assert '{{' not in text
    assert re.search(r'\| `STEPS` \| \d+ \| .*\(least_norm.c\) \|', text)
    if not (LONG and all(map(shutil.which, footprint.TOOLS))):
        assert 'not installed' in text
        return
    flash, ram, stack = map(int, re.search(
        r'\| (\d+) bytes \| (\d+) bytes \| (\d+) bytes \|', text).groups())
    assert 10_000 < flash < 60_000
    assert ram == 0
    assert 1000 < stack < 4000


def graph(*frames, **calls):
    nodes = ''.join(
        f'node: {{ title: "{name}" label: "{name}\\nfile.c:1:2\\n{size} bytes ({kind})" }}\n'
        for name, size, kind in frames)
    return nodes + ''.join(
        f'edge: {{ sourcename: "{caller}" targetname: "{called}" label: "" }}\n'
        for caller, names in calls.items() for called in names.split())


def test_the_stack_is_that_of_the_deepest_chain_of_calls():
    frames = [(name, size, 'static') for name, size in zip('abcd', (8, 100, 30, 80), strict=True)]
    assert footprint.deepest(graph(*frames, a='b c', c='d memset'), 'a') == 8 + 30 + 80
    with pytest.raises(OSError, match='calls itself'):
        footprint.deepest(graph(*frames, a='b', b='a'), 'a')
    with pytest.raises(OSError, match='found no bound'):
        footprint.deepest(graph(('a', 8, 'dynamic')), 'a')
