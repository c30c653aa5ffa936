"""The energy page of a bag from the command: served until it is stopped."""

import re
import signal
import subprocess
import sys

import pytest

from page_client import request, state_of
from page_messages import BAGS
from robot_energy_cli import main

REPLAY = ["replay", str(BAGS / "kr16_cold"), "--model", "kr16"]


def test_a_page_is_served_until_the_command_is_stopped(tmp_path):
    settings = tmp_path / "page.yaml"
    settings.write_text("price_per_kwh: 0.5\n")
    words = [*REPLAY, "--serve", "--page-settings", str(settings)]
    process = subprocess.Popen(
        [sys.executable, "-m", "robot_energy", *words], stdout=subprocess.PIPE, text=True
    )
    try:
        url = next(
            found[1] for line in process.stdout if (found := re.search(r"(http://\S+)", line))
        )
        assert request(url)[0] == 200
        robot = state_of(url)["robots"][0]
        joule = robot["registers"]["predicted_import_energy"]
        assert robot["headline"]["cost"] == pytest.approx(joule / 3.6e6 * 0.5)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
    finally:
        process.kill()
        process.stdout.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--port", "8080"], "--serve"),
        (["--page-settings", "x.yaml"], "--serve or --report"),
        (["--serve", "--page-settings", "/nowhere/x.yaml"], "cannot be read"),
        (["--serve", "--port", "70000"], "port"),
    ],
)
def test_options_that_make_no_sense_are_refused(words, said, capsys):
    assert main([*REPLAY, *words]) == 2
    assert said in capsys.readouterr().err
