"""Fill the tables of docs/simulators.md and docs/comparison.md, and their figure.

They are those of ``python examples/rotorpy/study.py --out out/rotorpy``.
"""

import shutil

from pages import DOCS, fill

FOLDER = DOCS.parent / 'out' / 'rotorpy'


def run() -> None:
    """Fill the pages."""
    head, *parts = (FOLDER / 'study.md').read_text(encoding='utf-8').split('\n## ')
    found = {title: table.strip() for title, _, table in (part.partition('\n') for part in parts)}
    fill('simulators.md', rotorpy_by_condition=f'{head.strip()}\n\n{found["By condition"]}',
         rotorpy_by_method=found['By method'])
    fill('comparison.md', rotorpy_by_method=found['By method'])
    shutil.copy(FOLDER / 'study.png', DOCS / 'rotorpy.png')


if __name__ == '__main__':
    run()
