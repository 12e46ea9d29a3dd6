"""Sphinx: the pages of this folder, and those that `generate.py` makes of the running package."""

import logging
import re
import shutil
import sys
from pathlib import Path

from docutils.nodes import SkipNode
from latex2mathml.converter import convert

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import generate  # noqa: E402  (beside this file)
import package_facts  # noqa: E402

logging.getLogger("arviz").setLevel(logging.WARNING)  # it tells of its plotting backends

project = "bayesdeg"
author = "the bayesdeg developers"
project_copyright = "the bayesdeg developers"
version = release = package_facts.VERSION

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["_build", "README.md", "generated/**/*.inc"]
myst_enable_extensions = ["dollarmath", "deflist", "attrs_inline", "colon_fence"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"bayesdeg {release}"
html_static_path = ["_static"]
html_css_files = ["docs.css"]
html_copy_source = False
html_math_renderer = "mathml"
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # napoleon shows the types that the docstring gives
napoleon_google_docstring = False
napoleon_use_rtype = False
smartquotes = False  # it makes a dash of the two that begin an option


def inline_math(self, node):
    """Write a formula in a line as MathML: browsers draw it without a script or a network."""
    self.body.append(convert(node.astext(), display="inline"))
    raise SkipNode


def displayed_math(self, node):
    """Write a formula of its own as MathML."""
    self.body.append(f'<div class="formula">{convert(node.astext(), display="block")}</div>')
    raise SkipNode


def escape_bars(app, what, name, obj, options, lines):
    """Keep |y| in docstrings an absolute value: reStructuredText would take it for a reference."""
    lines[:] = [re.sub(r"(?<!`)\|([^|`\s][^|`]*)\|", r"\\|\1\\|", line) for line in lines]


def write_pages(app):
    """Make the generated pages before Sphinx looks for sources."""
    generate.write_all(HERE / "generated")


def copy_reports(app, failure):
    """Put the published reports beside the pages that link them."""
    if failure is None and app.builder.format == "html":
        for folder in generate.REPORTS:
            target = Path(app.outdir) / "reports" / folder.name
            shutil.copytree(folder, target, dirs_exist_ok=True)


def setup(app):
    """Register what is ours."""
    app.add_html_math_renderer("mathml", (inline_math, None), (displayed_math, None))
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("builder-inited", write_pages)
    app.connect("build-finished", copy_reports)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
