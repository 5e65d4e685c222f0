"""Bound the instructions of a call of the exported kernel: ``instruction_bound.py hexarotor``.

The kernel is compiled as `firmware` counts it.  From the machine code come the blocks of
instructions and the ways between them; from the source, by the lines in the debug information, how
often each loop repeats at most; from `ca_ros.firmware.worst_case`, how many steps and pivots all
loops do together.  A linear program finds the greatest number of instructions that these admit
(implicit path enumeration).  Instructions whose condition fails count.  No bound is measured.  It
is assumed that no number of double precision is subnormal.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import tempfile
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import firmware as counted
import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from ca_ros.firmware.command import checked
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.firmware import Firmware
from ca_ros.firmware.worst_case import Bounds, constant
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.files import read
from ca_ros.vehicle.vehicle import Vehicle

CONDITION = '(?:eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le)'
DIVISION = 14  # repetitions of the loop of __aeabi_ddiv, which finds four of 53 bits each


@dataclass
class Sizes:
    """The greatest sizes of a vehicle's problem over its faults, as priorities.c names them."""

    n: int
    m: int
    rows: int
    columns: int
    variables: int

    @classmethod
    def of(cls, firmware: Firmware) -> Sizes:
        """Return those of a vehicle."""
        found = []
        for kernel in firmware.kernels:
            fields = kernel.fields()
            (n,), (m,), group = (fields[name][2] for name in ('n', 'm', 'group'))
            sizes = [group[:m].count(i) for i in range(group[m - 1] + 1)]
            lags = [size for size in sizes[1:] if size > 1]
            added = 2 * (sizes[0] > 1) + len(lags)
            found.append((n, m, m + 2 * sum(lags), n + added, n + m + added + 2 * sum(lags)))
        return cls(*np.max(found, axis=0).tolist())

    def trips(self, file: str, loop: str) -> int:
        """Return how often the body of a loop runs at most; `loop` is its first line."""
        both, groups = self.n + self.m, self.m
        table = (
            ('pivot < limit', constant('PIVOTS_PER_VARIABLE') * self.variables),
            ('ATTEMPT : STEPS', constant('STEPS')), (r'number < CA_CHOOSE_INT\(n, 3\)', self.n),
            ('piece', 2 * both), (r'ROWS \+ s->columns', 3 * groups + self.columns),
            ('found = 0', constant('PLANES') + 1), (r'< 2\b', 2), (r's->rows|< near', self.rows),
            ('column', self.columns), (r'CA_ROTORS|< n\b', self.n),
            (r'CA_AXES|< m\b|m - 1|rank|first|along|start|[<>]=? ?[kjr0]\b', groups),
            ('count|frees', both if file in ('least_norm.c', 'numbers.h') else groups),
        )
        for pattern, count in table:
            if re.search(pattern, re.sub('int [a-z]+ = [^;]*;', '', loop, count=1)):
                return count
        raise ValueError(f'{file}: no bound of {loop}')


Way = tuple[int, 'int | None']
"""From one block to another; None: to where the function was called."""


Line = tuple[str, str]
"""The file and the text of a line of the source where a loop begins."""


@lru_cache
def text_of(file: str) -> list[str]:
    """Return the lines of a file, none if it is not there: the libraries of the compiler."""
    return Path(file).read_text(encoding='utf-8').splitlines() if Path(file).exists() else []


def loops_of(file: str, number: str) -> tuple[Line | None, Line | None]:
    """Return the loop that begins in a line, and the innermost one around it, by indentation."""
    lines = text_of(file)[: int(number) if number.isdigit() else 0]
    if not lines:
        return None, None
    found, indent = [], len(lines[-1]) + 1
    for line in reversed(lines):
        own = len(line) - len(line.lstrip())
        if line.strip() and own < indent:
            indent = own
            begins = re.match(r'(} )?(for|while) \(', line.strip())
            found.append((Path(file).name, line.strip()) if begins else None)
    return found[0], next((each for each in found[1:] if each), None)


@dataclass
class Block:
    """Instructions that run one after the other, and what comes after them."""

    addresses: list[int] = field(default_factory=list)
    calls: list[int] = field(default_factory=list)
    after: list[int] = field(default_factory=list)
    ends: bool = False


