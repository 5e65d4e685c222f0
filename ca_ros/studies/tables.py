"""Tables and numbers in Markdown, and the documents that are made of templates."""

import re
from collections.abc import Mapping, Sequence
from functools import partial
from textwrap import wrap
from typing import Any

import jinja2

LATEX = {
    '±': r'$\pm$', '²': '$^2$', '¹·⁵': '$^{1.5}$', '°': r'$^\circ$', 'ω': r'$\omega$',
    'τ': r'$\tau$', '≤': r'$\le$', 'µ': r'\textmu{}', '\u00a0': '~',
}  # fmt: skip
"""What the signs of the tables are in LaTeX."""

TITLE_WIDTH, CELL_WIDTH = 14, 21  # in LaTeX [characters]; longer cells get several lines


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


def latex(document: str) -> str:
    """Return the tables of a Markdown document as LaTeX, with the rules of booktabs."""
    made = []
    for found in re.finditer(r'(?:^\|.*\|\n?)+', document, re.MULTILINE):
        titles, rule, *rows = (
            [cell.strip() for cell in line.strip().strip('|').split(' | ')]
            for line in found[0].splitlines()
        )
        columns = ''.join('r' if cell.endswith(':') else 'l' for cell in rule)
        head, *body = (
            ' & '.join(
                stacked(cell, titles=row is titles) if column == 'r' else escaped(cell)
                for column, cell in zip(columns, row, strict=True)
            ) + r' \\' for row in (titles, *rows)
        )
        lines = (rf'\begin{{tabular}}{{{columns}}}', r'\toprule', head, r'\midrule', *body)
        size = r'{\footnotesize\setlength{\tabcolsep}{3pt}'
        made.append('\n'.join((size, *lines, r'\bottomrule', r'\end{tabular}}', '')))
    return '\n'.join(made)


def stacked(text: str, titles: bool) -> str:
    """Return a cell for LaTeX in lines of about the same length; brackets are not broken."""
    text = re.sub(r'\[.*?\]|\(.*?\)', lambda found: found[0].replace(' ', '\u00a0'), text)
    split = partial(wrap, text, break_long_words=False, break_on_hyphens=False)
    most = TITLE_WIDTH if titles else CELL_WIDTH
    count = len(split(width=most))
    if count < 2:
        return escaped(text)
    widths = range(len(text) // count, most + 1)
    lines = next(even for width in widths if len(even := split(width=width)) == count)
    lines = [escaped(line) for line in lines]
    place = 'b' if titles else 't'
    return rf'\begin{{tabular}}[{place}]{{@{{}}r@{{}}}}' + r' \\{} '.join(lines) + r'\end{tabular}'


def escaped(text: str) -> str:
    """Return a cell of a Markdown table for LaTeX."""
    for sign in '%&#_$':
        text = text.replace(sign, '\\' + sign)
    text = re.sub(r'`(.*?)`', r'\\texttt{\1}', text)
    text = re.sub(r'([\d.]+)e([+-])0?(\d+)', r'$\1\\cdot10^{\2\3}$', text)
    for sign, command in LATEX.items():
        text = text.replace(sign, command)
    return text.replace('^{+', '^{')


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
