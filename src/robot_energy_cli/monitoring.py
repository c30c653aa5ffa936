"""`robot-energy monitoring`: files with which Prometheus and Grafana read the energy page."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from robot_energy.foundation.errors import PageError
from robot_energy.foundation.files.output_files import (
    JSON,
    TEXT,
    check_file,
    json_bytes,
    write_file,
)
from robot_energy.foundation.files.placement import all_or_none
from robot_energy.foundation.shown_text import shown
from robot_energy_cli.command import REQUIRED, Command, Options

DESCRIPTION = """\
Write prometheus.yaml, alert_rules.yaml, grafana.json and grafana_history.json into a folder: a
configuration of Prometheus that reads /metrics of the energy page, alert rules, and dashboards to
import into Grafana, the second on the PostgreSQL table that `history export` fills.
"""
EPILOG = """\
examples:
  robot-energy monitoring --out monitoring
  robot-energy monitoring --out monitoring --target robot-cell:8421 --token-file /etc/token
"""


OPTIONS: Options = {
    "--out FOLDER": ("folder for the four files", REQUIRED),
    "--target HOST:PORT": "the energy page",
    "--token-file FILE": ("file with its token, for Prometheus", {"default": ""}),
}


def _run(args: Namespace) -> int:
    from robot_energy_report.page.monitoring import (
        DEFAULT_TARGET,
        alert_rules,
        grafana_dashboard,
        history_dashboard,
        scrape_config,
    )

    folder = Path(args.out)
    if folder.exists() and not folder.is_dir():
        raise PageError(f"'{shown(args.out)}' is not a folder", "a folder, which may be new")
    folder.mkdir(exist_ok=True)
    texts = {
        "prometheus.yaml": scrape_config(args.target or DEFAULT_TARGET, args.token_file),
        "alert_rules.yaml": alert_rules(),
    }
    dashboards = {
        "grafana.json": grafana_dashboard(),
        "grafana_history.json": history_dashboard(),
    }
    with all_or_none():
        for name, text in texts.items():
            check_file(folder / name, TEXT, name)
            write_file(folder / name, text.encode(), TEXT, name)
        for name, dashboard in dashboards.items():
            check_file(folder / name, JSON, name)
            write_file(folder / name, json_bytes(dashboard), JSON, name)
    print(f"written to {shown(args.out)}: {', '.join([*texts, *dashboards])}")
    return 0


COMMAND = Command(
    "monitoring", "files for Prometheus and Grafana", _run, OPTIONS, DESCRIPTION, EPILOG
)
