"""Files for Prometheus and Grafana, made from the metrics that the page has."""

from __future__ import annotations

from typing import Any

import yaml

from robot_energy.foundation.files.output_files import COMMENT
from robot_energy.foundation.units import JOULE_PER_KWH
from robot_energy.history.outputs import TABLE
from robot_energy_report.page.metrics import METRICS

DEFAULT_TARGET = "127.0.0.1:8421"
SQL_SOURCE = "grafana-postgresql-datasource"
HISTORY_KWH = "sum(predicted_import_microjoule) / 3.6e12"
HISTORY_PARTS = {
    "friction": "friction", "motors and drives": "drive_loss", "motion": "rigid",
    "brake resistor": "brake", "cabinet, DC side": "loss_dc", "cabinet, grid side": "loss_grid",
}  # fmt: skip
WIDTH = 24  # of a Grafana dashboard [columns]


def _sample(name: str, labels: str = "") -> str:
    """Name of a metric as queries use it; a name that the page lacks is an error."""
    return f"{METRICS[name].sample}{{{labels}}}"


def _of_robot(name: str, labels: str = "") -> str:
    return _sample(name, 'robot=~"$robot"' + (f",{labels}" if labels else ""))


def scrape_config(target: str = DEFAULT_TARGET, token_file: str = "") -> str:
    """Return a configuration with which Prometheus reads a page and the alert rules.

    Args:
        token_file: File with the token, on the computer of Prometheus; empty for none.
    """
    job: dict[str, Any] = {"job_name": "robot_energy", "static_configs": [{"targets": [target]}]}
    if token_file:
        job["authorization"] = {"credentials_file": token_file}
    return _yaml(
        {
            "global": {"scrape_interval": "5s", "evaluation_interval": "5s"},
            "rule_files": ["alert_rules.yaml"],
            "scrape_configs": [job],
        }
    )


def alert_rules() -> str:
    """Return alert rules of Prometheus as YAML."""
    measured = _sample("robot_energy_at_meter_joules", 'source="measured"')
    predicted = _sample("robot_energy_at_meter_joules", 'source="predicted"')
    hour = f"delta({predicted}[1h]) / ignoring(source) delta({measured}[1h])"
    gap = f"increase({_sample('robot_energy_gap_seconds')}[15m])"
    observed = f"increase({_sample('robot_energy_observed_seconds')}[15m])"
    temperature = _sample("robot_joint_temperature_celsius")
    errors = _sample("robot_energy_findings", 'level="error"')
    rules = [
        ("RobotEnergyStale", f"{_sample('robot_energy_up')} == 0", "1m",
         "No power state of {{ $labels.robot }} arrives",
         "Check that its monitor runs, is active, and receives joint states."),
        ("RobotEnergyPageMissing", f"absent({_sample('robot_energy_up')})", "2m",
         "The energy page cannot be read",
         "Check that the dashboard runs and that Prometheus reaches its address."),
        ("RobotEnergyFinding", f"{errors} > 0", "1m",
         "A diagnostic status of {{ $labels.robot }} is an error",
         "Read the alarms on its energy page."),
        ("RobotEnergyNotOnDisk", f"{_sample('robot_energy_persisted')} == 0", "5m",
         "The registers of {{ $labels.robot }} are in memory only",
         "Check space and permissions of the state folder."),
        ("RobotEnergyGaps", f"{gap} / ({gap} + {observed}) > 0.05", "5m",
         "More than 5 % of the time of {{ $labels.robot }} is a gap",
         "Check rate and losses of its joint states."),
        ("RobotEnergyOffMeter", f"abs({hour} - 1) > 0.1", "15m",
         "Prediction and meter of {{ $labels.robot }} differ by more than 10 % over an hour",
         "Check the meter, the payload and the model; wear shows like this too."),
        ("RobotMotorHot", f"{temperature} > 100", "5m",
         "{{ $labels.joint }} of {{ $labels.robot }} is above 100 degC",
         "Let it cool, and look for the cause."),
    ]  # fmt: skip
    listed = [
        {
            "alert": name,
            "expr": expression,
            "for": time,
            "labels": {"severity": "warning"},
            "annotations": {"summary": summary, "description": remedy},
        }
        for name, expression, time, summary, remedy in rules
    ]
    return _yaml({"groups": [{"name": "robot_energy", "rules": listed}]})


