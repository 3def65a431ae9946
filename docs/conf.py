"""Sphinx settings. Formulas become MathML at build time: no JavaScript, no network."""

import re

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.errors import ExtensionError

from tgospa_eval import __version__

project = "tgospa-eval"
author = "The tgospa-eval authors"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
templates_path = ["_templates"]
default_role = "literal"
language = "en"

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"

man_pages = [
    ("reference/cli", "tgospa-eval", "evaluate a multi-target tracker with TGOSPA", [author], 1),
    ("reference/options", "tgospa-eval-options", "options of tgospa-eval", [author], 1),
]

html_theme = "furo"
html_title = f"tgospa-eval {__version__}"
html_static_path = ["_static"]
html_css_files = ["math.css"]
html_show_copyright = False
html_copy_source = False
html_math_renderer = "mathml"


def to_mathml(node, *, block):
    # a fraction of two digits: each is one argument in TeX, but a number to docutils
    text = re.sub(r"(\\[dt]?frac)(\d)(\d)", r"\1{\2}{\3}", node.astext())
    try:
        # the empty set is no operator, with space around it
        made = str(tex2mathml(text, as_block=block))
        return made.replace("<mo>⌀</mo>", "<mi mathvariant='normal'>∅</mi>")
    except MathError as error:
        raise ExtensionError(f"formula {node.astext()!r}: {error}") from error


def visit_math(self, node):
    self.body.append(to_mathml(node, block=False))
    raise nodes.SkipNode


def visit_math_block(self, node):
    self.body.append(f'<div class="math-block">{to_mathml(node, block=True)}</div>\n')
    raise nodes.SkipNode


_plain = {}


def keep_docstring(app, what, name, obj, options, lines):
    """Before napoleon, which takes what precedes a colon for the type of a property."""
    if what == "property":
        _plain[name] = list(lines)


def restore_docstring(app, what, name, obj, options, lines):
    if name in _plain:
        lines[:] = _plain.pop(name)


def without_pages(app, document, docname):
    """A page of man stands alone: of a link to another page the words stay."""
    if app.builder.name == "man":
        for link in list(document.findall(nodes.reference)):
            if "://" not in link.get("refuri", ""):
                link.replace_self(link.children)


def setup(app):
    app.connect("doctree-resolved", without_pages)
    app.connect("autodoc-process-docstring", keep_docstring, priority=400)
    app.connect("autodoc-process-docstring", restore_docstring, priority=600)
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
