"""The kernel's C files: sanitizers with hostile input, warnings, cppcheck, and what they need."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

import ca_ros
from strategies import length

pytestmark = [pytest.mark.long, pytest.mark.slow]

INPUTS = length(20_000, 20_000, 1_000_000)
"""So many the sanitizers get."""

SEED = '9'
"""With it, a preferred thrust once moved a rotor out of its bounds."""

KERNEL = Path(ca_ros.__file__).parent / 'kernel'
SOURCES = sorted(str(path) for path in KERNEL.glob('*.c') if 'module' not in path.name)
DRIVER = str(Path(__file__).parent / 'kernel' / 'hostile.c')

FLAGS = ['-std=c99', '-ffp-contract=off', f'-I{KERNEL}']
WARNINGS = ['-Werror', '-Wall', '-Wextra', '-Wpedantic', '-Wconversion', '-Wshadow',
            '-Wdouble-promotion', '-Wfloat-conversion', '-Wfloat-equal', '-Wundef']
FAST = ['-Ofast', '-ffast-math']
CPP = {'gcc': ['g++', '-xc++', '-std=c++17'], 'clang': ['clang++', '-xc++', '-std=c++17']}
SANITIZERS = ['-O1', '-g', '-fsanitize=address,undefined', '-fno-sanitize-recover=all']

FIXED = ['-DCA_FIXED', '-DCA_N=6', '-DCA_M=4']
BUILDS = {'double': [], 'single': ['-DCA_FLOAT'], 'double 6x4': FIXED,
          'single 6x4': ['-DCA_FLOAT', *FIXED]}
COMPILERS = ['gcc', 'clang']

NEEDED = {'sqrt', 'fabs', 'sqrtf', 'fabsf', 'memcpy', 'memset', 'memmove'}
"""Symbols of other libraries that the kernel may need; compilers add those of memory."""


def needs(*tools):
    """Skip the test if a tool is missing."""
    for tool in tools:
        if shutil.which(tool) is None:
            pytest.skip(f'needs {tool}, which is not installed')


def run(*command):
    """Run a command; return what it prints."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, f'{" ".join(command)}\n{done.stdout}'
    return done.stdout


@pytest.mark.parametrize('build', BUILDS)
def test_sanitizers_find_nothing_in_hostile_inputs(build, tmp_path, record_property):
    needs('gcc')
    program = str(tmp_path / 'hostile')
    command = ['gcc', *FLAGS, *SANITIZERS, *BUILDS[build]]
    (tmp_path / 'empty.c').write_text('int main(void) { return 0; }\n')
    if subprocess.run([*command, str(tmp_path / 'empty.c'), '-o', program],
                      capture_output=True).returncode:
        pytest.skip('needs the libraries of the address and undefined behaviour sanitizers')
    run(*command, *SOURCES, DRIVER, '-lm', '-o', program)
    answers = dict(re.findall(r'(\w+ \d): (\d+)', run(program, str(INPUTS), SEED)))
    record_property('inputs', INPUTS)
    # All of them were met, but for `inexact`.
    assert all(int(n) > 0 for name, n in answers.items() if name != 'status 3'), answers


@pytest.mark.parametrize('build', BUILDS)
@pytest.mark.parametrize('compiler', COMPILERS)
def test_answers_are_sound_with_fast_math(compiler, build, tmp_path):
    """The driver, which tells what is sound, is compiled without fast math."""
    needs(compiler)
    program, objects = str(tmp_path / 'hostile'), [str(tmp_path / 'hostile.o')]
    run(compiler, '-O1', *FLAGS, *BUILDS[build], '-c', DRIVER, '-o', objects[0])
    for source in SOURCES:
        objects.append(str(tmp_path / f'{Path(source).stem}.o'))
        run(compiler, *FAST, *FLAGS, *BUILDS[build], '-c', source, '-o', objects[-1])
    run(compiler, *objects, '-lm', '-o', program)
    assert 'fault 4' in run(program, str(INPUTS), SEED)


@pytest.mark.parametrize('build', BUILDS)
@pytest.mark.parametrize('compiler', COMPILERS)
def test_the_library_is_cpp_as_well(compiler, build, tmp_path):
    needs(CPP[compiler][0])
    for source in SOURCES:
        run(*CPP[compiler], *FLAGS[1:], *WARNINGS, *BUILDS[build], '-c', source,
            '-o', str(tmp_path / 'part.o'))


@pytest.mark.parametrize('build', ['double', 'single'])
def test_cppcheck_finds_nothing(build):
    needs('cppcheck')
    run('cppcheck', '--enable=warning,performance,portability', '--error-exitcode=1', '--quiet',
        '--std=c99', '--inline-suppr', *BUILDS[build], *SOURCES)


@pytest.mark.parametrize('build', BUILDS)
@pytest.mark.parametrize('compiler', COMPILERS)
def test_the_library_compiles_without_warnings_and_needs_square_roots_alone(
        compiler, build, tmp_path):
    needs(compiler, 'nm')
    symbols = ''
    for source in SOURCES:
        part = str(tmp_path / 'part.o')
        # Distributions switch on checks that need further symbols.
        run(compiler, '-O2', *FLAGS, *WARNINGS, *BUILDS[build], '-fno-pic',
            '-fno-stack-protector', '-U_FORTIFY_SOURCE', '-c', source, '-o', part)
        symbols += run('nm', part)
    found = re.findall(r'([A-Za-z]) (\w+)$', symbols, re.MULTILINE)
    defined = {name for kind, name in found if kind == 'T'}
    assert {name for kind, name in found if kind == 'U'} - defined <= NEEDED
    assert all(name.startswith('ca_') for name in defined)
    # It has no variables.
    assert not [name for kind, name in found if kind in 'BbCcDdGgSs']