def grafana_dashboard() -> dict[str, Any]:
    """Return a dashboard for Grafana 10 and later; its data source is chosen at import."""
    used = _of_robot("robot_energy_joules", 'part="predicted_import"')
    friction = _of_robot("robot_joint_friction_energy_joules")
    drives = _of_robot("robot_joint_drive_loss_energy_joules")
    predicted, measured = (
        _of_robot("robot_energy_at_meter_joules", f'source="{source}"')
        for source in ("predicted", "measured")
    )
    error = f"{predicted} / ignoring(source) {measured} - 1"
    cabinet = _of_robot("robot_energy_joules", 'part=~"cabinet_.*|brake_resistor"')
    parts = [
        ("friction", f"sum by (robot) (rate({friction}[$__rate_interval]))"),
        ("motors and drives", f"sum by (robot) (rate({drives}[$__rate_interval]))"),
        ("{{part}}", f"rate({cabinet}[$__rate_interval])"),
    ]
    panels = [
        _panel("stat", "Energy", "kwatth", 6, 5,
               [("{{robot}}", f"increase({used}[$__range]) / {JOULE_PER_KWH:g}")]),
        _panel("stat", "Power now", "watt", 6, 5,
               [("{{robot}}", _of_robot("robot_power_watts", 'source="predicted"'))]),
        _panel("stat", "Prediction against meter", "percentunit", 6, 5, [("{{robot}}", error)]),
        _panel("stat", "Power states arrive", "bool_yes_no", 6, 5,
               [("{{robot}}", _of_robot("robot_energy_up"))]),
        _panel("timeseries", "Power", "watt", 24, 9,
               [("{{robot}} {{source}}",
                 _of_robot("robot_power_watts", 'source=~"predicted|measured"'))]),
        _panel("timeseries", "Where the power goes", "watt", 12, 9, parts, stacked=True),
        _panel("timeseries", "Friction by joint", "watt", 12, 9,
               [("{{robot}} {{joint}}", f"rate({friction}[$__rate_interval])")], stacked=True),
        _panel("timeseries", "Motor temperatures", "celsius", 12, 8,
               [("{{robot}} {{joint}}", _of_robot("robot_joint_temperature_celsius"))]),
        _panel("timeseries", "Findings", "short", 12, 8,
               [("{{robot}} {{level}}", _of_robot("robot_energy_findings"))]),
    ]  # fmt: skip
    variables = [
        {"name": "source", "label": "Prometheus", "type": "datasource", "query": "prometheus"},
        {"name": "robot", "label": "Robot", "type": "query", "multi": True, "includeAll": True,
         "datasource": {"type": "prometheus", "uid": "${source}"},
         "query": f"label_values({METRICS['robot_energy_up'].sample}, robot)", "refresh": 2},
    ]  # fmt: skip
    shown = {"refresh": "10s", "time": {"from": "now-1h", "to": "now"}}
    return _dashboard("Robot energy", "robot-energy", variables, panels, shown)


