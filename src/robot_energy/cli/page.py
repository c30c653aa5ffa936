"""The energy page of a recording: served, or written to a file."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.cli.numbers import number_type
from robot_energy.errors import PageError
from robot_energy.files.output_files import HTML, write_file

if TYPE_CHECKING:
    from robot_energy.bag_replay import Replay
    from robot_energy.model import RobotModel
    from robot_energy.page.recording import RecordedPage

_port = number_type("port (0 to 65535)", 0.0, 65535.0)


def add_page(parser: ArgumentParser) -> None:
    """Add the options of the page.

    Args:
        parser: Of a command that replays one bag.
    """
    group = parser.add_argument_group("energy page")
    group.add_argument(
        "--serve", action="store_true", help="show the energy page in a browser until Ctrl-C"
    )
    group.add_argument(
        "--port", type=_port, metavar="N", help="port of --serve on this computer (default: any)"
    )
    group.add_argument(
        "--page", metavar="FILE", help="write the energy page as one HTML file that needs no server"
    )
    group.add_argument(
        "--page-settings", metavar="FILE", help="prices and emission factor of the page (YAML)"
    )


def recorded_page(args: Namespace, model: RobotModel) -> RecordedPage | None:
    """Return the page to fill, or None where none is asked for.

    Args:
        args: Of the command.
        model: The robot's model.

    Raises:
        PageError: If the settings cannot be used, or an option needs another.
    """
    if args.port is not None and not args.serve:
        raise PageError("--port was given without --serve", "--serve --port N")
    if not args.serve and args.page is None:
        if args.page_settings is not None:
            raise PageError("--page-settings was given without a page", "--serve or --page FILE")
        return None
    from robot_energy.page.recording import RecordedPage
    from robot_energy.page.settings import load_settings

    settings = load_settings(args.page_settings or "")
    return RecordedPage(Path(args.bag).name, model, settings)


def write_page(args: Namespace, page: RecordedPage | None, result: Replay) -> None:
    """Complete the page, and write it if a file is named.

    Args:
        args: Of the command.
        page: The page; None for none.
        result: Of the replay that filled it.
    """
    if page is None:
        return
    page.finish(result)
    if args.page is not None:
        from robot_energy.page.saved_page import saved_page

        write_file(args.page, saved_page(page.state()).encode(), HTML, "the energy page")


def serve_page(args: Namespace, page: RecordedPage | None) -> None:
    """Serve the page until the command is stopped.

    Args:
        args: Of the command.
        page: The page; None for none.

    Raises:
        PageError: If the port cannot be used.
    """
    if page is None or not args.serve:
        return
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
