# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The energy page in the demo: its address while it runs, page and picture that stay."""

from __future__ import annotations

import socket
import urllib.request
from pathlib import Path

from robot_energy.foundation.errors import PageError
from robot_energy_report.page.headless_browser import find_browser, run_browser

PAGE, PICTURE = "energy_page.html", "energy_page.png"
PATIENCE = 30.0  # for the page [s]
SIZE = "1400,2300"


def free_port() -> int:
    """Return a TCP port of this computer that nothing uses."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def save_page(url: str, folder: Path) -> str:
    """Return a sentence on the page, saved as it stands."""
    page = folder / PAGE
    try:
        with urllib.request.urlopen(f"{url}saved.html", timeout=PATIENCE) as answer:
            page.write_bytes(answer.read())
    except OSError as error:
        return f"the energy page could not be saved ({error})"
    return f"energy page saved to {page}"


def draw_page(folder: Path) -> str:
    """Return a sentence on the picture of the saved page, made where there is a Chromium."""
    page, picture = folder / PAGE, folder / PICTURE
    if find_browser() is None:
        return "no picture of the energy page: there is no Chromium here"
    try:
        run_browser(page, f"--window-size={SIZE}", f"--screenshot={picture}")
    except PageError:
        return "no picture of the energy page: Chromium made none"
    return f"picture of the energy page: {picture}"
