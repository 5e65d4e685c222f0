"""The pages that scripts fill, and the vehicles that they are filled for."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from ca_ros.evaluation.tables import table
from ca_ros.vehicle.files import shipped_vehicles
from ca_ros.vehicle.vehicle import Vehicle

DOCS = Path(__file__).resolve().parents[1]


def filled(text: str, mark: str, content: str) -> str:
    """Return a page with the text between `<!-- MARK -->` and `<!-- end of MARK -->` replaced."""
    new, count = re.subn(
        rf'(<!-- {mark} -->\n).*?(<!-- end of {mark} -->)',
        lambda match: f'{match[1]}\n{content}\n\n{match[2]}', text, flags=re.DOTALL,
    )
    if count != 1:
        raise ValueError(f'expected one place that is marked for {mark}, got {count}')
    return new


def fill(name: str, **contents: str) -> None:
    """Replace the marked parts of a page; an underscore in a name stands for a blank."""
    page = DOCS / name
    text = page.read_text(encoding='utf-8')
    for mark, content in contents.items():
        text = filled(text, mark.replace('_', ' '), content)
    page.write_text(text, encoding='utf-8')


def telling(
    name: str, titles: Sequence[str], rows: Sequence[Sequence[str]],
    shown: Callable[[Sequence[str]], bool], words: int = 1,
) -> str:
    """Return the table of the rows that a page shows; write the table of all to `out/NAME.md`."""
    folder = DOCS.parent / 'out'
    folder.mkdir(exist_ok=True)
    whole = table(titles, rows, words=words)
    (folder / f'{name}.md').write_text(f'{whole}\n', encoding='utf-8')
    return table(titles, [row for row in rows if shown(row)], words=words)


def shipped(flying: bool = False) -> list[str]:
    """Return the names of the shipped vehicles; one in water does not fly, and has other gains."""
    names = shipped_vehicles()
    return [name for name in names if not (flying and Vehicle.load(name).buoyancy)]
