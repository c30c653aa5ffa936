"""The documentation site: `make docs` builds it with Sphinx; warnings are errors."""

import re
import sys
from itertools import accumulate
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

# By the rules of axe-core: captions have a level, tables that scroll are reached by keyboard, and
# the lines of a signature are no list of definitions.
ACCESSIBLE = (
    ("furo_navigation_tree", 'role="heading"', 'role="heading" aria-level="2"'),
    ("body", '<div class="table-wrapper', '<div tabindex="0" class="table-wrapper'),
    ("body", r"<dl>\n(<dd><em class=\"sig-param\".*?)</dl>", r'<span class="lines">\1</span>'),
    ("body", r'<dd>(<em class="sig-param">.*?)</dd>', r'<span class="line">\1</span>'),
)


def without_texts(text: str) -> str:
    """Return types without what their annotations say, which stands next to them."""
    head, found, rest = text.partition("Annotated[")
    if not found:
        return text
    depths = accumulate((letter in "[(") - (letter in "])") for letter in rest)
    place = next(i for i, depth in enumerate(depths) if rest[i] == "," and not depth)
    kind, said = rest[:place], rest[place + 2 :]
    end = said.find(said[0] + "]") + 2 if said[0] in "'\"" else len(said)
    return head.removesuffix("~typing.") + kind + without_texts(said[end:])


def setup(app: Any) -> None:
    """Mend what Sphinx and its theme write: names of aliases, and HTML that readers trip over."""
    wrapped = re.compile(r"TypeAliasForwardRef\('([^']+)'\)")

    def plain(_app: Any, *given: Any) -> tuple[str | None, str | None]:
        *_, signature, returns = given
        return signature and without_texts(wrapped.sub(r"\1", signature)), returns

    def types_alone(*given: Any) -> None:
        given[-1][:] = [
            without_texts(line) if line.startswith(":vartype") else line for line in given[-1]
        ]

    def accessible(_app: Any, _page: str, _template: str, context: dict[str, Any], _: Any) -> None:
        for part, old, new in ACCESSIBLE:
            context[part] = re.sub(old, new, context.get(part) or "", flags=re.DOTALL)

    app.connect("autodoc-process-signature", plain)
    app.connect("autodoc-process-docstring", types_alone, priority=900)  # after napoleon
    app.connect("html-page-context", accessible, priority=900)  # after the theme
