"""Regenerate the output of README's example and the tables of docs/parameters.md.

With --check nothing is written, and the exit code is 1 if a page is not up to date.
"""

import re
import subprocess
import sys

from pages import DOCS, filled

from ca_ros import ALLOCATORS, settings
from ca_ros.parameter_files import DECLARED, MonitorSettings, Px4NodeSettings

# The monitor's come before the simulator's, which share some of them.
TABLES = {
    'allocator': DECLARED['allocator'], 'controller': DECLARED['controller'],
    'monitor': MonitorSettings, 'simulator': DECLARED['simulator'], 'px4': Px4NodeSettings,
}

PAGES = (DOCS.parent / 'README.md', DOCS / 'parameters.md')

LINKS = {'allocation.method': 'one of [these](#methods)'}
"""Allowed values that another table lists: links to it."""


SYMBOLS = {
    'Gamma': 'Γ', '^-1': '⁻¹', '^2': '²', '^+': '⁺', '<=': '≤', '|': '\\|',
    'gamma': '\N{GREEK SMALL LETTER GAMMA}', 'alpha': '\N{GREEK SMALL LETTER ALPHA}',
    ' - ': ' \N{MINUS SIGN} ',
}


def parameters(node: str) -> str:
    """Return the parameters of a node as a Markdown table, without those of the tables before."""
    shared: set[str] = set()
    for other in tuple(TABLES)[: tuple(TABLES).index(node)]:
        shared |= {*settings.table(TABLES[other])}
    rows = ['name | default | meaning', '---|---|---']
    for name, field in settings.table(TABLES[node]).items():
        if name not in shared:
            mark = '*' if field.mutable else ''
            rows.append(f'`{name}`{mark} | {_default(field)} | {_meaning(name, field)}')
    return '\n'.join(rows)


def _meaning(name: str, field: settings.Field) -> str:
    """Return what a parameter means, with its range where neither sign nor words tell it."""
    text, unit = re.fullmatch(r'(.*?)((?: \[[^]]*\])?)', field.description).groups()
    if name in LINKS:
        text += f', {LINKS[name]}'
    elif not all(re.search(rf'\b{choice}\b', text) for choice in field.choices):
        text += f'; one of {", ".join(field.choices)}'
    elif not field.choices:
        text = re.sub(r'(?<!Eq)\. .*|; (?!0:)[^;]*', '', text)
    allowed = '' if str in field.kinds else field.range()
    return f'{text}{unit}{f", {allowed}" if "[" in allowed else ""}'.replace('|', '\\|')


def methods() -> str:
    """Return the methods as a Markdown table."""
    rows = ['method | solves | guarantees, beside the bounds', '---|---|---']
    for name, kind in ALLOCATORS.items():
        first = (kind.__doc__ or '').partition('\n')[0].removesuffix('.')
        solves = vars(kind).get('solves') or first
        more = kind.guarantees.removeprefix('the bounds').removeprefix(', and ')
        rows.append(f'`{name}` | {_formula(solves)} | {_formula(more)}'.rstrip())
    return '\n'.join(rows)


def _formula(text: str) -> str:
    """Return a text with the symbols that docstrings spell out, for a Markdown table."""
    for words, symbol in SYMBOLS.items():
        text = text.replace(words, symbol)
    return text


def _default(field: settings.Field) -> str:
    if field.default is settings.REQUIRED:
        return 'none'
    words = field.default if isinstance(field.default, tuple) else [field.default]
    return ', '.join(str(word).lower() if isinstance(word, bool) else str(word) for word in words)


def printed(code: str) -> str:
    """Return what a Python program prints."""
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    return run.stdout


def fresh(text: str) -> str:
    """Return a page with its generated parts replaced."""
    text = re.sub(
        r'(<!-- prints -->\n```python\n(.*?)```\n\n```text\n)(.*?)(```)',
        lambda match: match[1] + printed(match[2]) + match[4], text, flags=re.DOTALL,
    )
    for mark in re.findall('<!-- end of (.*) -->', text):
        text = filled(text, mark, methods() if mark == 'methods' else parameters(mark))
    return text


def main() -> None:
    """Write the pages, or check them."""
    check = sys.argv[1:] == ['--check']
    stale = []
    for page in PAGES:
        old = page.read_text(encoding='utf-8')
        new = fresh(old)
        if new != old:
            stale.append(page.name)
            if not check:
                page.write_text(new, encoding='utf-8')
    if stale and check:
        sys.exit(f'not up to date: {", ".join(stale)}; run make readme')


if __name__ == '__main__':
    main()
