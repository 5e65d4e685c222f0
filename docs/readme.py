"""Write what README says of the code: the table of parameters, the output of the example.

With --check nothing is written, and the exit code says whether README is up to date.
"""

import re
import subprocess
import sys
from pathlib import Path

from ca_ros.schema import PARAMETERS, REQUIRED, Parameter

README = Path(__file__).resolve().parent.parent / 'README.md'

ALLOWED = {'allocation.method': 'a [method](#the-problem)'}
"""What is said here of values that another table lists, or `python -m ca_ros` does."""


def table() -> str:
    """Return the parameters as a Markdown table."""
    rows = ['| name | default | allowed | meaning |', '|---|---|---|---|']
    for name, parameter in PARAMETERS.items():
        mark = '*' if parameter.mutable else ''
        rows.append(
            f'| `{name}`{mark} | {_default(parameter)} | {ALLOWED.get(name) or parameter.range()} '
            f'| {parameter.description} |'
        )
    return '\n'.join(rows)


def _default(parameter: Parameter) -> str:
    if parameter.default is REQUIRED:
        return 'none'
    words = parameter.default if isinstance(parameter.default, list) else [parameter.default]
    return ', '.join(str(word) for word in words)


def printed(code: str) -> str:
    """Return what a Python program prints."""
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    return run.stdout


def fresh(text: str) -> str:
    """Return README with its generated parts made anew."""
    text = re.sub(
        r'(<!-- prints -->\n```python\n(.*?)```\n\n```text\n)(.*?)(```)',
        lambda match: match[1] + printed(match[2]) + match[4],
        text,
        flags=re.DOTALL,
    )
    return re.sub(
        r'(<!-- parameters -->\n).*?(<!-- end of parameters -->)',
        lambda match: f'{match[1]}\n{table()}\n\n{match[2]}',
        text,
        flags=re.DOTALL,
    )


if __name__ == '__main__':
    old = README.read_text(encoding='utf-8')
    new = fresh(old)
    if sys.argv[1:] == ['--check']:
        sys.exit(None if new == old else 'README.md is not up to date: run make readme')
    README.write_text(new, encoding='utf-8')