class Code:
    """The machine code of a program: its functions as blocks, by the address of the first."""

    def __init__(self, program: Path, root: str) -> None:
        self.program = program
        listing = subprocess.check_output(
            ['arm-none-eabi-objdump', '-d', '--no-show-raw-insn', program], text=True)
        self.text: dict[int, tuple[str, str]] = {}
        self.names: dict[int, str] = {}
        for line in listing.splitlines():
            if found := re.match(r'([0-9a-f]+) <(.*)>:$', line):
                self.names[int(found[1], 16)] = found[2]
            elif found := re.match(r'\s*([0-9a-f]+):\s+([a-z]\S*)\s*(.*)$', line):
                self.text[int(found[1], 16)] = found[2], found[3]
        self.starts, places = sorted(self.names), sorted(self.text)
        self.next = dict(pairwise(places))
        [self.root] = (start for start, name in self.names.items() if name.startswith(root))
        self.functions: dict[int, dict[int, Block]] = {}
        waiting = [self.root]
        while waiting:
            start = waiting.pop()
            if start not in self.functions:
                self.functions[start] = self._blocks(start)
                waiting += [
                    call for block in self.functions[start].values() for call in block.calls]

    def wide(self) -> set[int]:
        """Return the functions that the second run calls, in double precision."""
        found: set[int] = set()
        waiting = [start for start in self.functions if 'ca_serve_wide' in self.name(start)]
        while waiting:
            start = waiting.pop()
            if start not in found:
                found.add(start)
                waiting += [
                    call for block in self.functions[start].values() for call in block.calls]
        return found

    def name(self, start: int) -> str:
        """Return the name of a function; parts of the compiler's library may have none."""
        return self.names.get(start, '__')

    def _function(self, place: int) -> int:
        return self.starts[bisect_right(self.starts, place) - 1]

    def _step(self, place: int, start: int) -> tuple[list[int], list[int], bool]:
        """Return what may run after an instruction, what it calls, and whether it may return."""
        word, rest = self.text[place]
        following = [self.next[place]] if place in self.next else []
        if found := re.fullmatch(rf'b({CONDITION})?(\.[nw])?|cbn?z', word):
            target = int(rest.split(',')[-1].split()[0], 16)
            goes_on = following if found[1] or word.startswith('cb') else []
            own = self.name(start).startswith('__') or self._function(target) == start
            return ([target, *goes_on], [], False) if own else (goes_on, [target], True)
        if found := re.fullmatch(rf'bl({CONDITION})?', word):
            return following, [int(rest.split()[0], 16)], False
        if found := re.fullmatch(rf'(?:bx|pop|ldmia|ldr)({CONDITION})?(\.w)?', word):
            returns = (rest == 'lr') if word.startswith('bx') else bool(re.search(r'\bpc\b', rest))
            if returns and not re.search(r'\[pc', rest):
                return following if found[1] else [], [], True
        if word[:2] in ('tb', 'bx') or rest.startswith('pc,') or word == 'blx':
            raise ValueError(f'{place:x}: cannot follow {word} {rest}')
        return following, [], False

    def _blocks(self, start: int) -> dict[int, Block]:
        steps, heads, waiting = {}, {start}, [start]
        while waiting:
            place = waiting.pop()
            if place in steps:
                continue
            steps[place] = after, calls, ends = self._step(place, start)
            if ends or calls or after != [self.next.get(place)]:
                heads.update(after)
            waiting += after
        blocks = {}
        for head in heads:
            block, place = Block(), head
            while True:
                block.addresses.append(place)
                block.after, calls, block.ends = steps[place]
                block.calls += calls
                if len(block.after) != 1 or block.ends or block.after[0] in heads:
                    break
                place = block.after[0]
            blocks[head] = block
        return blocks

    def loops_at(self) -> tuple[dict[int, Line], dict[int, Line]]:
        """Return by the address of instructions the loops in their lines, and around these."""
        places = [
            place for blocks in self.functions.values() for block in blocks.values()
            for place in block.addresses]
        lines = subprocess.run(
            ['arm-none-eabi-addr2line', '-e', self.program], text=True, check=True,
            input='\n'.join(map(hex, places)), stdout=subprocess.PIPE).stdout.splitlines()
        known: dict[str, tuple[Line | None, Line | None]] = {}
        at, around = {}, {}
        for place, line in zip(places, lines, strict=True):
            if line not in known:
                known[line] = loops_of(*line.split(' ')[0].rsplit(':', 1))
            here, outer = known[line]
            if here:
                at[place] = here
            if outer:
                around[place] = outer
        return at, around


