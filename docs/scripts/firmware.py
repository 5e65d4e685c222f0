"""Count the instructions of the exact allocator on an emulated microcontroller.

Fills the table of docs/firmware.md.  The kernel, the clipped pseudo-inverse and the code that OSQP
generates are compiled for a Cortex-M4F in single precision, and run by QEMU, which counts.  Needs
gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm, and takes a quarter of an hour,
most of it for OSQP.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from shutil import which

import numpy as np
from pages import DOCS, fill, telling

from ca_ros.arrays import Array
from ca_ros.detection.failure_detector import FailureDetector
from ca_ros.firmware import golden
from ca_ros.firmware.command import checked
from ca_ros.firmware.detector import STATES
from ca_ros.firmware.export import FILES, KERNEL, write, write_detector
from ca_ros.firmware.faults import faults_of
from ca_ros.firmware.firmware import Firmware
from ca_ros.firmware.footprint import measure
from ca_ros.firmware.tilting import firmware_of
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.studies.tables import table
from ca_ros.studies.wrench_sets import near_boundary
from ca_ros.vehicle.files import read
from ca_ros.vehicle.vehicle import Vehicle

sys.path.append(str(DOCS.parent))
from benchmarks.c_code import header, osqp_code

PROGRAM = Path(__file__).with_name('instructions.c')

VEHICLES = ('hexarotor', 'octorotor', 'hexarotor_tilted')
KINDS = ('inside', 'boundary', 'outside')
RATED = (*((name, 'single') for name in VEHICLES), ('hexarotor', 'double'),
         ('hexarotor_realistic', 'single'))
"""Vehicles with their precision, of the option --rates; the last has a thrust curve."""

METHODS = {
    'clipped_pinv': 'clipped pseudo-inverse', 'kernel': 'kernel of `exact`',
    'osqp': "OSQP's generated code",
}
CLOCK = 168e6  # of a flight controller with an STM32F4 [Hz]

COMPILER, EMULATOR = 'arm-none-eabi-gcc', 'qemu-system-arm'
TOOLS = COMPILER, EMULATOR

OPTIMIZATION = '-O3', '-fno-math-errno', '-finline-limit=2000'  # as exported firmware, for all
CORE = '-mcpu=cortex-m4', '-mthumb', '-mfloat-abi=hard', '-mfpu=fpv4-sp-d16'
BOARDS = {
    'single': (CORE, 'mps2-an386'),
    'double': (('-mcpu=cortex-m7', *CORE[1:3], '-mfpu=fpv5-d16'), 'mps2-an500'),
}
"""Options for the core, and the board of QEMU that has it."""

FLAGS_OF_USERS = (
    'gcc -Os -funsafe-math-optimizations -fno-math-errno',
    'gcc -Ofast -ffast-math -flto -fsingle-precision-constant',
    'clang -O3 -ffast-math',
)
"""Compilers and flags as in PX4 and in Betaflight, for the option --flags."""

MEMORY = {'mps2-an386': '0x21000000', 'mps2-an500': '0x60000000'}  # of a board, for the wrenches

FLAGS = [
    *('-std=c99', *OPTIMIZATION, '-ffp-contract=off', *CORE, '-nostartfiles'),
    '-Wl,--entry=0,--section-start=.vectors=0,-Ttext=0x100,-Tdata=0x20000000',
]

EMULATION = [
    *('-nographic', '-monitor', 'none', '-serial', 'none'),
    *('-icount', 'shift=6,sleep=off', '-semihosting-config', 'enable=on,target=native'),
]


def missing() -> list[str]:
    """Return the tools that are not installed."""
    return [tool for tool in TOOLS if which(tool) is None]


def wrenches(problem: AllocationProblem, kind: str, size: int, seed: int = 0) -> Array:
    """Draw wrenches (size, m): inside by volume, at the boundary, outside up to thrice as far."""
    admissible, rng = AdmissibleSet(problem), np.random.default_rng(seed)
    if kind == 'boundary':
        return near_boundary(admissible, rng, size).astype(np.float32)
    drawn = admissible.sample(rng, size)
    if kind == 'outside':
        shares = rng.uniform(1.0, 3.0, size) / problem.attainable_set.gauge(drawn)
        drawn = problem.center + (drawn - problem.center) * shares[:, None]
    return drawn.astype(np.float32)


def given(problem: AllocationProblem, folder: Path) -> list[str]:
    """Write the numbers of a problem; return the definitions and folders for the compiler."""
    numbers = header(problem, 'single', 'static const __attribute__((unused))')
    (folder / 'data.h').write_text(numbers, encoding='utf-8')
    sizes = [f'-DCA_N={problem.n}', f'-DCA_M={len(problem.axes)}']
    return [f'-I{folder}', f'-I{DOCS.parent / "benchmarks"}', *sizes]


def compiled(target: Path, *parts: object) -> Path:
    """Compile parts, sources and options, to a file, and return it."""
    command = [COMPILER, *FLAGS, *parts, '-lm', '-o', target]
    subprocess.check_call(list(map(str, command)))
    return target


def build(
    problem: AllocationProblem, method: str, folder: Path, options: Sequence[str] = ()
) -> Path:
    """Compile a method for a vehicle, with more options for the compiler; return the program."""
    parts = [*given(problem, folder), *options]
    if method == 'kernel':
        parts += ['-DCOUNT_KERNEL', '-DCA_FLOAT', '-DCA_FIXED', f'-I{KERNEL}']
        parts += [
            compiled(folder / f'{source}.o', *parts, '-c', KERNEL / source)
            for source in FILES['exact']['sources']
        ]
    elif method == 'osqp':
        parts += ['-DWITH_OSQP', *osqp_code(problem, folder / 'osqp', use_float=True)]
    return compiled(folder / f'{method}.elf', PROGRAM, *parts)


def run(program: Path, drawn: Array, board: str = BOARDS['single'][1]) -> Array:
    """Run a program for wrenches (size, m); return instructions and status (size, 2)."""
    load = program.with_suffix('.wrenches')
    load.write_bytes(np.array([len(drawn), 0], np.uint32).tobytes() + drawn.tobytes())
    device = f'loader,file={load},addr={MEMORY[board]},force-raw=on'
    command = [EMULATOR, '-M', board, *EMULATION, '-device', device, '-kernel', str(program)]
    printed = subprocess.check_output(command, stderr=subprocess.STDOUT, text=True)
    fault, *lines = printed.splitlines()
    if fault != '0' or len(lines) != len(drawn):
        raise RuntimeError(f'{program.name}: {printed[:200]!r}')
    return np.array([line.split() for line in lines], dtype=np.int64)


def count(
    problem: AllocationProblem, methods: Sequence[str], size: int
) -> dict[tuple[str, str], Array]:
    """Return the instructions (size,) of each call, by method and kind of wrenches."""
    counts = {}
    with tempfile.TemporaryDirectory() as folder:
        for method in methods:
            program = build(problem, method, Path(folder))
            for kind in KINDS:
                counts[method, kind] = run(program, wrenches(problem, kind, size))
    return counts


def count_detector(vehicle: Vehicle) -> Array:
    """Return the instructions of each step of the golden flight, and whether rotor 1 is lost."""
    problem = VehicleProblem(vehicle)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = [*given(problem, folder), f'-I{KERNEL}', '-DCA_FLOAT', '-DCOUNT_DETECTOR']
        (folder / 'vehicle.h').write_text('', encoding='utf-8')
        detector = FailureDetector(vehicle, motor_time_constant=0.0)
        write_detector(detector, 'vehicle', 'single', folder)
        sources = PROGRAM, folder / 'detector.c', folder / 'vehicle_detector.c'
        program = compiled(folder / 'detector.elf', *parts, *sources)
        return run(program, np.zeros((STATES, len(problem.axes)), np.float32))


def count_rates(name: str, precision: str, size: int = 400, steps: int = 40) -> list[Array]:
    """Return the instructions (N,) of an exported vehicle's calls, without rates and with them.

    The wrenches lead from one of `size` random wrenches to the next, a quarter of them outside.
    The rates are those of the vehicle's file, or 3000 rad/s^2.
    """
    given = {'rotors.acceleration_max': 3000.0, **read(name)}
    faults = faults_of(Vehicle.from_parameters(given), ['none'])
    problem, rng = faults[0].problem, np.random.default_rng(0)
    parts = {'inside': size * 3 // 4, 'outside': size // 4}
    ends = np.vstack([wrenches(problem, kind, count, 3) for kind, count in parts.items()])
    rng.shuffle(ends)
    shares = np.linspace(0.0, 1.0, steps, endpoint=False)[:, None]
    drawn = np.vstack([a + (b - a) * shares for a, b in pairwise(ends)])
    firmware = firmware_of(faults, checked(given).allocation, precision)
    core, board = BOARDS[precision]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / 'counted'
        write(firmware, 'counted', folder)
        make = 'make', '-s', '-C', folder, 'CROSS=arm-none-eabi-', f'CPU={" ".join(core)}'
        subprocess.check_call([*make, 'BUILD=made', 'made/libcounted.a'])
        found = []
        for within in (0, 1):
            parts = f'-I{folder}', f'-DCOUNT_EXPORTED={within}', f'-DMEMORY={MEMORY[board]}u'
            sources = PROGRAM, folder / 'made' / 'libcounted.a'
            program = compiled(folder / f'counted{within}.elf', *core, *parts, *sources)
            found.append(run(program, drawn.astype(firmware.dtype), board)[:, 0])
        return found


def memory(name: str, precision: str) -> tuple[str, ...]:
    """Return the row of a vehicle in the table of flash and stack."""
    given = read(name)
    faults = faults_of(Vehicle.from_parameters(given), ['single'])
    firmware = firmware_of(faults, checked(given).allocation, precision)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / 'measured'
        write(firmware, 'measured', folder)
        function = f'measured_allocate{"_within" * (firmware.rates is not None)}'
        found = measure(folder, function, 'of the precision')
    if isinstance(found, str):
        raise RuntimeError(f'{name}, {precision}: {found}')
    size = f'{firmware.problem.n}, {len(firmware.problem.axes)}, {len(firmware.faults) - 1}'
    print(f'{name}, {precision}: {found}', flush=True)
    return f'`{name}`', size, precision, str(found.flash), str(found.stack)


def answers(firmware: Firmware, flags: Sequence[str], faults: Array, drawn: Array) -> Array:
    """Return the status and the speeds of exported firmware for wrenches (N, m), as records.

    It is compiled for this machine: flags[0] is the compiler.
    """
    numbers, m, n = firmware.dtype, drawn.shape[1], firmware.problem.n
    record = np.dtype([('fault', np.int32), ('wrench', numbers, m)], align=True)
    given = np.zeros(len(drawn), record)
    given['fault'], given['wrench'] = faults, drawn
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / 'counted'
        write(firmware, 'counted', folder)
        checks = 'check.c', 'startup.c', 'worst_case.c'
        sources = [each for each in folder.glob('*.c') if each.name not in checks]
        names = '-DVEHICLE="counted.h"', '-DALLOCATE=counted_allocate', f'-I{folder}'
        program = folder / 'answers'
        driver = PROGRAM.with_name('answers.c')
        subprocess.check_call([*flags, *names, driver, *sources, '-lm', '-o', program])
        printed = subprocess.check_output([program], input=given.tobytes())
    return np.frombuffer(printed, np.dtype(
        [('status', np.int32), ('speeds', numbers, n)], align=True))


def compare_flags(name: str, flags: Sequence[str], size: int) -> tuple[float, float, float, int]:
    """Return how the answers of exported firmware differ from those to the last bit.

    The share of the answers that have other bits, the greatest differences of a thrust [N] for
    attainable and for other wrenches, and the number of other statuses.  Raises a RuntimeError if
    an answer breaks a promise: speeds out of bounds, or an EXACT wrench that is missed.
    """
    vehicle = Vehicle.load(name)
    settings = checked(read(name)).allocation
    firmware = firmware_of(faults_of(vehicle, ['single']), settings, 'single')
    special = golden.special(firmware)
    rows = [
        np.vstack([golden.wrenches(firmware, fault, size, 5), special])
        for fault in range(len(firmware.faults))
    ]
    faults, drawn = np.repeat(np.arange(len(rows)), len(rows[0])), np.vstack(rows)
    found = answers(firmware, flags, faults, drawn)
    apart, others, gaps = 0, 0, [0.0, 0.0]
    for fault, u, (status, speeds) in zip(faults, drawn, found, strict=True):
        wanted, exact = firmware.allocate(fault, u)
        k_f, reverse, least, greatest = firmware.rotors[fault]
        thrusts = firmware.thrusts_at(speeds, k_f, reverse).astype(float)
        commanded = firmware.rows[fault]
        demand = u[commanded].astype(float)
        missed = np.linalg.norm(firmware.problem.gamma[commanded] @ thrusts - demand)
        wide = missed > 5e-5 * max(1.0, float(np.linalg.norm(demand)))
        if not np.all((least <= speeds) & (speeds <= greatest)) or (status == 0 and wide):
            raise RuntimeError(f'{name}, fault {fault}: {u} gets {speeds} with status {status}')
        apart += speeds.tobytes() != exact.tobytes() or status != wanted
        others += status != wanted
        gap = np.abs(thrusts - firmware.thrusts_at(exact, k_f, reverse)).max()
        kind = int(status != 0)
        gaps[kind] = max(gaps[kind], float(gap))
    return apart / len(drawn), *gaps, others


def rows_of(name: str, counts: dict[tuple[str, str], Array]) -> list[tuple[str, ...]]:
    """Return the rows of the table for a vehicle."""
    rows = []
    base = counts['clipped_pinv', KINDS[0]][0, 0]
    for (method, kind), found in counts.items():
        # Each call of the pseudo-inverse takes the same instructions.
        drawn = 'all' if method == 'clipped_pinv' else kind
        if drawn == 'all' and kind != KINDS[0]:
            continue
        median, worst = float(np.median(found[:, 0])), int(found[:, 0].max())
        rows.append((
            f'`{name}`', METHODS[method], drawn, f'{median:,.0f}', f'{worst:,.0f}',
            f'{worst / base:,.1f}', f'{1e3 * worst / CLOCK:.3g}',
        ))
    return rows


def main() -> None:
    """Count, and fill the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add('--size', type=int, default=10_000, help='wrenches of each kind')
    add('--detector', action='store_true', help='count the detector of failures alone')
    add('--memory', action='store_true', help='measure flash and stack alone; fill their table')
    add('--rates', action='store_true', help='count calls within the rates of the rotors alone')
    add('--flags', action='store_true', help='compare the answers of other flags of compilers')
    options = parser.parse_args()
    for words in FLAGS_OF_USERS if options.flags else ():
        for name in VEHICLES:
            share, exact, others, changed = compare_flags(name, words.split(), options.size)
            print(f'{name}, {words}: {share:.1%} have other bits; thrusts differ by at most '
                  f'{exact:.1e} N where attainable, {others:.1e} N elsewhere; {changed} other '
                  f'statuses', flush=True)
    if options.flags:
        return
    if missing():
        parser.error(f'not installed: {", ".join(missing())}')
    for name in VEHICLES if options.detector else ():
        steps = count_detector(Vehicle.load(name))[1:, 0]
        print(f'{name}: {np.median(steps):.0f} instructions in the median, {steps.max()} at most')
    for name, precision in RATED if options.rates else ():
        counts = count_rates(name, precision)
        for word, of in (('in the median', np.median), ('at most', np.max)):
            without, within = (float(of(each)) for each in counts)
            ratio = f'{within:.0f} ({within / without:.2f})'
            print(f'{name}, {precision}: {without:.0f} {word}, with rates {ratio}', flush=True)
    if options.memory:
        titles = 'vehicle', 'rotors, axes, faults', 'precision', 'flash [bytes]', 'stack [bytes]'
        rows = [memory(*each) for each in (*RATED[:-1], ('x8', 'single'))]
        fill('firmware.md', memory=table(titles, rows, 3))
    if options.detector or options.rates or options.memory:
        return
    rows = []
    for name in VEHICLES:
        problem = VehicleProblem(Vehicle.load(name))
        rows += rows_of(name, count(problem, tuple(METHODS), options.size))
    titles = (
        *('vehicle', 'method', 'wrenches', 'median', 'worst', 'worst, in pseudo-inverses'),
        'worst, at least [ms]',
    )
    shown = telling('instructions', titles, rows, lambda row: row[0] == f'`{VEHICLES[0]}`', 3)
    gcc, qemu = (
        re.search(r'\d+\.\d+\.\d+', re.sub(r'\(.*?\)', '', text, count=1))[0]
        for text in (subprocess.check_output([tool, '--version'], text=True) for tool in TOOLS)
    )
    words = (
        f'{options.size:,} wrenches of each kind; GCC {gcc}, all with '
        f'`{" ".join(OPTIMIZATION)}`; QEMU {qemu}; OSQP {version("osqp")}. The times are lower '
        f'bounds: at {CLOCK / 1e6:.0f} MHz, one instruction a cycle, no wait for the flash.'
    )
    fill('firmware.md', instructions=f'{shown}\n\n{words}')


if __name__ == '__main__':
    main()
