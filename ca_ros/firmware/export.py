"""The files of an exported vehicle."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from string import Template

import numpy as np

from ca_ros import kernel
from ca_ros.allocation.slew import PERIOD_MAX
from ca_ros.arrays import Array
from ca_ros.firmware import golden, literals, throttles
from ca_ros.firmware.detector import write_detector
from ca_ros.firmware.firmware import Firmware
from ca_ros.firmware.footprint import measure
from ca_ros.firmware.readme import facts, words
from ca_ros.firmware.tilting import TiltingFirmware
from ca_ros.flight.failure_detector import FailureDetector
from ca_ros.problem.controllability import unit
from ca_ros.settings import ParameterError

KERNEL_FILES = (
    *('exact.h', 'problem.h', 'least_norm.h', 'priorities.h', 'numbers.h'),
    *('exact.c', 'least_norm.c', 'priorities.c'),
)
TILTING_FILES = (
    'vectored.h', 'problem.h', 'numbers.h', 'vectored.c', 'vectored_priorities.c',
)
DETECTOR_FILES = (
    '| `{name}_detector.h`, `{name}_detector.c`; `detector.h`, `detector.c`; `golden_flight.h`, '
    "`check_detector.c` | the detector of rotor failures: the vehicle's constants, the code, its "
    'check |\n'
)
FIXED = ('Makefile', 'check.c', 'startup.c', 'mps2.ld')
TEMPLATES = {
    'vehicle.h': '{name}.h', 'vehicle.c': '{name}.c', 'golden.h': 'golden.h',
    'vehicle.mk': 'vehicle.mk', 'README.md': 'README.md',
}
TILTING_TEMPLATES = {
    'tilting.h': '{name}.h', 'tilting.c': '{name}.c', 'golden.h': 'golden.h',
    'vehicle.mk': 'vehicle.mk', 'tilting.md': 'README.md',
}
HEADERS = ('errno', 'float', 'limits', 'math', 'stdio', 'stdlib', 'string', 'time')
TAKEN = {
    *('ca', 'golden', 'vehicle', *HEADERS),
    *(Path(file).stem for file in (*KERNEL_FILES, *TILTING_FILES, *FIXED)),
}
"""Names of other files and of C's headers."""


def identifier(name: str) -> str:
    """Return a vehicle's name as it is in C and in the names of files.

    Raises a ParameterError if it is not a name in C.
    """
    found = re.sub(r'\W+', '_', name, flags=re.ASCII).lower()
    if not re.match('[a-z]', found) or found in TAKEN:
        raise ParameterError(
            f'vehicle.name: expected a name that begins with a letter and is not one of '
            f'{", ".join(sorted(TAKEN))}, got {name!r}'
        )
    return found


