"""The lines of PX4's files that set a parameter."""

import re

# `param set-default NAME VALUE` of an airframe, or a line of a file of QGroundControl.  A space
# may be any: text that is copied from a page has some that look like a blank or a tab.
LINE = re.compile(r'\s*(?:param\s+set(?:-default)?|\d+\s+\d+)\s+(\w+)\s+(\S+)')


def px4_lines(text: str) -> list[tuple[str, str, int]]:
    """Return name, value and number of each line of a text that sets a parameter of PX4."""
    found = ((LINE.match(line), number) for number, line in enumerate(text.splitlines(), 1))
    return [(match[1], match[2], number) for match, number in found if match]
