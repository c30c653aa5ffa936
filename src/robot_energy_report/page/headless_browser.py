"""A Chromium without window, where one is installed: pictures and PDF of saved pages."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from robot_energy.foundation.errors import PageError
from robot_energy.foundation.files.output_files import PDF

BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge",
)  # fmt: skip
PATIENCE = 60.0  # s
PDF_SIZE = "1000,1400"  # of the window in which figures are drawn before they are printed
WORDS = (
    "--headless", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--no-pdf-header-footer",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
)  # fmt: skip


def find_browser() -> str | None:
    """Return the browser that draws pages; None if there is none."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def need_browser() -> str:
    """Return the browser that draws pages."""
    found = find_browser()
    if found is None:
        raise PageError(
            "a PDF is printed by a Chromium, and none is installed",
            f"one of {', '.join(BROWSERS)} on the path",
            "name a file that ends in .html and print it in any browser",
        )
    return found


def run_browser(page: Path, *words: str) -> None:
    """Open a page in a browser of its own and wait until it has ended."""
    browser = need_browser()
    as_root = ["--no-sandbox"] if os.geteuid() == 0 else []
    with tempfile.TemporaryDirectory(prefix="robot_energy_") as profile:
        command = [browser, *WORDS, *as_root, f"--user-data-dir={profile}", *words]
        try:
            subprocess.run(
                [*command, page.resolve().as_uri()],
                check=True,
                capture_output=True,
                timeout=PATIENCE,
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise PageError(
                f"{browser} made nothing of the page ({type(error).__name__})",
                "a Chromium that runs without a window",
                "name a file that ends in .html and print it in any browser",
            ) from error


def printed(html: bytes) -> bytes:
    """Return a page as PDF, with the mark of this tool."""
    with tempfile.TemporaryDirectory(prefix="robot_energy_") as folder:
        page, made = Path(folder) / "report.html", Path(folder) / "report.pdf"
        page.write_bytes(html)
        run_browser(page, f"--window-size={PDF_SIZE}", f"--print-to-pdf={made}")
        if not made.is_file():
            raise PageError("the browser wrote no PDF", "a PDF", "print the HTML file by hand")
        return made.read_bytes() + b"\n%" + PDF[0].mark + b"\n"
