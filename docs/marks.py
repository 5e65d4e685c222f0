"""Fill the generated parts of pages, between `<!-- NAME -->` and `<!-- end of NAME -->`."""

import re


def filled(text: str, mark: str, content: str) -> str:
    """Return a page with the text between two marks replaced."""
    new, count = re.subn(
        rf'(<!-- {mark} -->\n).*?(<!-- end of {mark} -->)',
        lambda match: f'{match[1]}\n{content}\n\n{match[2]}',
        text,
        flags=re.DOTALL,
    )
    if count != 1:
        raise ValueError(f'expected one place that is marked for {mark}, got {count}')
    return new
