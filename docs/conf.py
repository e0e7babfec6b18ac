"""How the site is built (Sphinx): pages in Markdown, the reference from docstrings, nothing fetched from elsewhere.

Formulas become MathML, which browsers draw by themselves, so that no page needs a script or a font of another site.
"""

from __future__ import annotations

import logging
import os
import re
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from jupyter_client import KernelManager

import pl_mc

sys.path.insert(0, str(Path(__file__).parent))
import gallery

project = "pl_mc"
author = "The pl_mc authors"
copyright = "The pl_mc authors, MIT licence"
version = release = pl_mc.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

# Notebooks are stored without outputs and run here, each in a process of its own. They compile about as long as they
# run, so that XLA takes its middle way.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 240
# What passes a port is encrypted, where the library can.
if hasattr(KernelManager, "transport_encryption"):
    KernelManager.transport_encryption.default_value = "auto"
logging.getLogger("traitlets").setLevel(logging.WARNING)
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1 --xla_cpu_use_fusion_emitters=false")

# Docstrings name things in single quotes, as in `pl_mc.sweep`: a link where the reference has it, else plain code.
default_role = "py:obj"
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
# Left as they are written: what they stand for fills lines.
autodoc_type_aliases = {name: name for name in ("ArrayLike", "NDArray", "FloatArray")}
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
# Types stand in the signature already.
napoleon_attr_annotations = False

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["formulas.css"]
html_title = f"pl_mc {version}"
html_show_sphinx = False
html_copy_source = False
html_math_renderer = "mathml"


def _inline(self: Any, node: nodes.math) -> None:
    self.body.append(tex2mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def _block(self: Any, node: nodes.math_block) -> None:
    self.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>\n')
    raise nodes.SkipNode


def _bars(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Bars in docstrings are absolute values, not substitutions, wherever they are not code."""
    for place, line in enumerate(lines):
        parts = line.split("``")
        parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
        lines[place] = "``".join(parts)


def _returned(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """What is returned is text from its first word on, not a type up to the first colon, which may be anywhere."""
    for place in range(1, len(lines)):
        if lines[place - 1].strip() == "Returns:":
            text = lines[place].lstrip()
            lines[place] = f"{lines[place][: -len(text)]}: {text}"


def _apart(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Attributes that share a description, ``a, b: text``, get it each; Sphinx would take the first for a type."""
    apart: list[str] = []
    place = 0
    while place < len(lines):
        end = place + 1
        shared = re.fullmatch(r":ivar (\w+(?:, \w+)+):(.*)", lines[place])
        if shared is None:
            apart.append(lines[place])
        else:
            while end < len(lines) and lines[end].startswith(" "):
                end += 1
            for one in shared[1].split(", "):
                apart += [f":ivar {one}:{shared[2]}", *lines[place + 1 : end]]
        place = end
    lines[:] = apart


def _names(app: Any, what: str, name: str, obj: Any, options: Any, signature: str | None, returns: str | None) -> Any:
    """Signatures with the names of types, where Sphinx shows how it keeps them."""
    return tuple(text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text) for text in (signature, returns))


def _gallery(app: Any, page: str, source: list[str]) -> None:
    if page == "gallery":
        source[0] += "\n" + gallery.entries()


def setup(app: Any) -> dict[str, bool]:
    """Register the drawing of formulas and the reading of docstrings."""
    app.connect("source-read", _gallery)
    app.connect("autodoc-process-docstring", _bars)
    # Before napoleon.
    app.connect("autodoc-process-docstring", _returned, priority=100)
    # After napoleon, which makes fields of sections.
    app.connect("autodoc-process-docstring", _apart, priority=900)
    app.connect("autodoc-process-signature", _names)
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
