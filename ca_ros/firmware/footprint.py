"""Flash, RAM and stack of the exported function on a Cortex-M, if its compiler is installed."""

import re
import subprocess
import tempfile
from pathlib import Path
from shutil import which
from typing import NamedTuple

TOOLS = ('make', 'arm-none-eabi-gcc', 'arm-none-eabi-size')

EMULATED = 'make', 'arm-none-eabi-gcc', 'qemu-system-arm'

GRAPH_NODE = re.compile(r'node: { title: "([^"]*)" label: "[^"]*?(\d+) bytes \((\w+)\)')
GRAPH_EDGE = re.compile(r'edge: { sourcename: "([^"]*)" targetname: "([^"]*)"')


class Footprint(NamedTuple):
    """Sizes in bytes, the version of the compiler, and the core."""

    flash: int
    ram: int
    stack: int
    compiler: str
    core: str


def measure(folder: Path, function: str, core: str) -> Footprint | str:
    """Compile an exported vehicle; return its footprint, or why it is not known.

    - `folder`: the folder of the export; it is not changed
    - `function`: that of vehicle.mk
    - `core`: what its Makefile compiles for
    """
    if missing := [tool for tool in TOOLS if not which(tool)]:
        return f'{", ".join(missing)} not installed'
    try:
        return _measured(folder, function, core)
    except OSError as error:
        return ' '.join(str(error).split())


def _measured(folder: Path, function: str, core: str) -> Footprint:
    with tempfile.TemporaryDirectory() as build:
        _run(
            'make', '-s', '-C', str(folder), 'CROSS=arm-none-eabi-', f'BUILD={build}',
            'CFLAGS=-O3 -fcallgraph-info=su', f'{build}/used.elf',
        )  # fmt: skip
        sizes = _run('arm-none-eabi-size', f'{build}/used.elf').splitlines()[1].split()
        graph = ''.join(file.read_text(encoding='utf-8') for file in Path(build).glob('*.ci'))
    text, data, bss = map(int, sizes[:3])
    compiler = _run('arm-none-eabi-gcc', '--version').partition('\n')[0]
    return Footprint(text + data, data + bss, deepest(graph, function), compiler, core)


def instructions(folder: Path) -> list[int] | str:
    """Run the worst wrenches of an exported vehicle (`make worst`) on an emulated core.

    Returns the instructions of each call, or why they are not known.
    """
    if missing := [tool for tool in EMULATED if not which(tool)]:
        return f'{", ".join(missing)} not installed'
    try:
        with tempfile.TemporaryDirectory() as build:
            said = _run('make', '-s', '-C', str(folder), f'BUILD={build}', 'worst')
    except OSError as error:
        return ' '.join(str(error).split())
    return [int(count) for count in re.findall(r'(\d+) instructions', said)]


def deepest(graph: str, function: str) -> int:
    """Return the stack that a function and all that it calls take at most [bytes].

    Raises an OSError if a frame has no bound, or functions call each other in a circle.

    `graph`: what GCC writes with ``-fcallgraph-info=su``.
    """
    frames = {}
    for title, size, kind in GRAPH_NODE.findall(graph):
        if kind != 'static':
            raise OSError(f'the compiler found no bound for the stack of {title}')
        frames[title] = int(size)
    calls: dict[str, set[str]] = {}
    for caller, called in GRAPH_EDGE.findall(graph):
        calls.setdefault(caller, set()).add(called)

    def depth(title: str, above: tuple[str, ...]) -> int:
        if title in above:
            raise OSError(f'{title} calls itself')
        below = (depth(called, (*above, title)) for called in calls.get(title, ()))
        # Functions of the C library have no entry: the few that are called take some words.
        return frames.get(title, 0) + max(below, default=0)

    return depth(function, ())


def _run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f'{command[0]}: {done.stderr.strip() or done.stdout.strip()}')
    return done.stdout
