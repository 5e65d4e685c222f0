"""The report: studies and benchmark on one self-contained page of HTML."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ca_ros.arguments import HelpFormatter
from ca_ros.evaluation.report.chapters import KINDS, ChapterError, chapter
from ca_ros.evaluation.tables import render


def main(argv: Sequence[str] | None = None) -> int:
    """Write the report; return the exit code."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    try:
        chapters = [chapter(name, getattr(options, name)) for name in KINDS]
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(page(options.title, chapters), encoding='utf-8')
    except (ChapterError, OSError) as error:
        print(f'report: {error}', file=sys.stderr)
        return 1
    absent = [f'--{each["name"]}' for each in chapters if each['start'] is None]
    print(f'written: {options.out}' + (f' without {", ".join(absent)}' if absent else ''))
    return 0


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='report',
        description='Put the results of the studies and the benchmark on one page of HTML that '
        'contains all plots: it can be read without a network, and sent as a file.',
        epilog='SVG plots are preferred: make them with --figures svg.',
    )
    parser.formatter_class = HelpFormatter
    add = parser.add_argument
    for name, kind in KINDS.items():
        add(f'--{name}', type=Path, metavar='DIR', help=f'folder of the results of {kind.program}')
    add('--out', type=Path, default=Path('report.html'), metavar='FILE', help='the page')
    add('--title', default='Control allocation with ca_ros', help='title of the page')
    options = parser.parse_args(argv)
    if all(getattr(options, name) is None for name in KINDS):
        parser.error(f'nothing to report: give {" or ".join(f"--{name} DIR" for name in KINDS)}')
    return options


def page(title: str, chapters: Sequence[dict[str, Any]]) -> str:
    """Return the page of a report."""
    return render('page.html', title=title, chapters=chapters, version=version('ca_ros'))


if __name__ == '__main__':
    raise SystemExit(main())
