"""Configuration of Sphinx; `make docs` copies the pages and README to out/docs-source."""

from pathlib import Path
from urllib.request import urlopen

from sphinx.addnodes import pending_xref

project = 'ca_ros'
author = copyright = 'ca_ros maintainers'
# Where names of files differ in more than case.
autosummary_filename_map = {'ca_ros.audit': 'ca_ros.audit_function'}
extensions = [
    'myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.autosummary', 'sphinx.ext.intersphinx',
    'sphinx.ext.mathjax', 'numpydoc',
]
# One page a name of api.rst.
templates_path = ['templates']
html_theme = 'furo'
html_title = 'ca_ros'
html_static_path = ['static']
html_css_files = ['pages.css']
html_theme_options = {'navigation_with_keys': True}
pygments_style, pygments_dark_style = 'friendly', 'monokai'
myst_enable_extensions = ['dollarmath']
# Headings have the same anchors as on GitHub.
myst_heading_anchors = 4
autodoc_member_order = 'bysource'
# Docstrings state the types, with shapes and units.
autodoc_typehints = 'none'
numpydoc_show_class_members = False

PAGES = {
    'python': 'https://docs.python.org/3',
    'numpy': 'https://numpy.org/doc/stable',
    'scipy': 'https://docs.scipy.org/doc/scipy',
}
"""Other projects whose pages the API reference links."""


REPOSITORY = next(
    folder for folder in Path(__file__).resolve().parents if (folder / 'package.xml').is_file())


def reachable(address):
    """Tell whether the list of a project's names can be read."""
    try:
        with urlopen(f'{address}/objects.inv', timeout=5.0):
            return True
    except OSError:
        return False


# Without a network the pages are the same, but for these links.
intersphinx_mapping = {
    name: (address, None) for name, address in PAGES.items()
    if reachable(address)
}
# Names of types in docstrings are links.
numpydoc_xref_param_type = len(intersphinx_mapping) == len(PAGES)
numpydoc_xref_aliases = {'array': 'numpy.ndarray', 'ArrayLike': 'numpy.typing.ArrayLike'}


def leave_out_files(app, doctree):
    """Replace links to files of the repository that are no pages by their text."""
    for link in list(doctree.findall(pending_xref)):
        target = link.get('reftarget', '').partition('#')[0]
        # Those of README are relative to its folder.
        in_repository = any((REPOSITORY / place / target).exists() for place in ('docs', ''))
        if link['reftype'] == 'myst' and target and in_repository and (
                not (Path(app.srcdir) / target).exists()):
            link.replace_self(link.children)


def escape_bars(app, what, name, thing, options, lines):
    """Escape bars such as those of |u|, which have a meaning in reStructuredText."""
    for i, line in enumerate(lines):
        # Every second part is a literal.
        parts = line.split('``')
        parts[::2] = [part.replace('|', r'\|') for part in parts[::2]]
        lines[i] = '``'.join(parts)


def setup(app):
    """Connect the functions above."""
    app.connect('doctree-read', leave_out_files)
    app.connect('autodoc-process-docstring', escape_bars, priority=900)