class Program:
    """The linear program: how often the ways between the blocks are taken."""

    def __init__(self, code: Code, sizes: Sizes) -> None:
        self.code, self.sizes = code, sizes
        self.lines, self.around = code.loops_at()
        self.wide = code.wide()
        self.costs: list[float] = []
        self.equal: list[dict[int, float]] = []
        self.most: list[tuple[dict[int, float], float]] = []
        self.repeated: dict[str, set[int]] = defaultdict(set)
        self.entry = {start: self._variable() for start in code.functions}
        callers: dict[int, list[int]] = defaultdict(list)
        for start, blocks in code.functions.items():
            for called, ways in self._function(start, blocks):
                callers[called] += ways
        for start, way in self.entry.items():
            row = {way: 1.0}
            for other in callers[start]:
                row[other] = row.get(other, 0.0) - 1.0
            self.equal.append(row)
        self.root = list(self.entry).index(code.root) - len(self.entry)

    def _variable(self) -> int:
        self.costs.append(0.0)
        return len(self.costs) - 1

    def _function(
        self, start: int, blocks: dict[int, Block]
    ) -> Iterator[tuple[int, list[int]]]:
        """Add the ways of a function; yield what it calls, with the ways to the calls."""
        ways = {
            (head, after): self._variable() for head, block in blocks.items()
            for after in [*block.after, *[None] * (block.ends or not block.after)]}
        into: dict[int | None, list[int]] = defaultdict(list)
        into[start].append(self.entry[start])
        for (_, after), way in ways.items():
            into[after].append(way)
        rows: dict[int, dict[int, float]] = {
            head: dict.fromkeys(into[head], 1.0) for head in blocks}
        for (before, _), way in ways.items():
            rows[before][way] = rows[before].get(way, 0.0) - 1.0
        self.equal += rows.values()
        for head, block in blocks.items():
            for way in into[head]:
                self.costs[way] += len(block.addresses)
            yield from ((called, into[head]) for called in block.calls)
        self._loops(start, blocks, ways, set(blocks), {way for way in ways if way[1] is not None})

    def _loops(
        self, start: int, blocks: dict[int, Block], ways: dict[Way, int],
        within: set[int], live: set[Way],
    ) -> None:
        """Bound the ways that repeat loops, those in them after them.

        A loop is entered at its heads; each repetition of the loop in the source passes each of
        them once at most.
        """
        for loop in cycles(within, live):
            entries = [way for way in ways if way[1] in loop and way[0] not in loop]
            heads = {head for _, head in entries} | loop & {start}
            back = {way for way in live if way[0] in loop and way[1] in heads}
            inner = {way for way in live - back if way[0] in loop and way[1] in loop}
            nested = set().union(*cycles(loop, inner))
            bound, kind = self._repetitions(start, blocks, back, loop - nested)
            self.repeated[kind] |= {ways[way] for way in back}
            for head in heads:
                row = {ways[way]: 1.0 for way in back if way[1] == head}
                row |= {ways[way]: -float(bound) for way in entries}
                if start in loop:
                    row[self.entry[start]] = -float(bound)
                self.most.append((row, 0.0))
            self._loops(start, blocks, ways, loop, inner)

    def _repetitions(
        self, start: int, blocks: dict[int, Block], back: set[Way], own: set[int]
    ) -> tuple[int, str]:
        """Return how often a loop is repeated at most, and what its repetitions count as.

        The source lines of its branches tell which loop it is.  If those are no lines of loops, it
        may be any of the loops in its own blocks, or else one around their lines.
        """
        name = self.code.name(start)
        if name.startswith('mem'):
            # It moves blocks of 16 bytes or more, then smaller ones: no object is greater.
            return (3 * self.sizes.m + self.sizes.columns) * 8 // 16 + 1, ''
        if name.startswith('__'):
            return DIVISION if 'div' in name else 0, ''
        lines = [self.lines.get(blocks[before].addresses[-1]) for before, _ in back]
        if None in lines:
            lines += [self.lines.get(place) for head in own for place in blocks[head].addresses]
        known = {line for line in lines if line} or {
            self.around[place] for head in own for place in blocks[head].addresses
            if place in self.around}
        text = ' '.join(each for _, each in known)
        kind = 'steps' if re.search('ATTEMPT : STEPS|number < CA_CHOOSE', text) else ''
        if 'pivot < limit' in text:
            kind = 'wide' if start in self.wide else 'pivots'
        return max(self.sizes.trips(*line) for line in known), kind

    def greatest(self, limits: dict[str, int], without: Sequence[str] = ()) -> float:
        """Return the most instructions with limits of `repeated`, without some functions."""
        most = self.most + [
            (dict.fromkeys(self.repeated[name], 1.0), limit) for name, limit in limits.items()]
        most += [({way: 1.0}, 0.0) for start, way in self.entry.items()
                 if self.code.name(start).startswith(tuple(without)) and without]
        right = np.zeros(len(self.equal))
        right[self.root] = 1.0
        found = linprog(
            -np.array(self.costs), matrix([row for row, _ in most], len(self.costs)),
            [limit for _, limit in most], matrix(self.equal, len(self.costs)), right,
            method='highs')
        if found.status:
            raise RuntimeError(found.message)
        return -float(found.fun)


