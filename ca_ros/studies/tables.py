"""Tables and numbers in Markdown, and the documents that are made of templates."""

from collections.abc import Mapping, Sequence
from typing import Any

import jinja2


def table(titles: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> str:
    """Return a table; all but the first columns, which hold words, are aligned to the right."""
    rule = ['---'] * words + ['---:'] * (len(titles) - words)
    return '\n'.join('| ' + ' | '.join(row) + ' |' for row in (titles, rule, *rows))


def number(value: float) -> str:
    """Return a number with three digits."""
    if value == 0.0 or abs(value) >= 1000.0:
        return f'{value:.0f}'
    if abs(value) < 1e-2:
        return f'{value:.0e}'
    return f'{value:.3g}'


def listed(values: Mapping[str, Any], between: str = ' ') -> str:
    """Return a mapping in words, such as ``numpy 2.0, scipy 1.11``."""
    return ', '.join(f'{name}{between}{value}' for name, value in values.items())


def render(template: str, **values: Any) -> str:
    """Return a document: a file of the folder templates, filled with values."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader('ca_ros.studies'), undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True,
    )
    environment.filters |= {'number': number, 'listed': listed}
    return environment.get_template(template).render(values)
