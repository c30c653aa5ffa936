"""The documentation site: `make docs` builds it with Sphinx; warnings are errors."""

import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "src"))

import robot_energy  # noqa: E402

project = "robot-energy"
author = "Robot energy maintainers"
release = version = robot_energy.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["conf.py"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_missing"]  # links to files of the repository, not to pages

html_theme = "furo"
html_title = f"robot-energy {version}"
html_show_sphinx = False
html_show_copyright = False
html_static_path = ["site"]
html_css_files = ["site.css"]
html_search_scorer = str(ROOT / "src/doc/site/search_scorer.js")
html_copy_source = False

autodoc_member_order = "bysource"
autodoc_class_signature = "separated"  # results are made by functions: their fields say it all
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {
    "ArrayLike": "ArrayLike",
    "OptionalArray": "ArrayLike | None",
    "Float": "ndarray",
}
python_maximum_signature_line_length = 80
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
nitpicky = False


def setup(app: Any) -> None:
    """Show an alias in a union by its name: Sphinx writes its own class around it."""
    wrapped = re.compile(r"TypeAliasForwardRef\('([^']+)'\)")

    def plain(_app: Any, *given: Any) -> tuple[str | None, str | None]:
        *_, signature, returns = given
        return signature and wrapped.sub(r"\1", signature), returns

    app.connect("autodoc-process-signature", plain)