def matrix(rows: Sequence[dict[int, float]], width: int) -> csr_matrix:
    """Return rows as a matrix."""
    entries = [(i, j, x) for i, row in enumerate(rows) for j, x in row.items()]
    i, j, x = zip(*entries, strict=True)
    return csr_matrix((x, (i, j)), (len(rows), width))


def cycles(nodes: set[int], ways: set[Way]) -> list[set[int]]:
    """Return the sets of nodes that ways lead from and to again: the outermost loops."""
    number = {node: i for i, node in enumerate(sorted(nodes))}
    within = [way for way in ways if way[0] in number and way[1] in number]
    if not within:
        return []
    ends = [(number[before], number[after]) for before, after in within]
    i, j = zip(*ends, strict=True)
    graph = csr_matrix((np.ones(len(i)), (i, j)), (len(nodes), len(nodes)))
    _, labels = connected_components(graph, connection='strong')
    found: dict[int, set[int]] = defaultdict(set)
    for node, k in number.items():
        found[labels[k]].add(node)
    repeated = {before for before, after in within if before == after}
    return [each for each in found.values() if len(each) > 1 or each & repeated]


def bounds_of(name: str) -> tuple[float, float]:
    """Return the bounds of a vehicle: without the second run in double precision, and with it."""
    vehicle = Vehicle.load(name)
    settings = checked(read(name)).allocation
    firmware = Firmware.make(faults_of(vehicle, ['single']), settings, 'single')
    bounds = Bounds.greatest(firmware)
    limits = {'steps': bounds.steps, 'pivots': bounds.pivots - bounds.wide, 'wide': bounds.wide}
    with tempfile.TemporaryDirectory() as folder:
        kernel = counted.build(VehicleProblem(vehicle), 'kernel', Path(folder), ['-g'])
        program = Program(Code(kernel, 'ca_allocate'), Sizes.of(firmware))
    once = program.greatest({**limits, 'wide': 0}, ['ca_serve_wide'])
    return once, program.greatest(limits)


def main() -> None:
    """Print the bounds of a vehicle."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('vehicle', nargs='?', default='hexarotor', help='shipped, or a file')
    options = parser.parse_args()
    if counted.missing():
        parser.error(f'not installed: {", ".join(counted.missing())}')
    once, twice = bounds_of(options.vehicle)
    print(f'{options.vehicle}: at most {once:,.0f} instructions in single precision alone, '
          f'{twice:,.0f} with the second run in double precision')


if __name__ == '__main__':
    main()
