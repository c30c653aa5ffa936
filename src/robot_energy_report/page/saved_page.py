"""The files of the page, and the page with its figures as one file."""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from robot_energy_report.page.json_numbers import json_text

TERMS = {
    "90 % band": "range that should hold the true value in nine of ten cases",
    "brake resistor": "turns braking energy that nothing else takes into heat",
    "capacitor": "the store of the DC bus: takes braking energy and gives it back",
    "constant losses": "power of the cabinet that does not depend on motion, on the grid side and "
    "on the DC side",
    "Coulomb": "friction torque that does not depend on speed",
    "DC bus": "the direct-current circuit between the rectifier and the drives",
    "drive loss": "electrical input of a drive minus its shaft power",
    "gap": "a time span without valid samples; nothing is integrated over it",
    "held out": "not seen by the fit, so that the error is that of new data",
    "hold": "phase at rest with active drives: no joint moves",
    "lifting, accelerating": "what moves the bodies: rigid-body torque times velocity; comes back "
    "when they are lowered or braked",
    "measured": "read from a meter, a drive or a sensor",
    "predicted": "computed by the model from joint states and temperatures",
    "RMS": "root mean square: a typical size that counts large errors more",
    "residual": "predicted minus measured",
    "standby": "rest with the drives on for a minute or more",
    "tag": "how a figure is known: published, identified, derived, assumed",
    "viscous": "friction torque that grows with speed and falls with temperature",
}
"""Meaning by term, as in the glossary."""


def terms_in(html: str) -> list[str]:
    """Return the terms that occur in the text of a page, but for code and figures."""
    text = re.sub(r"<(code|pre|figure)\b.*?</\1>|<[^>]*>", " ", html, flags=re.DOTALL)
    return [
        term
        for term in sorted(TERMS, key=str.lower)
        if re.search(rf"(?<![\w-]){re.escape(term)}(?:e?s)?(?![\w-])", text, re.IGNORECASE)
    ]


SCRIPTS = (
    "format.js", "theme.js", "flow.js", "lines.js", "tables.js", "access.js", "stream.js",
    "main.js",
)  # fmt: skip
HISTORY_SCRIPTS = ("bars.js", "curves.js", "savings.js", "history.js")
REPORT_SCRIPTS = ("format.js", "theme.js", "flow.js", "report.js")
FILES = {
    "/": "index.html",
    "/page.css": "page.css",
    "/icon.svg": "icon.svg",
    "/history": "history.html",
    **{f"/{name}": name for name in (*SCRIPTS, *HISTORY_SCRIPTS)},
}
KINDS = {
    "html": "text/html",
    "css": "text/css",
    "js": "text/javascript",
    "svg": "image/svg+xml",
}
MODULE_LINE = re.compile(r"^import .*$\n?|^export (?=const|function|class|async)", re.MULTILINE)


@dataclass(frozen=True)
class StaticFile:
    """One file of the page."""

    content: bytes
    packed: bytes
    kind: str
    tag: str


@cache
def static_file(path: str) -> StaticFile:
    """Return a file of the page."""
    name = FILES[path]
    content = _content(name)
    tag = hashlib.sha256(content).hexdigest()[:16]
    packed = gzip.compress(content, 9, mtime=0)
    return StaticFile(content, packed, KINDS[name.rpartition(".")[2]], f'"{tag}"')


def saved_page(state: dict[str, Any]) -> str:
    """Return the page with its figures as one HTML file that needs nothing else."""
    html = _text("index.html")
    style, script = inline_parts(SCRIPTS)
    figures = json_text(state).replace("<", "\\u003c")
    parts = {
        '<link rel="stylesheet" href="page.css">': "",
        '<link rel="icon" href="icon.svg">': style,
        '<script type="module" src="main.js"></script>': (
            f'<script type="application/json" id="saved">{figures}</script>\n{script}'
        ),
    }
    for found, put in parts.items():
        html = html.replace(found, put)
    return html


@cache
def inline_parts(scripts: tuple[str, ...] = REPORT_SCRIPTS) -> tuple[str, str]:
    """Return what goes into head and end of a page of one file: look, icon, policy; scripts.

    The scripts are joined into one, and the policy permits this script alone.
    """
    style = _text("page.css")
    script = "\n".join(MODULE_LINE.sub("", _text(name)) for name in scripts)
    policy = (
        f"default-src 'none'; script-src {_hash(script)}; style-src {_hash(style)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    icon = base64.b64encode(_text("icon.svg").encode()).decode()
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        f'<link rel="icon" href="data:image/svg+xml;base64,{icon}">\n<style>{style}</style>'
    )
    return head, f'<script type="module">{script}</script>'


def _content(name: str) -> bytes:
    content = (files("robot_energy_report.page") / "static" / name).read_bytes()
    if not name.endswith(".html"):
        return content
    rows = "".join(
        f"<div><dt>{term}</dt><dd>{meaning}</dd></div>" for term, meaning in TERMS.items()
    )
    terms = f'<details id="terms" class="card"><summary>Terms</summary><dl>{rows}</dl></details>\n'
    return content.replace(b"</main>", f"{terms}</main>".encode())


def _text(name: str) -> str:
    return _content(name).decode()


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
