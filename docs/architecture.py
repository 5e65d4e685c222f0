"""Write the tree of the package and the imports of its subpackages into docs/architecture.md.

With --check nothing is written, and the exit code is 1 if the page is not up to date.
"""

import ast
import sys
from pathlib import Path

from marks import filled

DOCS = Path(__file__).resolve().parent
PAGE, PACKAGE = DOCS / 'architecture.md', DOCS.parent / 'ca_ros'

ORDER = (
    'vehicle', 'solver', 'kernel', 'problem', 'allocation', 'firmware', 'flight', 'nodes',
    'bringup', 'evaluation', 'testing',
)
"""The subpackages, each after those that it imports; others come last."""


def summary(file: Path) -> str:
    """Return the first line of a module's docstring, without its full stop."""
    if file.suffix != '.py':
        first = file.read_text(encoding='utf-8').partition('\n')[0]
        return first.removeprefix('/* ').removesuffix(' */').removesuffix('.')
    text = ast.get_docstring(ast.parse(file.read_text(encoding='utf-8'))) or ''
    return text.partition('\n')[0].removesuffix('.')


def lines(folder: Path, depth: int = 0) -> list[str]:
    """Return the tree of a folder: one line for each folder and module."""
    indent = '  ' * depth
    found = [f'{indent}{folder.name + "/":{28 - len(indent)}} {summary(folder / "__init__.py")}']
    for file in sorted([*folder.glob('*.py'), *folder.glob('*.[ch]')]):
        if file.name != '__init__.py':
            found.append(f'{indent}  {file.name:{26 - len(indent)}} {summary(file)}')
    inner = [each for each in folder.iterdir() if (each / '__init__.py').exists()]
    for each in sorted(inner, key=lambda each: (place(each.name), each.name)):
        found += lines(each, depth + 1)
    return found


def place(name: str) -> int:
    """Return the position of a subpackage in the order."""
    return ORDER.index(name) if name in ORDER else len(ORDER)


def imports(subpackage: str) -> set[str]:
    """Return the other subpackages that a subpackage imports."""
    found = set()
    for file in (PACKAGE / subpackage).rglob('*.py'):
        for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
            if not isinstance(node, (ast.Import, ast.ImportFrom)):
                continue
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                names = [f'{node.module}.{name}' for name in names]
            parts = [name.split('.') for name in names]
            found |= {part[1] for part in parts if part[0] == PACKAGE.name and len(part) > 1}
    subpackages = {file.parent.name for file in PACKAGE.glob('*/__init__.py')}
    return (found & subpackages) - {subpackage}


def matrix() -> list[str]:
    """Return a row for each subpackage, with a cross for each subpackage that it imports."""
    names = sorted(
        (file.parent.name for file in PACKAGE.glob('*/__init__.py')),
        key=lambda name: (place(name), name),
    )
    head = ' '.join(names)
    rows = []
    for name in names:
        marks = ('x' if other in imports(name) else '.' for other in names)
        row = ' '.join(f'{m:^{len(other)}}' for m, other in zip(marks, names, strict=True))
        rows.append(f'{name:12} {row}')
    return [f'{"imports":12} {head}', *rows]


def fresh(text: str) -> str:
    """Return the page with its generated parts replaced."""
    for mark, content in (('tree', lines(PACKAGE)), ('imports', matrix())):
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
