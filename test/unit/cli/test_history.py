"""The command `history`: what it prints, checks, repairs and refuses."""

import time

import pytest

from histories import MINUTE, Robot
from robot_energy_cli.main import main
from robot_energy_history.readings import LearnedFriction
from robot_energy_history.store import HistoryStore

TARIFF = """
tariffs:
  - {begin: 2020-01-01, timezone: Europe/Berlin, price_per_kwh: 0.3, co2_kg_per_kwh: 0.4}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A history of two robots: the hour before now, 3.6 kW."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    folder = tmp_path / "robot_energy" / "history"
    store = HistoryStore(folder)
    store.open()
    now = time.time_ns() // MINUTE * MINUTE
    for name in ("left", "right"):
        robot = Robot(now=now - 60 * MINUTE, start=now - 60 * MINUTE)
        store.add(name, [robot.minute(3600) for _ in range(60)])
    job = dict.fromkeys(
        ("gap_ns", "compared_ns", "predicted_return_microjoule", "measured_microjoule",
         "predicted_microjoule_at_meter"), 0,
    )  # fmt: skip
    job |= {"id": 1, "start": now - MINUTE, "stop": now, "name": "weld", "peak_power": None,
            "observed_ns": MINUTE, "predicted_import_microjoule": 216_000_000_000}  # fmt: skip
    store.add_jobs("left", [job])
    store.add_friction("left", [LearnedFriction(now, "m1", {"elbow": 1.0625})])
    assert store.write(now)
    store.close()
    return folder


def test_it_shows_robots_jobs_and_costs(folder, tmp_path, capsys):
    path = tmp_path / "tariffs.yaml"
    path.write_text(TARIFF)
    assert main(["history", "tariff", "--add", str(path)]) == 0
    assert (
        "from 2020-01-01 (2019-12-31 23:00 UTC), Europe/Berlin: 0.3 EUR" in capsys.readouterr().out
    )
    assert main(["history", "show", "--start", "2020-01-01", "--resolution", "all"]) == 0
    out = capsys.readouterr().out
    assert out.count("3.6000") == 6  # from the grid, motion and the meter, of each robot
    assert out.count("1.08") == 2
    assert "weld" in out
    assert "shift" not in out
    assert "elbow" in out
    assert "1.062" in out
    path.write_text(TARIFF.replace("0.4}", '0.4, shifts: ["00:00"]}'))
    assert main(["history", "tariff", "--add", str(path)]) == 0
    assert "shifts from 00:00" in capsys.readouterr().out
    assert main(["history", "show", "--start", "2020-01-01", "--resolution", "all"]) == 0
    out = capsys.readouterr().out
    assert "ENERGY BY SHIFT" in out.upper()
    assert out.count("3.6000") == 8
    assert main(["history", "show", "--robots", "left", "--timezone", "Europe/Berlin"]) == 0
    out = capsys.readouterr().out
    assert "TODAY" in out
    assert "right" not in out


def test_it_checks_and_repairs(folder, capsys):
    assert main(["history", "check", str(folder)]) == 0
    assert "the sums of all slots equal the registers" in capsys.readouterr().out
    store = HistoryStore(folder)
    store.open()
    store._connection.execute("DELETE FROM slot15 WHERE robot = 1")
    store.close()
    assert main(["history", "check"]) == 2
    assert f"robot-energy history repair {folder}" in capsys.readouterr().err
    assert main(["history", "repair"]) == 0
    assert "one span" in capsys.readouterr().out
    assert main(["history", "check"]) == 0


def test_it_prints_savings(tmp_path, capsys):
    store, robot = HistoryStore(tmp_path), Robot()
    store.open()
    for day in range(40):
        for _ in range(24):
            robot.advance(60 * MINUTE, 1000 + day % 3 - 100 * (day >= 20))
            store.add("a", [robot.read(robot.now)])
        assert store.write(robot.now)
    store.close()
    path = tmp_path / "further.csv"
    path.write_text(
        "date,ambient\n" + "".join(f"2026-01-{day:02d},{day % 3}\n" for day in range(1, 31))
    )
    words = f"history savings {tmp_path} --robot a --drivers on_hours".split()
    words += "--baseline 2026-01-01:2026-01-21 --reported 2026-01-21:2026-02-10".split()
    assert main([*words, "--further", str(path)]) == 0
    out = capsys.readouterr().out
    assert "10.0%" in out
    assert "a saving" in out
    assert "ambient" in out
    assert "10 reported days are left out" in " ".join(out.split())
    for more, said in ((["--further", "none.csv"], "none.csv"), (["--baseline", "x"], "two days"),
                       (["--drivers", "mood"], "mood")):  # fmt: skip
        assert main([*words, *more]) == 2
        assert said in capsys.readouterr().err


def test_it_refuses_what_is_not_there(folder, tmp_path, capsys):
    for words, said in (
        (["show", str(tmp_path)], "there is no history"),
        (["show", "--timezone", "Mars"], "expected a time zone"),
        (["show", "--robots", "third"], "no robot 'third'"),
        (["tariff", "--add", str(tmp_path / "none.yaml")], "none.yaml"),
    ):
        assert main(["history", *words]) == 2
        assert said in capsys.readouterr().err
