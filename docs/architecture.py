"""Write the tree of the package, and what its rooms import, into docs/architecture.md.

With --check nothing is written; the exit code says whether the page is up to date.
"""

import ast
import sys
from pathlib import Path

from marks import filled

DOCS = Path(__file__).resolve().parent
PAGE, PACKAGE = DOCS / 'architecture.md', DOCS.parent / 'ca_ros'

WAY = (
    'vehicle', 'solver', 'kernel', 'problem', 'allocation', 'flight', 'nodes', 'bringup',
    'evaluation',
)
"""Rooms in the order in which they import each other; a room that is not here comes last."""


def summary(file: Path) -> str:
    """Return the first line of a module's docstring, without its full stop."""
    if file.suffix != '.py':
        first = file.read_text(encoding='utf-8').partition('\n')[0]
        return first.removeprefix('/* ').removesuffix(' */').removesuffix('.')
    text = ast.get_docstring(ast.parse(file.read_text(encoding='utf-8'))) or ''
    return text.partition('\n')[0].removesuffix('.')


def lines(folder: Path, depth: int = 0) -> list[str]:
    """Return one line for a folder and one for each module in it."""
    indent = '  ' * depth
    found = [f'{indent}{folder.name + "/":{28 - len(indent)}} {summary(folder / "__init__.py")}']
    for file in sorted([*folder.glob('*.py'), *folder.glob('*.[ch]')]):
        if file.name != '__init__.py':
            found.append(f'{indent}  {file.name:{26 - len(indent)}} {summary(file)}')
    rooms = [each for each in folder.iterdir() if (each / '__init__.py').exists()]
    for room in sorted(rooms, key=lambda each: (place(each.name), each.name)):
        found += lines(room, depth + 1)
    return found


def place(name: str) -> int:
    """Return where a room stands."""
    return WAY.index(name) if name in WAY else len(WAY)


def imports(room: str) -> set[str]:
    """Return the other rooms that a room imports."""
    found = set()
    for file in (PACKAGE / room).rglob('*.py'):
        for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
            if not isinstance(node, (ast.Import, ast.ImportFrom)):
                continue
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                names = [f'{node.module}.{name}' for name in names]
            parts = [name.split('.') for name in names]
            found |= {part[1] for part in parts if part[0] == PACKAGE.name and len(part) > 1}
    rooms = {file.parent.name for file in PACKAGE.glob('*/__init__.py')}
    return (found & rooms) - {room}


def drawing() -> list[str]:
    """Return a table: a row for each room, a cross for each room that it imports."""
    rooms = sorted(
        (file.parent.name for file in PACKAGE.glob('*/__init__.py')),
        key=lambda name: (place(name), name),
    )
    head = ' '.join(f'{room:^{len(room)}}' for room in rooms)
    rows = []
    for room in rooms:
        marks = ('x' if other in imports(room) else '.' for other in rooms)
        row = ' '.join(f'{m:^{len(other)}}' for m, other in zip(marks, rooms, strict=True))
        rows.append(f'{room:12} {row}')
    return [f'{"imports":12} {head}', *rows]


def fresh(text: str) -> str:
    """Return the page with its generated parts replaced."""
    for mark, content in (('tree', lines(PACKAGE)), ('imports', drawing())):
        block = '\n'.join(line.rstrip() for line in content)
        text = filled(text, mark, f'```text\n{block}\n```')
    return text


def main() -> None:
    """Write the page, or check it."""
    old = PAGE.read_text(encoding='utf-8')
    new = fresh(old)
    if sys.argv[1:] == ['--check']:
        sys.exit(None if new == old else f'{PAGE.name} is not up to date: run make readme')
    PAGE.write_text(new, encoding='utf-8')


if __name__ == '__main__':
    main()
