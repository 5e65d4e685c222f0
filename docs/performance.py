"""Copy the tables of a full benchmark into docs/performance.md, and a few rows into README."""

import json
import shutil
import sys
from pathlib import Path

from marks import filled

DOCS = Path(__file__).resolve().parent
README, PAGE, FIGURE = DOCS.parent / 'README.md', DOCS / 'performance.md', DOCS / 'benchmark.png'
SHOWN, COLUMNS = ('`clipped_pinv`', '`exact`', '`daqp_reused`', '`osqp`'), 7
"""Rows and number of columns of the table of times that README shows."""


def summary(body: str) -> str:
    """Return a few rows of the table of times per call."""
    section = body.partition('## Times per call')[2].partition('\n## ')[0]
    table = [line.split('|')[1:-1] for line in section.splitlines() if line.startswith('|')]
    rows = [*table[:2], *(row for row in table[2:] if row[0].strip() in SHOWN)]
    return '\n'.join(f'|{"|".join(row[:COLUMNS])}|' for row in rows)


def main(folder: Path) -> None:
    """Take benchmark.json, benchmark.md and benchmark.png from a folder."""
    if json.loads((folder / 'benchmark.json').read_text(encoding='utf-8'))['settings']['quick']:
        sys.exit(f'{folder}: has a quick benchmark; the pages need a full one')
    report = (folder / 'benchmark.md').read_text(encoding='utf-8').strip()
    body = report.partition('\n')[2].strip()
    pages = {
        README: summary(body),
        PAGE: f'![Times per call, and against the number of rotors]({FIGURE.name})\n\n{body}',
    }
    texts = {
        page: filled(
            page.read_text(encoding='utf-8'), 'benchmark', content.strip().replace('## ', '### ')
        )
        for page, content in pages.items()
    }
    shutil.copyfile(folder / 'benchmark.png', FIGURE)
    for page, text in texts.items():
        page.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main(Path(sys.argv[1] if len(sys.argv) > 1 else 'out/benchmark'))
