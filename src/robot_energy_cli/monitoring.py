"""`robot-energy monitoring`: files for Prometheus and Grafana.

Write prometheus.yaml, alert_rules.yaml, grafana.json and grafana_history.json into a folder: a
configuration of Prometheus that reads /metrics of the energy page, alert rules, and dashboards
to import into Grafana, the second on the PostgreSQL table that `history export` fills.

examples:
  robot-energy monitoring --out monitoring
  robot-energy monitoring --out monitoring --target robot-cell:8421 --token-file /etc/token
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import PageError
from robot_energy.foundation.files.output_files import COMMENT, JSON, TEXT, check_file, write_file
from robot_energy.foundation.files.placement import all_or_none
from robot_energy.foundation.shown_text import shown
from robot_energy_cli.command import REQUIRED, Command, Options

AS_THEY_ARE = ("alert_rules.yaml", "grafana.json", "grafana_history.json")
OPTIONS: Options = {
    "--out FOLDER": ("folder for the four files", REQUIRED),
    "--target HOST:PORT": ("the energy page", {"default": "127.0.0.1:8421"}),
    "--token-file FILE": ("file with its token, for Prometheus", {"default": ""}),
}


def _run(args: Namespace) -> int:
    from importlib.resources import files as resources

    folder = Path(args.out)
    if folder.exists() and not folder.is_dir():
        raise PageError(f"'{shown(args.out)}' is not a folder", "a folder, which may be new")
    folder.mkdir(exist_ok=True)
    ready = resources("robot_energy_report.page") / "grafana"
    files = {
        "prometheus.yaml": _scrape_config(args.target, args.token_file).encode(),
        **{name: (ready / name).read_bytes() for name in AS_THEY_ARE},
    }
    with all_or_none():
        for name, content in files.items():
            kind = JSON if name.endswith(".json") else TEXT
            check_file(folder / name, kind, name)
            write_file(folder / name, content, kind, name)
    print(f"written to {shown(args.out)}: {', '.join(files)}")
    return 0


def _scrape_config(target: str, token_file: str) -> str:
    """The token lies in a file on the computer of Prometheus."""
    import yaml

    job: dict[str, Any] = {"job_name": "robot_energy", "static_configs": [{"targets": [target]}]}
    if token_file:
        job["authorization"] = {"credentials_file": token_file}
    config = {
        "global": {"scrape_interval": "5s", "evaluation_interval": "5s"},
        "rule_files": ["alert_rules.yaml"],
        "scrape_configs": [job],
    }
    return COMMENT + yaml.safe_dump(config, sort_keys=False, width=1000)


COMMAND = Command.of(__doc__, _run, OPTIONS)
