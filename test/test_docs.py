"""What README and the guides tell users to type works, block by block."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

import pytest

from ca_ros import Exact, Vehicle
from ca_ros.nodes.topics import TOPICS
from ca_ros.testing import executable
from ca_ros_cli import NODES
from strategies import LONG

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ('*.md', 'docs/*.md', 'examples/*.md') for path in ROOT.glob(pattern))

LATER = {'CONTRIBUTING.md', *(f'docs/{page}.md' for page in (
    'failure', 'firmware', 'own_method', 'performance', 'plant_effects', 'px4', 'reproduction',
    'studies', 'tilting'))}
"""Pages for `make test-all`: README has their commands, or other tests do what they do."""

NOT_HERE = {
    'needs ROS': 'a ROS 2 installation',
    'needs PX4': 'PX4, its simulation and px4_msgs (docs/px4.md, "Five minutes to a hover")',
    'needs hardware': 'a vehicle',
    'needs an hour': 'an hour; make soak',
    'needs the log': 'pyulog and a log of its repository',
    'needs rotorpy': 'rotorpy, an environment of 500 MB',
    'needs a flight': 'the file of a recorded flight; test_identify.py has one of a simulation',
    'needs MuJoCo': 'MuJoCo; test_mujoco.py flies and renders where it is installed',
    'long': 'minutes; CA_ROS_LONG=1 runs them',
    'run by .ci/run': 'no more: .ci/run does it, in a fresh clone',
}
"""Marks of blocks that are not run here, and what they would need."""

SHORT = {
    'bringup': '--figures none --duration 0.2 --waypoint 0 0 0 --heading 0',
    'dynamic_study': '--figures none --duration 0.2',
    'mypy': 'ca_ros/errors.py',
    'static_study': '--figures none --samples 50',
}
"""How commands are shortened to seconds unless CA_ROS_LONG=1; the last of equal options counts."""

FENCE = re.compile(
    r'(?:^<!-- (?P<mark>[^\n]*?) -->\n)?^```(?P<kind>\w+)\n(?P<text>.*?)^```$'
    r'(?:\n\n```text\n(?P<output>.*?)^```$)?', re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page, with the comment in front of it and the output after it."""

    kind: str
    text: str
    mark: str
    output: str | None

    @property
    def runs(self):
        """Whether it is to be run here."""
        long = self.mark == 'long' and LONG
        return self.kind in ('sh', 'python') and (long or self.mark not in NOT_HERE)


def blocks(page):
    """Return the blocks of a page in their order."""
    text = (ROOT / page).read_text(encoding='utf-8')
    return [
        Block(found['kind'], found['text'], found['mark'] or '', found['output'])
        for found in FENCE.finditer(text)]


@pytest.fixture
def clone(tmp_path):
    """Return a copy of the sources, with a virtual environment that is this one."""
    place = tmp_path / 'clone'
    left_out = shutil.ignore_patterns(
        '.*', 'out', 'build', 'install', 'log', '*.egg-info', 'node_modules')
    shutil.copytree(ROOT, place, ignore=left_out)
    shutil.copytree(ROOT / '.ci', place / '.ci')
    activate = place / '.venv' / 'bin' / 'activate'
    activate.parent.mkdir(parents=True)
    activate.touch()
    for name in () if LONG else ('ca_ros', 'mypy'):
        file = activate.with_name(name)
        [program] = executable(name)
        file.write_text(
            f'#!{sys.executable}\nimport os, re, sys\n'
            "words = [re.sub('(?<=[0-9]@)[0-9.]+', '0.1', word) for word in sys.argv[1:]]\n"
            "words += ['--'] * ('--ros-args' in words)\n"
            f'short = {SHORT}.get((words[:{name == "ca_ros"}] or [{name!r}])[0], "")\n'
            f'os.execv({program!r}, [sys.argv[0], *words, *short.split()])\n',
            encoding='utf-8')
        file.chmod(0o755)
    return place


