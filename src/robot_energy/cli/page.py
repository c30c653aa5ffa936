"""The energy page of a recording, served; prices and emissions of page and report."""

from __future__ import annotations

import time
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.cli.command import Options
from robot_energy.cli.numbers import number_type
from robot_energy.errors import PageError

if TYPE_CHECKING:
    from robot_energy.bag_replay import Replay
    from robot_energy.model import RobotModel
    from robot_energy.page.recording import RecordedPage
    from robot_energy.page.settings import PageSettings

_port = number_type("port (0 to 65535)", 0.0, 65535.0)


PAGE_SETTINGS: Options = {"--page-settings FILE": "prices and emission factor (YAML)"}
PAGE: Options = {
    "--serve": "show the energy page in a browser until Ctrl-C",
    "--port N": ("port of --serve on this computer (default: any)", {"type": _port}),
    **PAGE_SETTINGS,
}


def page_settings(args: Namespace) -> PageSettings:
    """Return prices and emissions.

    Args:
        args: Of a command that shows a page or writes a report.

    Raises:
        PageError: If the file cannot be used, or nothing is shown.
    """
    from robot_energy.page.settings import load_settings

    if args.page_settings is not None and not args.serve and args.report is None:
        raise PageError("--page-settings was given alone", "--serve or --report FILE")
    return load_settings(args.page_settings or "")


def recorded_page(
    args: Namespace, model: RobotModel, settings: PageSettings
) -> RecordedPage | None:
    """Return the page to fill, or None where none is asked for.

    Args:
        args: Of the command.
        model: The robot's model.
        settings: Prices and emissions.

    Raises:
        PageError: If the settings cannot be used, or an option needs another.
    """
    if args.port is not None and not args.serve:
        raise PageError("--port was given without --serve", "--serve --port N")
    if not args.serve:
        return None
    from robot_energy.page.recording import RecordedPage

    return RecordedPage(Path(args.bag).name, model, settings)


def serve_page(args: Namespace, page: RecordedPage | None, result: Replay) -> None:
    """Serve the page until the command is stopped.

    Args:
        args: Of the command.
        page: The page; None for none.
        result: Of the replay that filled it.

    Raises:
        PageError: If the port cannot be used.
    """
    if page is None:
        return
    page.finish(result)
    from robot_energy.page.access import page_access
    from robot_energy.page.web_server import PageServer

    access = page_access(port=int(args.port or 0))
    server = PageServer(page.hub, access)
    try:
        for sentence in access.sentences(server.url):
            print(sentence, flush=True)
        while True:
            time.sleep(3600.0)
    finally:
        server.close()
