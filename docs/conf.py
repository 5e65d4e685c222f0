"""Configuration of Sphinx; `make docs` copies the pages and this file to out/docs-source."""

import re

project = 'ca_ros'
author = copyright = 'ca_ros maintainers'
# Where names of files differ in more than case.
autosummary_filename_map = {'ca_ros.audit': 'ca_ros.audit_function'}
extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.autosummary', 'numpydoc']
# One page a name of api.rst.
templates_path = ['templates']
html_theme = 'alabaster'
html_theme_options = {
    'description': 'Control allocation for multirotors',
    'page_width': '1200px',
    'sidebar_width': '260px',
}
# Headings have the same anchors as on GitHub.
myst_heading_anchors = 4
autodoc_member_order = 'bysource'
# Docstrings state the types, with shapes and units.
autodoc_typehints = 'none'
numpydoc_show_class_members = False

PAGE = re.compile(r'(?<!!)\[([^]]+)\]\((?!https?:|#)([^)]+)\)')
"""A link to a file of the repository: its text and its target."""


def leave_out_files(app, name, source):
    """Replace links to files outside the pages by their text."""

    def plain(found):
        page = found[2].partition('#')[0]
        return found[0] if '/' not in page and (app.srcdir / page).exists() else found[1]

    source[0] = PAGE.sub(plain, source[0])


def escape_bars(app, what, name, thing, options, lines):
    """Escape bars such as those of |u|, which have a meaning in reStructuredText."""
    for i, line in enumerate(lines):
        # Every second part is a literal.
        parts = line.split('``')
        parts[::2] = [part.replace('|', r'\|') for part in parts[::2]]
        lines[i] = '``'.join(parts)


def setup(app):
    """Connect the functions above."""
    app.connect('source-read', leave_out_files)
    app.connect('autodoc-process-docstring', escape_bars, priority=900)
