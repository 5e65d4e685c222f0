"""Count the words of prose on the pages: without code, tables, formulas, marks and addresses."""

import re

from pages import DOCS

NO_PROSE = (
    r'(?ms)^```.*?^```\s*$', r'(?s)<!--.*?-->', r'(?s)\$\$.*?\$\$', r'(?m)^\|.*$',
    r'(?m)^.* \| .*$', r'(?<=\])\([^)]*\)')


def words(text: str) -> int:
    """Return the number of words of prose of a page."""
    for pattern in NO_PROSE:
        text = re.sub(pattern, '', text)
    return len(text.split())


if __name__ == '__main__':
    counts = {page.name: words(page.read_text(encoding='utf-8')) for page in DOCS.glob('*.md')}
    for name, count in sorted(counts.items(), key=lambda item: -item[1]):
        print(f'{count:6} {name}')
    print(f'{sum(counts.values()):6} in all')