def write(
    firmware: Firmware, name: str, out: Path, detector: FailureDetector | None = None
) -> None:
    """Write all files of a vehicle.

    Raises a ParameterError if the folder is not empty, or an OSError if it cannot be written to.

    - `name`: as `identifier` returns it
    - `out`: a folder; it is made if it is not there
    - `detector`: its files are written, too
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ParameterError(f'--out: {out} exists already and is not an empty folder')
    out.mkdir(parents=True, exist_ok=True)
    tilting = isinstance(firmware, TiltingFirmware)
    for file in TILTING_FILES if tilting else KERNEL_FILES:
        shutil.copyfile(Path(kernel.__file__).with_name(file), out / file)
    templates = Path(__file__).with_name('templates')
    for file in FIXED:
        shutil.copyfile(templates / file, out / file)
    fields = {'name': name, 'NAME': name.upper(), **_words(firmware, name)}
    fields |= _numbers(firmware, name)
    fields['measured'] = f'{name}_allocate{"_within" * (firmware.rates is not None)}'
    fields['detector'] = 'yes' if detector else ''
    fields['detector_files'] = DETECTOR_FILES.format(name=name) if detector else ''
    if detector:
        write_detector(detector, name, firmware.precision, out)
    core = 'Cortex-M4F' if firmware.single else 'Cortex-M7'
    for template, target in (TILTING_TEMPLATES if tilting else TEMPLATES).items():
        if template == 'README.md':
            fields |= facts(firmware, measure(out, fields['measured'], core), out)
        elif target == 'README.md':
            fields |= words(firmware)
        text = Template((templates / template).read_text(encoding='utf-8')).substitute(fields)
        (out / target.format(name=name)).write_text(text, encoding='utf-8')


def _numbers(firmware: Firmware, name: str) -> dict[str, str]:
    """Return the tables of the vehicle."""
    problem = firmware.problem
    rows = [row + [-1] * (len(problem.axes) - len(row)) for row in firmware.rows]

    def table(column: int, of: Sequence[tuple[Array, ...]] = firmware.rotors) -> str:
        values = [rotors[column] for rotors in of]
        precision = None if values[0].dtype.kind == 'i' else firmware.precision
        return '\n'.join(literals.indented(f'{literals.braced(v, precision)},', 1) for v in values)

    return {
        'n': str(firmware.columns), 'm': str(len(problem.axes)),
        'count': str(len(firmware.faults)),
        'problems': literals.problems(firmware),
        'axes': '\n'.join(f'    {literals.braced(row)},' for row in rows),
        'thrust_coefficient': table(0), 'reverse_coefficient': table(1), 'speed_min': table(2),
        'speed_max': table(3), 'curve': _curve(firmware, 'curve.c'),
        'speeds': _inverse(firmware), 'rates': '', 'rates_header': '', 'rates_golden': '',
        **_rates(firmware, name),
        'vectors': golden.vectors(firmware),
        **_command(firmware, name, table),
    }


def _command(firmware: Firmware, name: str, table: Callable[..., str]) -> dict[str, str]:
    """Return the fields that rotors that tilt and others have in a different way."""
    if not isinstance(firmware, TiltingFirmware):
        return {
            'commands': 'CA_N',
            'margin_function': f'#define MARGIN {name}_margin\n',
            'margin_field': '    ca_real margin;\n',
            'kernel': 'exact least_norm priorities',
            **throttles.filled(firmware, name),
        }
    tables = ('thrust_min', 'thrust_max', 'servos', 'angle_middle', 'angle_min', 'angle_max')
    return {
        'commands': f'{name.upper()}_COMMANDS', 'margin_function': '', 'margin_field': '',
        'throttles_golden': '', 'kernel': 'vectored vectored_priorities',
        'rotors': str(firmware.problem.vehicle.n),
        'angles': str(len(firmware.tilts.rotors)),
        **{each: table(k, firmware.servos) for k, each in enumerate(tables)},
    }


def _rates(firmware: Firmware, name: str) -> dict[str, str]:
    """Return the function within the rates of the rotors; nothing without rates."""
    if firmware.rates is None:
        return {}
    up, down = (literals.braced(rate, firmware.precision) for rate in firmware.rates)
    templates = Path(__file__).with_name('templates')
    names = {'name': name, 'NAME': name.upper()}

    def filled(file: str, **fields: str) -> str:
        return Template((templates / file).read_text(encoding='utf-8')).substitute(names | fields)

    return {
        'rates': filled(
            'rates.c', acceleration=up, deceleration=down, speeds=_inverse(firmware),
            narrow='ca_narrow' if firmware.curve.square else 'curve_narrow',
            curve_narrow=_curve(firmware, 'curve_narrow.c'),
        ).lstrip() + '\n',
        'rates_header': filled('rates.h', time=literals.real(PERIOD_MAX, firmware.precision)),
        'rates_golden': filled('rates_golden.h', sequence=golden.sequence(firmware)),
    }


def _inverse(firmware: Firmware) -> str:
    """Return the function from thrusts to speeds."""
    return 'ca_speeds' if firmware.curve.square else 'curve_speeds'


def _curve(firmware: Firmware, file: str) -> str:
    """Return the thrust curve with a function of a template; nothing without a curve."""
    if firmware.curve.square:
        return ''
    starts, levels, segments = firmware.segments
    rows = np.column_stack([starts, segments])

    def braced(values: Array) -> str:
        return literals.indented(literals.braced(values, firmware.precision), 1).strip()

    template = Path(__file__).with_name('templates') / file
    return '\n' + Template(template.read_text(encoding='utf-8')).substitute(
        segments='\n'.join(f'    {braced(row)},' for row in rows),
        levels=braced(levels), count=len(levels),
    )


def _words(firmware: Firmware, name: str) -> dict[str, str]:
    """Return the fields of the header and of vehicle.mk."""
    problem, single = firmware.problem, firmware.single
    # Priorities of vectors have problems of many sizes.
    fixed = firmware.columns == problem.n and all(
        fault.problem.axes == problem.axes for fault in firmware.faults)
    definitions = f'-DCA_N={firmware.columns} -DCA_M={len(problem.axes)}'
    definitions += ' -DCA_FIXED' * fixed + ' -DCA_FLOAT' * single
    faults = [
        f'    {name.upper()}_{fault.constant} = {i}, /* {fault.meaning}{_dropped(firmware, i)} */'
        for i, fault in enumerate(firmware.faults)
    ]
    wrench = [f' *         [{k}] {axis} [{unit(axis)}]' for k, axis in enumerate(problem.axes)]
    return {
        'definitions': definitions,
        'precision': (
            '#ifndef CA_FLOAT\n#define CA_FLOAT\n#endif'
            if single
            else '#ifdef CA_FLOAT\n#error "this vehicle was exported in double precision"\n#endif'
        ),
        'real': 'float' if single else 'double',
        'core': 'M4' if single else 'M7',
        'faults': '\n'.join(faults),
        'wrench': '\n'.join(wrench),
    }


def _dropped(firmware: Firmware, fault: int) -> str:
    kept = firmware.faults[fault].problem.axes
    lost = ', '.join(axis for axis in firmware.problem.axes if axis not in kept)
    return f'; not commanded: {lost}' if lost else ''
