"""Write the tree of the package into docs/architecture.md: one line a file, from its docstring.

With --check nothing is written; the exit code says whether the page is up to date.
"""

import ast
import re
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PAGE, PACKAGE = DOCS / 'architecture.md', DOCS.parent / 'ca_ros'

WAY = ('vehicle', 'solver', 'problem', 'allocation', 'flight', 'nodes', 'bringup', 'evaluation')
"""Rooms in the order in which they import each other; a room that is not here comes last."""


def summary(file: Path) -> str:
    """Return the first line of a module's docstring, without its full stop."""
    text = ast.get_docstring(ast.parse(file.read_text(encoding='utf-8'))) or ''
    return text.partition('\n')[0].removesuffix('.')


def lines(folder: Path, depth: int = 0) -> list[str]:
    """Return one line for a folder and one for each module in it."""
    indent = '  ' * depth
    found = [f'{indent}{folder.name + "/":{28 - len(indent)}} {summary(folder / "__init__.py")}']
    for file in sorted(folder.glob('*.py')):
        if file.name != '__init__.py':
            found.append(f'{indent}  {file.name:{26 - len(indent)}} {summary(file)}')
    rooms = [each for each in folder.iterdir() if (each / '__init__.py').exists()]
    for room in sorted(rooms, key=lambda each: (place(each.name), each.name)):
        found += lines(room, depth + 1)
    return found


def place(name: str) -> int:
    """Return where a room stands."""
    return WAY.index(name) if name in WAY else len(WAY)


def fresh(text: str) -> str:
    """Return the page with its tree replaced."""
    tree = '\n'.join(line.rstrip() for line in lines(PACKAGE))
    new, count = re.subn(
        r'(<!-- tree -->\n).*?(<!-- end of tree -->)',
        lambda found: f'{found[1]}\n```text\n{tree}\n```\n\n{found[2]}',
        text,
        flags=re.DOTALL,
    )
    if count != 1:
        raise ValueError(f'expected one place that is marked for the tree, got {count}')
    return new


def main() -> None:
    """Write the page, or check it."""
    old = PAGE.read_text(encoding='utf-8')
    new = fresh(old)
    if sys.argv[1:] == ['--check']:
        sys.exit(None if new == old else f'{PAGE.name} is not up to date: run make readme')
    PAGE.write_text(new, encoding='utf-8')


if __name__ == '__main__':
    main()
