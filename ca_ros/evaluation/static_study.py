"""The static study: the methods on random wrenches of the admissible set, as in Table 1."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial

from ca_ros.arguments import split
from ca_ros.evaluation.cases import Case, natural, parser, positive
from ca_ros.evaluation.evaluation import AnswerError
from ca_ros.evaluation.interrupts import interrupts
from ca_ros.evaluation.sampling import SAMPLINGS
from ca_ros.evaluation.static_report import table
from ca_ros.evaluation.static_run import SINGLE_MAX, Study


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    try:
        case = Case.load(options.vehicle, options.param)
        study = Study(
            case,
            case.allocators(options.methods),
            options.samples,
            options.seed,
            options.sampling,
        )
        options.out.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as error:
        print(f'static_study: {error}', file=sys.stderr)
        return 1
    with interrupts() as stop:
        # An error in a method of the user's own is to be seen whole.
        try:
            study.run(options.out, stop)
            files = study.write(options.out, options.figures) if study.done else []
        except (AnswerError, OSError) as error:
            print(f'static_study: {error}', file=sys.stderr)
            return 1
    if study.done:
        print(table(study.figures()))
        print('written:', ', '.join(map(str, files)))
    if study.done < study.total:
        print(
            f'static_study: interrupted after {study.done} of {study.total} samples'
            + (', which are written' if study.done else ''),
            file=sys.stderr,
        )
        return 128 + stop[0]
    return 0


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'static_study',
        'Allocate random wrenches of the admissible set by each method: static.csv, static.json, '
        'static.md and figures.',
    )
    made.add_argument(
        '--samples',
        type=partial(positive, int),
        default=1000,
        metavar='N',
        help=f'number of wrenches; of more than {SINGLE_MAX}, batches are timed, not calls',
    )
    made.add_argument('--seed', type=natural, default=0, help='same seed, same wrenches')
    made.add_argument(
        '--sampling',
        choices=SAMPLINGS,
        default='volume',
        help='volume: uniform in the admissible set; thrusts: uniform in the bounds of the '
        'thrusts; boundary: pushed out to the boundary of the set',
    )
    return made.parse_args(split(argv)[0])


if __name__ == '__main__':
    raise SystemExit(main())
