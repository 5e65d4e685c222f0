"""The files of an exported vehicle."""

import json
import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from ca_ros import kernel
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.rates import PERIOD_MAX
from ca_ros.detection.failure_detector import FailureDetector, model_of
from ca_ros.firmware import golden, literals, throttles
from ca_ros.firmware.detector import golden_flight
from ca_ros.firmware.firmware import DTYPES, LIMIT, Firmware
from ca_ros.firmware.footprint import instructions, measure
from ca_ros.firmware.worst_case import Bounds, Worst
from ca_ros.settings import ParameterError
from ca_ros.vehicle.settings import unit

KERNEL = Path(kernel.__file__).parent
FILES = json.loads((KERNEL / 'files.json').read_text(encoding='utf-8'))
FIXED = ('Makefile', 'check.c', 'startup.c', 'mps2.ld')
GENERATED = ('configuration.h', 'golden.h', 'vehicle.mk', 'worst_case.c')
HEADERS = ('errno', 'float', 'limits', 'math', 'stdint', 'stdio', 'stdlib', 'string', 'time')
TAKEN = {
    *('ca', *HEADERS),
    *(Path(file).stem for file in (*FIXED, *GENERATED)),
    *(Path(file).stem for kind in FILES.values() for files in kind.values() for file in files),
}
"""Names of other files and of C's headers."""

SAMPLE = 3333  # number of wrenches of each kind and fault for which steps are counted

UNATTAINABLE = {
    'prioritize': 'is served in the order of priorities: {order} (`CA_PRIORITIZED`, with\n'
    '`allocation.exact.axis_reversal: {deviation}`)',
    'scale': 'is scaled towards hover until it is attainable (`CA_SCALED`)',
    'reject': 'is rejected: all rotors get the speed nearest to zero (`CA_REJECTED`)',
}
"""What becomes of an unattainable wrench, by policy."""


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
    firmware: Firmware, name: str, out: Path, detector: FailureDetector | None = None,
    worst: Worst | None = None,
) -> None:
    """Write all files of a vehicle.

    Raises a ParameterError if the folder is not empty, or an OSError if it cannot be written to.

    - `name`: as `identifier` returns it
    - `out`: a folder; it is made if it is not there
    - `detector`: its files are written, too
    - `worst`: the worst wrenches found, which `make worst` allocates
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ParameterError(f'--out: {out} exists already and is not an empty folder')
    out.mkdir(parents=True, exist_ok=True)
    if detector:
        write_detector(detector, name, firmware.precision, out)
    kind, tilting = firmware.template, not firmware.has_margin
    problem, exact, single = firmware.problem, firmware.settings.exact, firmware.single
    library = FILES[problem.program.kernel]
    _copy(KERNEL, [*library['headers'], *library['sources']], out)
    _copy(Path(__file__).with_name('templates'), FIXED, out)
    measured = f'{name}_allocate{"_within" * (firmware.rates is not None)}'
    core = 'Cortex-M4F' if single else 'Cortex-M7'
    targets = {
        'configuration.h': 'configuration.h', f'{kind}.h': f'{name}.h',
        f'{kind}.c': f'{name}.c', 'golden.h': 'golden.h',
        'vehicle.mk': 'vehicle.mk', **({'worst_case.c': 'worst_case.c'} if worst else {}),
        f'{kind}.md': 'README.md',
    }
    _fill(
        targets, name, firmware.precision, out, firmware=firmware, axes=problem.axes,
        sources=library['sources'], detector=detector, tilting=tilting,
        commanded=[row + [-1] * (len(problem.axes) - len(row)) for row in firmware.rows],
        measured=measured, footprint=partial(measure, out, measured, core),
        worst=worst, instructions=partial(instructions, out),
        bound=None if tilting else Bounds.greatest(firmware),
        bounds=partial(loop_bounds, out), problems=literals.problems(firmware),
        real='float' if single else 'double',
        hover=[f'{float(f"{each:.6g}")}{"f" * single}' for each in problem.reference],
        unattainable=unattainable(exact, problem.axes), absurd=LIMIT[firmware.precision],
        has_throttles=not tilting and throttles.has_throttles(firmware.curve),
        throttles=throttles, golden=golden, sample=SAMPLE, period_max=PERIOD_MAX,
    )


def write_detector(detector: FailureDetector, name: str, precision: str, out: Path) -> None:
    """Write the files of the detector beside those of the vehicle.

    Raises
    ------
    ParameterError
        If the extension module is not built.
    OSError
    """
    _copy(KERNEL, [*FILES['detector']['headers'], *FILES['detector']['sources']], out)
    _copy(Path(__file__).with_name('templates'), ['check_detector.c'], out)
    model = {
        key: np.asarray(each, DTYPES[precision]).astype(float)
        for key, each in model_of(detector).items()
    }
    targets = {
        'detector_constants.h': f'{name}_detector.h',
        'detector_constants.c': f'{name}_detector.c', 'golden_flight.h': 'golden_flight.h',
    }
    _fill(
        targets, name, precision, out, model=literals.fields(model, precision),
        flight=golden_flight(detector, precision),
    )


def unattainable(settings: ExactSettings, axes: Sequence[str]) -> str:
    """Return how a wrench that is not attainable is served."""
    order = '; '.join(' and '.join(group) for group in settings.groups(axes))
    return UNATTAINABLE[settings.policy].format(order=order, deviation=settings.axis_reversal)


def loop_bounds(folder: Path) -> list[tuple[str, str, str, str]]:
    """Return the constants that bound the iterations of the kernel: name, value, comment, file."""
    found = []
    for file in ('least_norm.c', 'priorities.c'):
        text = (folder / file).read_text(encoding='utf-8')
        for comment, block in re.findall(r'/\* ([^/]*?) \*/\n((?:#define .*\n)+)', text):
            words = ' '.join(word for word in comment.split() if word != '*')
            for constant, value in re.findall(r'^#define ([A-Z_]+) (\d+)$', block, re.MULTILINE):
                found.append((constant, value, words, file))
    return found


def _copy(folder: Path, files: Iterable[str], out: Path) -> None:
    for file in files:
        shutil.copyfile(folder / file, out / file)


def _fill(
    targets: Mapping[str, str], name: str, precision: str, out: Path, **values: Any
) -> None:
    """Write templates, in their order, to their targets."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader('ca_ros.firmware'), undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True,
    )
    environment.filters |= {
        'literal': partial(literals.literal, precision=precision), 'indented': literals.indented,
        'rows': partial(literals.rows, precision=precision), 'unit': unit,
    }
    environment.globals |= {'name': name, 'NAME': name.upper(), 'zip': zip}
    for template, target in targets.items():
        text = environment.get_template(template).render(values)
        (out / target).write_text(text, encoding='utf-8')
