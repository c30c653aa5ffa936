"""The energy page in the demo: its address while it runs, page and picture that stay."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import urllib.request
from pathlib import Path

PAGE, PICTURE = "energy_page.html", "energy_page.png"
PATIENCE = 30.0  # for the page and for the browser [s]
SIZE = "1400,2300"


def free_port() -> int:
    """Return a TCP port of this computer that nothing uses."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def save_page(url: str, folder: Path) -> str:
    """Save the page as it stands.

    Args:
        url: Address of the page.
        folder: To write into.

    Returns:
        A sentence that says what was written.
    """
    page = folder / PAGE
    try:
        with urllib.request.urlopen(f"{url}saved.html", timeout=PATIENCE) as answer:
            page.write_bytes(answer.read())
    except OSError as error:
        return f"the energy page could not be saved ({error})"
    return f"energy page saved to {page}"


def draw_page(folder: Path) -> str:
    """Make a picture of the saved page where there is a Chromium.

    Args:
        folder: With the page.

    Returns:
        A sentence that says what was written.
    """
    page, picture = folder / PAGE, folder / PICTURE
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        return "no picture of the energy page: there is no Chromium here"
    as_root = ["--no-sandbox"] if os.geteuid() == 0 else []
    command = [
        browser, "--headless", "--disable-gpu", "--hide-scrollbars", *as_root,
        f"--window-size={SIZE}", f"--screenshot={picture}", page.resolve().as_uri(),
    ]  # fmt: skip
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)
    except (OSError, subprocess.SubprocessError):
        return "no picture of the energy page: Chromium made none"
    return f"picture of the energy page: {picture}"
