"""Markdown to HTML for a report: text, headings, lists, tables and code, nothing else."""

from __future__ import annotations

import re
from typing import Any

import mistune
from markupsafe import Markup, escape

BADGES = {'Holds: ': 'yes', 'Does not hold: ': 'no'}
"""List items with these beginnings are verdicts."""

SHORT = 24
"""Number of characters up to which a cell of numbers stays in one line."""


class Renderer(mistune.HTMLRenderer):
    """Escapes HTML in the text, and renders links and pictures as their text."""

    def __init__(self, anchor: str) -> None:
        super().__init__(escape=True)
        self.anchor, self.headings = anchor, list[tuple[str, str]]()
        self.titles, self.column = list[str](), 0

    def link(self, text: str, url: str, title: str | None = None) -> str:
        """Return the text of a link or picture: the page loads nothing."""
        return text

    image = link

    def heading(self, text: str, level: int, **attrs: Any) -> str:
        """Return a heading one level lower, below those of the page; the title is left out."""
        if level == 1:
            return ''
        words = Markup(text).striptags()
        slug = re.sub(r'[^a-z0-9]+', '-', words.lower()).strip('-')
        self.headings.append((f'{self.anchor}-{slug}', words))
        return f'<h{level + 1} id="{self.anchor}-{slug}">{text}</h{level + 1}>\n'

    def list_item(self, text: str) -> str:
        """Return an item; verdicts have a class of their own."""
        for beginning, badge in BADGES.items():
            if Markup(text).striptags().startswith(beginning):
                return f'<li class="{badge}">{text}</li>\n'
        return f'<li>{text}</li>\n'

    def table_cell(self, text: str, align: str | None = None, head: bool = False) -> str:
        """Return a cell with its column's name, which a narrow screen shows.

        Cells aligned to the right hold numbers.
        """
        words = Markup(text).striptags()
        if head:
            self.titles.append(words)
        title = self.titles[-1] if head else self.titles[self.column]
        self.column += not head
        look = ' short' if len(words) <= SHORT else ''
        kind, number = 'th' if head else 'td', f'class="number{look}"' if align == 'right' else ''
        return f'<{kind} data-label="{escape(title)}" {number}>{text}</{kind}>'

    def table_row(self, text: str) -> str:
        """Return a row; the paper's rows have a class of their own."""
        self.column = 0
        other = ' class="other"' if Markup(text).striptags().startswith('paper: ') else ''
        return f'<tr{other}>{text}</tr>\n'

    def table(self, text: str) -> str:
        """Return a table, whose cells have been rendered."""
        self.titles = []
        return f'<div class="scroll"><table>\n{text}</table></div>\n'


def html(text: str, anchor: str) -> tuple[Markup, Markup, list[tuple[str, str]]]:
    """Return a Markdown text without its title as HTML, with a prefix for its anchors.

    Returns the parts before and from the first heading, and anchor and text of each heading.
    """
    renderer = Renderer(anchor)
    whole = str(mistune.create_markdown(renderer=renderer, plugins=['table'])(text))
    first = re.search('<h[3-7] id=', whole)
    end = first.start() if first else len(whole)
    return Markup(whole[:end]), Markup(whole[end:]), renderer.headings
