"""Markdown to HTML that holds nothing but text, headings, lists, tables and code."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mistune
from markupsafe import Markup, escape

PARSE: Any = mistune.create_markdown(renderer='ast', plugins=['table'])

BADGES = {'Holds: ': 'yes', 'Does not hold: ': 'no'}
"""Items of lists that begin so are verdicts."""

SHORT = 24
"""Up to so many characters a cell of numbers stays in one line."""

Token = Mapping[str, Any]


def html(text: str, anchor: str) -> tuple[Markup, Markup, list[tuple[str, str]]]:
    """Return a Markdown text without its title as HTML, and its headings.

    Parameters
    ----------
    text : str
        With one heading of the first level, or none.  HTML in it is shown as it is written, and
        links as their text: the page is to need nothing from elsewhere.
    anchor : str
        What the anchors of its headings begin with.

    Returns
    -------
    start, rest : Markup
        What comes before the first heading, and all from there on.
    headings : list of (str, str)
        Anchor and text of each heading.
    """
    tokens = [token for token in PARSE(text) if not _is_title(token)]
    headings = [
        (f'{anchor}-{_slug(_text(token))}', _text(token))
        for token in tokens
        if token['type'] == 'heading'
    ]
    anchors = iter(headings)
    start: list[Markup] = []
    rest: list[Markup] = []
    for token in tokens:
        if token['type'] == 'heading':
            rest.append(_heading(token, next(anchors)[0]))
        else:
            (rest or start).append(_render(token))
    return Markup('').join(start), Markup('').join(rest), headings


def _is_title(token: Token) -> bool:
    return bool(token['type'] == 'heading' and token['attrs']['level'] == 1)


def _slug(text: str) -> str:
    return re.sub(r'[^a-z0-9]+', '-', text.lower()).strip('-')


def _heading(token: Token, anchor: str) -> Markup:
    # The page has headings of two levels above these.
    level = token['attrs']['level'] + 1
    return Markup('<h{0} id="{1}">{2}</h{0}>\n').format(level, anchor, _inside(token))


def _render(token: Token) -> Markup:
    """Return a token as HTML; of a kind that is not known, its text."""
    render = RENDER.get(token['type'], _inside)
    return render(token)


def _inside(token: Token) -> Markup:
    if 'children' in token:
        return Markup('').join(_render(child) for child in token['children'])
    return escape(token.get('raw', ''))


def _text(token: Token) -> str:
    return _inside(token).striptags()


def _wrapped(before: str, after: str) -> Callable[[Token], Markup]:
    return lambda token: Markup(before) + _inside(token) + Markup(after)


def _item(token: Token) -> Markup:
    text = _text(token)
    for beginning, badge in BADGES.items():
        if text.startswith(beginning):
            return Markup('<li class="{}">{}</li>\n').format(badge, _inside(token))
    return Markup('<li>{}</li>\n').format(_inside(token))


def _table(token: Token) -> Markup:
    head, *bodies = token['children']
    names = [_text(cell) for cell in head['children']]
    rows = [row['children'] for body in bodies for row in body['children']]
    return Markup(
        '<div class="scroll"><table>\n<thead>{}</thead>\n<tbody>{}</tbody></table></div>\n'
    ).format(
        _row(head['children'], names, 'th'),
        Markup('').join(_row(cells, names, 'td') for cells in rows),
    )


def _row(cells: Sequence[Token], names: Sequence[str], kind: str) -> Markup:
    """Return a row; each cell knows the name of its column, which a narrow screen shows."""
    parts = [
        Markup('<{0} data-label="{1}"{2}>{3}</{0}>').format(
            kind,
            name,
            _look(cell),
            _inside(cell),
        )
        for cell, name in zip(cells, names, strict=False)
    ]
    quoted = ' class="other"' if cells and _text(cells[0]).startswith('paper: ') else ''
    return Markup('<tr{}>{}</tr>\n').format(Markup(quoted), Markup('').join(parts))


def _look(cell: Token) -> Markup:
    if cell['attrs']['align'] != 'right':
        return Markup('')
    return Markup(' class="number{}"').format(' short' if len(_text(cell)) <= SHORT else '')


RENDER: dict[str, Callable[[Token], Markup]] = {
    'block_code': _wrapped('<pre><code>', '</code></pre>\n'),
    'block_html': _wrapped('<p>', '</p>\n'),
    'block_quote': _wrapped('<blockquote>', '</blockquote>\n'),
    'codespan': _wrapped('<code>', '</code>'),
    'emphasis': _wrapped('<em>', '</em>'),
    'linebreak': lambda _: Markup('<br>'),
    'list': lambda token: Markup('<{0}>\n{1}</{0}>\n').format(
        'ol' if token['attrs']['ordered'] else 'ul', _inside(token)
    ),
    'list_item': _item,
    'paragraph': _wrapped('<p>', '</p>\n'),
    'softbreak': lambda _: Markup('\n'),
    'strong': _wrapped('<strong>', '</strong>'),
    'table': _table,
    'thematic_break': lambda _: Markup('<hr>\n'),
}
