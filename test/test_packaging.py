"""The source distribution and the wheel, built from a copy, are complete and work."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest

import ca_ros
import ca_ros.testing
from ca_ros import ALLOCATORS
from ca_ros.vehicle.files import shipped_problems, shipped_tilting, shipped_vehicles
from ca_ros_cli import COMMANDS, STUDIES

ROOT = Path(__file__).resolve().parent.parent
VEHICLES = sorted(shipped_vehicles())
CASES = sorted((*VEHICLES, *shipped_tilting(), *shipped_problems()))
PLACES = {key: value for key, value in os.environ.items() if key == 'PYTHONPATH'}
"""Where colcon has installed the package."""

PAGE_TOOLS = ('npm', 'clang', 'wasm-ld')
"""What `make explorer` needs."""

LEFT_BY_TOOLS = (
    '.git', '.venv', '.coverage*', '.hypothesis', '.*_cache', '__pycache__', '*.egg-info', 'build',
    'dist', 'install', 'node_modules', 'log', 'out', '*.so')


@pytest.fixture(scope='module')
def tree(tmp_path_factory):
    """Return a copy of the sources, without what tools leave in them."""
    copy = tmp_path_factory.mktemp('copy') / 'ca_ros'
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*LEFT_BY_TOOLS))
    return copy


@pytest.fixture(scope='module')
def sdist(tree):
    """Return the folder that the source distribution unpacks to."""
    archive = build(tree, '--sdist')
    with tarfile.open(archive) as file:
        file.extractall(tree.parent)
    return tree.parent / archive.name.removesuffix('.tar.gz')


@pytest.fixture(scope='module')
def wheel(sdist):
    """Return the wheel that is built from the unpacked source distribution."""
    return build(sdist, '--wheel')


def build(tree, kind):
    """Build a distribution with what is installed here; return its file."""
    pytest.importorskip('build', reason="needs the extra 'test'")
    run('-m', 'build', '--no-isolation', kind, '--outdir', str(tree.parent / 'dist'), str(tree))
    [file] = (tree.parent / 'dist').glob('*.whl' if kind == '--wheel' else '*.tar.gz')
    return file


def run(*arguments, cwd='/', **environment):
    """Run Python to a good end; return what it prints."""
    inherited = {key: value for key, value in os.environ.items() if key != 'PYTHONPATH'}
    process = subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=inherited | environment, capture_output=True,
        text=True)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


@pytest.mark.long
def test_the_source_distribution_has_every_source(tree, sdist):
    def files(folder):
        return {str(path.relative_to(folder)) for path in folder.rglob('*') if path.is_file()}

    assert files(tree) - files(sdist) == set()
    made = {name for name in files(sdist) - files(tree) if 'egg-info' not in name}
    assert made == {'PKG-INFO'}
    assert {'LICENSE', 'package.xml', 'ca_ros/py.typed', 'resource/ca_ros', 'test/nodes.py'} <= (
        files(sdist))


@pytest.mark.long
def test_the_wheel_has_the_package_and_what_ros_needs(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        [metadata] = (archive.read(name) for name in names if name.endswith('/METADATA'))
    modules = {
        str(path.relative_to(ROOT)) for path in (ROOT / 'ca_ros').rglob('*.py')}
    assert 'pytest_ca_ros.py' in names
    library = {str(path.relative_to(ROOT)) for path in (ROOT / 'ca_ros/kernel').glob('*.[chj]*')}
    assert len(library) > 4
    assert modules | library | {
        'ca_ros/py.typed', 'ca_ros/studies/templates/static.md',
        'ca_ros/process/discovery.xml'} <= set(names)
    # `make test-all` and the workflow of releases build the page first.
    if (ROOT / 'ca_ros/explorer.html').is_file() or all(map(shutil.which, PAGE_TOOLS)):
        assert 'ca_ros/explorer.html' in names, 'make explorer'
    links = re.findall(r'\]\((\S*)\)', metadata.decode())
    assert len(links) > 4
    assert all(link.startswith('https://') for link in links)
    extensions = {
        '_detector', '_detector_single', '_double', '_double_4', '_single', '_vectored',
        '_vectored_single',
    }
    assert extensions <= {Path(name).name.partition('.')[0] for name in names}
    [data] = {name.split('/')[0] for name in names if '.data/' in name}
    shared = {name.removeprefix(f'{data}/data/share/') for name in names if name.startswith(data)}
    layouts = {f'ca_ros/layouts/{file.name}' for file in (ROOT / 'layouts').iterdir()}
    assert shared >= layouts | {f'ca_ros/config/{vehicle}.yaml' for vehicle in VEHICLES} | {
        'ca_ros/package.xml', 'ament_index/resource_index/packages/ca_ros'}
    assert any(name.endswith('LICENSE') for name in names)
    assert not any(name.startswith(('test', 'docs', 'examples')) for name in names)


@pytest.mark.long
def test_the_package_built_from_the_source_distribution_works(wheel, sdist, tmp_path):
    run('-m', 'pip', 'install', '--quiet', '--no-deps', '--no-index', '--ignore-installed',
        '--prefix', str(tmp_path), str(wheel))
    [site] = tmp_path.glob('lib*/python*/site-packages')
    script = (
        'import ca_ros; print(ca_ros.__file__); '
        f'print([ca_ros.Vehicle.load(name).n for name in {VEHICLES}])')
    place, rotors = run('-c', script, PYTHONPATH=str(site)).splitlines()
    assert Path(place).is_relative_to(tmp_path)
    assert rotors.count(',') == len(VEHICLES) - 1
    assert str(site) in run('-m', 'ca_ros', '--version', PYTHONPATH=str(site))
    assert [path.name for path in (tmp_path / 'bin').glob('[!p]*')] == ['ca_ros']
    scripts = [*(tmp_path / 'lib' / 'ca_ros').iterdir()]
    assert {path.name for path in scripts} == set(COMMANDS)
    assert all(os.access(path, os.X_OK) for path in scripts)
    # The tests come with the sources, and find all that they need there.
    assert 'passed' in run(
        '-m', 'pytest', '-q', 'test/test_parameters.py', 'test/test_vehicle.py', cwd=sdist)


@pytest.mark.slow
def test_it_is_imported_in_the_folder_that_holds_the_clone(tmp_path):
    # There the clone's folder has the name of the package, and is none.
    (tmp_path / 'ca_ros').mkdir()
    script = 'import ca_ros; print(ca_ros.Vehicle.load("hexarotor").n)'
    assert run('-c', script, cwd=tmp_path, **PLACES) == '6\n'


# What there is

@pytest.mark.slow
def test_python_m_ca_ros_names_all_there_is():
    said = run('-m', 'ca_ros', cwd=ROOT, **PLACES)
    assert said == run('-m', 'ca_ros', '--help', cwd=ROOT, **PLACES)
    for name in (*COMMANDS, *CASES, *ALLOCATORS):
        assert f'\n  {name} ' in said, name
    version = ElementTree.parse(ROOT / 'package.xml').findtext('version')
    assert run('-m', 'ca_ros', '--version', cwd=ROOT, **PLACES).startswith(f'ca_ros {version} in ')


@pytest.mark.slow
def test_a_reader_of_python_m_ca_ros_may_end_first():
    command = f'{sys.executable} -u -m ca_ros | true'
    process = subprocess.run(command, cwd=ROOT, shell=True, capture_output=True, text=True)
    assert (process.returncode, process.stderr) == (0, '')


@pytest.mark.slow
def test_python_m_ca_ros_says_that_there_is_no_rclpy(tmp_path):
    script = (
        'import sys, runpy; sys.modules["rclpy"] = None; sys.argv[1:] = ["--version"]; '
        f'sys.path.insert(0, {str(ROOT)!r}); runpy.run_module("ca_ros", run_name="__main__")')
    assert 'rclpy: absent' in run('-c', script, cwd=tmp_path)


def test_the_pythons_agree():
    makefile, ci, *pages = (
        (ROOT / name).read_text(encoding='utf-8')
        for name in ('Makefile', '.github/workflows/ci.yml', 'README.md', 'CONTRIBUTING.md'))
    [allowed] = re.findall(r'filter-out ([0-9. ]+),', makefile)
    [tested] = re.findall(r'python: \[(.*)\]', ci)
    first, *_, last = allowed.split()
    assert tested.replace("'", '').split(', ') == allowed.split()
    for page in (makefile, *pages):
        assert set(re.findall(r'3\.\d+ to 3\.\d+', page)) == {f'{first} to {last}'}


def test_pip_and_rosdep_install_the_same():
    """Nodes need the same of both; package.xml adds what the studies need, as it says."""
    setup = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    lists = {
        node.targets[0].id: node.value for node in setup.body if isinstance(node, ast.Assign)
    } | {word.arg: word.value for node in ast.walk(setup) if isinstance(node, ast.Call)
         for word in node.keywords}
    needed, studies = (
        {re.split('[^a-z0-9]', requirement.lower())[0]
         for requirement in ast.literal_eval(lists[name])}
        for name in ('install_requires', 'studies'))
    package = ElementTree.parse(ROOT / 'package.xml')
    keys = {key.text.removeprefix('python3-').replace('yaml', 'pyyaml')
            for key in package.iter('exec_depend') if key.text.startswith('python3-')}
    assert keys == (needed - {'osqp'}) | studies
    assert studies == set(STUDIES)
    assert needed == {'numpy', 'scipy', 'osqp', 'pyyaml', 'jinja2'}


def test_the_versions_agree():
    version = ElementTree.parse(ROOT / 'package.xml').findtext('version')
    assert f'version: {version}\n' in (ROOT / 'CITATION.cff').read_text(encoding='utf-8')
    changes = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    assert re.findall(r'^(\d\S*) \(\d{4}-\d\d-\d\d\)\n-', changes, re.MULTILINE)[0] == version


def test_the_reference_has_every_public_name():
    lines = (ROOT / 'docs/api.rst').read_text(encoding='utf-8').splitlines()
    names = [line.strip() for line in lines if re.fullmatch(r'   \w+', line)]
    [constants] = (line for line in lines if line.startswith('Constants: '))
    names += re.findall('``(.*?)``', constants)
    assert sorted(names) == sorted([*ca_ros.__all__, *ca_ros.testing.__all__])
