"""The page in a real browser: Chromium and its driver, without any network but loopback."""

from __future__ import annotations

import importlib.util
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

PATIENCE = 120.0  # s, on a machine that does much else
CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
OPTIONS = (
    "--headless=new", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--no-first-run",
    # No name is found, and what is not loopback goes to a proxy that is not there.
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1", "--proxy-server=127.0.0.1:9",
    "--proxy-bypass-list=127.0.0.1",
)  # fmt: skip
needs_browser = pytest.mark.skipif(
    not (CHROMIUM and DRIVER),
    reason="no chromium with chromedriver: apt-get install chromium chromium-driver",
)


class Browser:
    """One window.

    Args:
        driver: Of selenium.
    """

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, url: str, width: int = 1400, height: int = 1000) -> None:
        """Open an address in a window of this size, as a phone if it is narrow."""
        self.size(width, height)
        self.driver.get(url)

    def size(self, width: int, height: int) -> None:
        """Set the size of the page. [CSS pixels]"""
        wanted = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", wanted)

    def dark(self, dark: bool) -> None:
        """Set what the system prefers."""
        features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})

    def run(self, script: str, *values: Any) -> Any:
        """Run JavaScript; ``return`` gives its value."""
        return self.driver.execute_script(script, *values)

    def text(self, element: str) -> str:
        """Text of an element by its id."""
        return str(self.run("return document.getElementById(arguments[0]).textContent", element))

    def click(self, selector: str) -> None:
        """Click as a user does."""
        self.driver.find_element("css selector", selector).click()

    def wait(self, script: str, what: str, patience: float = PATIENCE) -> Any:
        """Wait until JavaScript gives something true."""
        limit = time.monotonic() + patience
        while not (found := self.run(f"return {script}")):
            assert time.monotonic() < limit, f"waited {patience} s in vain for {what}"
            time.sleep(0.1)  # each question takes three processes
        return found

    def complaints(self) -> list[str]:
        """What the console of the browser has said since the last call."""
        return [str(entry["message"]) for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Addresses of all that the page has loaded."""
        return self.run("return performance.getEntriesByType('resource').map(one => one.name)")

    def flow_nodes(self) -> list[dict[str, Any]]:
        """Nodes of the energy flow as they are drawn."""
        return self.run(
            "return [...document.querySelectorAll('#flow rect')].map(n => ({id: n.dataset.node, "
            "into: +n.dataset.in, out: +n.dataset.out, inner: n.dataset.inner === 'true'}))"
        )

    def flows(self) -> list[list[Any]]:
        """Rows of the table of flows: from, to, text, units."""
        return self.run(
            "return [...document.querySelectorAll('#flows tbody tr')].map(r => ["
            "...[0, 1, 2].map(n => r.cells[n].textContent), +r.cells[2].dataset.value])"
        )

    def values(self, table: str) -> dict[str, list[str]]:
        """Exact figures of a table by the head of each row; empty where unknown."""
        return self.run(
            "return Object.fromEntries([...document.querySelectorAll(`#${arguments[0]} tbody tr`)]"
            ".map(r => [r.cells[0].textContent, [...r.cells].filter(c => 'value' in c.dataset)"
            ".map(c => c.dataset.value)]))",
            table,
        )

    def faults(self) -> list[str]:
        """Serious and critical faults of accessibility, by the rules of axe-core."""
        found = importlib.util.find_spec("axe_playwright_python")
        assert found is not None
        assert found.origin is not None
        self.run(Path(found.origin).with_name("axe.min.js").read_text(encoding="utf-8"))
        report = self.driver.execute_async_script(
            "const done = arguments[0]; axe.run(document, {resultTypes: ['violations']})"
            ".then(found => done(found.violations), error => done([{id: String(error), impact: "
            "'critical', nodes: []}]));"
        )
        return [
            f"{one['id']}: {[node['html'][:150] for node in one['nodes'][:3]]}"
            for one in report
            if one["impact"] in ("serious", "critical")
        ]


@contextmanager
def browser() -> Iterator[Browser]:
    """Start Chromium; it ends with the block."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = CHROMIUM or ""
    for word in OPTIONS:
        options.add_argument(word)
    if os.geteuid() == 0:
        options.add_argument("--no-sandbox")  # Chromium refuses to run as root with it
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    driver.set_script_timeout(PATIENCE)
    try:
        yield Browser(driver)
    finally:
        driver.quit()