def environment(place, graph):
    """Return what a shell in an activated clone would have."""
    paths = [
        str(place / '.venv' / 'bin'), sysconfig.get_path('scripts'),
        str(Path(sys.executable).parent), os.environ['PATH']]
    # The clone comes first; the entry point of the plugin may be where colcon has installed it.
    modules = [str(place), *filter(None, [os.environ.get('PYTHONPATH')])]
    return os.environ | {
        'PATH': os.pathsep.join(paths), 'PYTHONPATH': os.pathsep.join(modules),
        'ROS_DOMAIN_ID': str(graph.domain), 'MPLBACKEND': 'agg',
        'MYPY_CACHE_DIR': str(ROOT / '.mypy_cache')}


def shell(place, graph, script):
    """Run a script in the clone."""
    run = subprocess.run(
        ['bash', '-euo', 'pipefail', '-c', script], cwd=place, env=environment(place, graph),
        capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    assert run.returncode == 0, f'{script}\n{run.stdout}\n{run.stderr}'
    return run.stdout


def write(place, block):
    """Write a block into its file: imports in their order, entries at the end of a dict."""
    path = place / block.mark.rpartition(' ')[2]
    text = block.text
    if block.mark.startswith('insert '):
        old = path.read_text(encoding='utf-8')
        if text.startswith('from '):
            after = next(line for line in old.splitlines(keepends=True)
                         if line.startswith('from ca_ros') and line > text)
            text = old.replace(after, text + after, 1)
        else:
            text = old.replace('\n}\n', f'\n{text}}}\n', 1)
    path.write_text(text, encoding='utf-8')


ADDED = """
python -c "from ca_ros import ALLOCATORS; assert 'mean' in ALLOCATORS"
ruff check ca_ros/allocation
python -m pytest -q -p no:cacheprovider test/test_allocators.py -k mean
ca_ros static_study --methods exact,mean --out out/mean
"""
"""What must work with the method that CONTRIBUTING adds."""


@pytest.mark.slow
@pytest.mark.parametrize('page', [
    pytest.param(page, marks=pytest.mark.long if page in LATER else ()) for page in PAGES
    if any(block.runs for block in blocks(page))])
def test_the_commands_of_a_page_run_one_after_the_other(page, clone, graph):
    for block in blocks(page):
        if block.mark.startswith(('file ', 'insert ')):
            write(clone, block)
        elif block.runs and block.kind == 'sh':
            shell(clone, graph, block.text)
        elif block.runs:
            printed = shell(clone, graph, f"python - <<'END'\n{block.text}\nEND\n")
            assert block.output is None or printed == block.output
    if page == 'CONTRIBUTING.md':
        shell(clone, graph, ADDED)


def test_marks_are_known_and_what_is_not_run_here_is_listed(record_property):
    not_run = []
    for page in PAGES:
        for block in blocks(page):
            word = block.mark.split(' ')[0]
            known = ('', 'file', 'insert', 'prints')
            assert block.mark in NOT_HERE or word in known, block
            assert not (block.runs and re.search(r'^make\b', block.text, re.MULTILINE)), (
                f'{page}: make in a copy would install anew: let .ci/run do it')
            if block.kind in ('sh', 'python') and block.mark in NOT_HERE:
                not_run.append(f'{page}: {block.text.splitlines()[0]} ({NOT_HERE[block.mark]})')
    record_property('not run', not_run)
    print(*not_run, sep='\n')
    assert not_run


def test_what_is_left_to_ci_is_done_there():
    script = (ROOT / '.ci' / 'run').read_text(encoding='utf-8')
    for page in PAGES:
        for block in blocks(page):
            if block.mark == 'run by .ci/run':
                for line in block.text.splitlines():
                    command = line.partition('#')[0].strip()
                    line = rf'^ *{re.escape(command)}( \|\|)?$'
                    assert re.search(line, script, re.MULTILINE), command


def test_links_within_the_repository_lead_somewhere():
    more = [path.relative_to(ROOT).as_posix() for folder in ('benchmarks', 'layouts')
            for path in (ROOT / folder).rglob('*.md')]
    assert more
    for page in [*PAGES, *more]:
        text = (ROOT / page).read_text(encoding='utf-8')
        for target in re.findall(r'\]\((?!https?:|#)([^)#]+)', text):
            assert (ROOT / page).parent.joinpath(target).exists(), f'{page}: {target}'


def test_equations_that_docstrings_cite_stand_on_the_page_of_the_model():
    page = (ROOT / 'docs' / 'model.md').read_text(encoding='utf-8')
    there = [int(number) for number in re.findall(r'\\tag\{(\d+)\}', page)]
    assert there == [*range(1, 24)]
    files = [*(ROOT / 'ca_ros').rglob('*.py'), *(ROOT / 'ca_ros').rglob('*.[ch]')]
    cited = [
        int(number) for file in files
        for spot in re.findall(r'\bEqs?\.\s+\(.{,20}', file.read_text(encoding='utf-8'), re.DOTALL)
        for number in re.findall(r'\((\d+)\)', spot)]
    assert len(cited) > 30
    assert {*cited} <= {*there}


def test_the_messages_of_troubleshooting_are_said(tmp_path):
    page = (ROOT / 'docs' / 'troubleshooting.md').read_text(encoding='utf-8')
    file = (ROOT / 'config' / 'quadrotor.yaml').read_text(encoding='utf-8')
    slips = {
        'spin': ('spins:', 'spin:'), 'mass': ('mass: 1.0', 'mass: 30.0'),
        'turns': ('[cw, ccw, cw, ccw]', '[cw, ccw, ccw, cw]'),
        'millimetres': ('0.176776695297', '176.776695297')}
    said = []
    for name, slip in slips.items():
        path = tmp_path / f'{name}.yaml'
        path.write_text(file.replace(*slip), encoding='utf-8')
        run = subprocess.run(
            [sys.executable, '-m', 'ca_ros', 'audit', str(path)], capture_output=True, text=True)
        said.append(run.stdout + run.stderr)
    allocator = Exact(Vehicle.load('quadrotor'))
    with pytest.raises(ValueError, match='expected shape') as raised:
        allocator.allocate([9.81, 0.0, 0.0])
    said.append(str(raised.value))
    quoted = re.findall(r'`([^`]+)`', page)
    for words in said:
        assert any(len(each) > 20 and each in words for each in quoted), words


def test_files_that_pages_name_exist():
    for page in PAGES:
        text = (ROOT / page).read_text(encoding='utf-8')
        for name in re.findall(r'`([\w/]*(?:/\w+|\btest_\w+)\.(?:py|c|h|xml))`', text):
            places = (ROOT / name, ROOT / 'ca_ros' / name, ROOT / 'test' / name)
            written = name in {block.mark.rpartition(' ')[2] for block in blocks(page)}
            # src/ is PX4's.
            elsewhere = 'NAME' in name or name[:4] == 'src/'
            assert written or elsewhere or any(map(Path.exists, places)), f'{page}: {name}'


@pytest.mark.slow
def test_the_generated_parts_are_up_to_date():
    command = [sys.executable, str(ROOT / 'docs' / 'scripts' / 'readme.py'), '--check']
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_the_table_of_topics_names_every_topic_at_its_nodes():
    rows = {
        row[1]: row[2:] for row in re.findall(
            r'^((?:\| `(\w+)` )\|(.*)\|(.*)\|)$', (ROOT / 'docs' / 'topics.md').read_text(), re.M)}
    topics = [topic for topic in TOPICS if topic.publisher in NODES]
    assert len(topics) > 7
    for topic in topics:
        assert f'`{topic.name}`' in rows[topic.publisher][1], topic
        for node in topic.subscribers:
            assert f'`{topic.name}`' in rows[node][0], topic


@pytest.mark.skipif(not shutil.which('systemd-analyze'), reason='needs systemd-analyze')
def test_systemd_finds_no_fault_in_the_unit(tmp_path):
    def faults(text):
        file = tmp_path / 'allocator.service'
        file.write_text(text, encoding='utf-8')
        verify = subprocess.run(
            ['systemd-analyze', 'verify', '--man=no', '--recursive-errors=no', str(file)],
            capture_output=True, text=True)
        return verify.stdout + verify.stderr

    [unit] = [
        block.text for block in blocks('docs/onboard.md')
        if block.mark == 'file allocator.service']
    assert faults(unit) == ''
    assert 'Restrat' in faults(unit.replace('Restart=', 'Restrat='))