def history_dashboard() -> dict[str, Any]:
    """Return a dashboard for Grafana 10.3 and later on the table that `history export` fills."""
    kwh = {name: f"sum({name}_microjoule) / 3.6e12" for name in HISTORY_PARTS.values()}
    day = "date_trunc('day', begin)"
    parts = ", ".join(f'{kwh[column]} AS "{name}"' for name, column in HISTORY_PARTS.items())
    standby = "sum(standby_microjoule) / 3.6e12"
    panels = [
        _sql_panel("stat", "Energy", "kwatth", 8, 5, f"SELECT robot, {HISTORY_KWH} AS energy",
                   "GROUP BY robot"),
        _sql_panel("stat", "Cost", "none", 8, 5, "SELECT robot, sum(cost) AS cost",
                   "GROUP BY robot"),
        _sql_panel("stat", "Standby", "kwatth", 8, 5, f"SELECT robot, {standby} AS standby",
                   "GROUP BY robot"),
        _sql_panel("timeseries", "Energy of each day", "kwatth", 24, 9,
                   f"SELECT {day} AS time, robot AS metric, {HISTORY_KWH} AS value",
                   "GROUP BY 1, 2 ORDER BY 1"),
        _sql_panel("timeseries", "Where it goes", "kwatth", 24, 9,
                   f"SELECT {day} AS time, {parts}", "GROUP BY 1 ORDER BY 1"),
        _sql_panel("table", "Standby while nobody works", "none", 12, 7,
                   "SELECT robot, sum(standby_night_cost) AS night, "
                   "sum(standby_weekend_cost) AS weekend", "GROUP BY robot ORDER BY 1"),
        _sql_panel("table", "Not observed", "h", 12, 7,
                   "SELECT robot, sum(gap_ns) / 3.6e12 AS gap", "GROUP BY robot ORDER BY 1"),
    ]  # fmt: skip
    variables = [
        {"name": "source", "label": "PostgreSQL", "type": "datasource", "query": SQL_SOURCE},
        {"name": "robot", "label": "Robot", "type": "query", "multi": True, "includeAll": True,
         "datasource": {"type": SQL_SOURCE, "uid": "${source}"},
         "query": f"SELECT DISTINCT robot FROM {TABLE} ORDER BY 1", "refresh": 2},
    ]  # fmt: skip
    shown = {"time": {"from": "now-30d", "to": "now"}}
    return _dashboard("Robot energy: history", "robot-energy-history", variables, panels, shown)


def _dashboard(
    title: str, uid: str, variables: list[Any], panels: list[dict[str, Any]], shown: Any
) -> dict[str, Any]:
    """A dashboard whose panels stand in rows."""
    x = y = height = 0
    for number, panel in enumerate(panels, 1):
        place = panel["gridPos"]
        if x + place["w"] > WIDTH:
            x, y, height = 0, y + height, 0
        panel |= {"id": number, "gridPos": place | {"x": x, "y": y}}
        x, height = x + place["w"], max(height, place["h"])
    return {
        "title": title,
        "uid": uid,
        "tags": ["robot", "energy"],
        "schemaVersion": 38,
        **shown,
        "templating": {"list": variables},
        "panels": panels,
    }


def _sql_panel(
    kind: str, title: str, unit: str, width: int, height: int, select: str, group: str
) -> dict[str, Any]:
    query = (
        f"{select} FROM {TABLE} WHERE resolution = 'quarter' AND $__timeFilter(begin) "
        f"AND robot IN (${{robot:sqlstring}}) {group}"
    )
    panel = _panel(kind, title, unit, width, height, [], stacked=True)
    source = {"type": SQL_SOURCE, "uid": "${source}"}
    target = {
        "refId": "A", "datasource": source, "rawQuery": True, "editorMode": "code",
        "format": "time_series" if kind == "timeseries" else "table", "rawSql": query,
    }  # fmt: skip
    return {**panel, "datasource": source, "targets": [target]}


def _panel(
    kind: str,
    title: str,
    unit: str,
    width: int,
    height: int,
    queries: list[tuple[str, str]],
    stacked: bool = False,
) -> dict[str, Any]:
    source = {"type": "prometheus", "uid": "${source}"}
    custom = {"fillOpacity": 30, "stacking": {"mode": "normal"}} if stacked else {"fillOpacity": 5}
    return {
        "type": kind,
        "title": title,
        "datasource": source,
        "gridPos": {"w": width, "h": height},
        "fieldConfig": {
            "defaults": {"unit": unit, **({"custom": custom} if kind == "timeseries" else {})},
            "overrides": [],
        },
        "targets": [
            {"refId": chr(ord("A") + place), "datasource": source, "expr": query,
             "legendFormat": legend}
            for place, (legend, query) in enumerate(queries)
        ],
    }  # fmt: skip


def _yaml(values: dict[str, Any]) -> str:
    return COMMENT + yaml.safe_dump(values, sort_keys=False, width=1000)
