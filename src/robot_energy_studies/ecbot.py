"""Total electrical power of real cobots, each recording predicted by a fit to the others.

The measure is that of EcBot (Heredia, Schlette, Kjaergaard, ICAR 2023, arXiv 2508.06276): the RMS
error of total power on data that no fit has seen. Recordings are those of public sets with measured
power of the whole robot; `WITHOUT` says why others are not among them. They are not part of the
project: the folder is named by the user.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.model import RobotModel, load
from robot_energy.replay.bag_replay import replay
from robot_energy.results.base import json_value
from robot_energy.timeline.blocks import Float
from robot_energy_identify.api.bag_source import BagSource
from robot_energy_identify.drives.drive_data import DriveData, drive_data, drive_data_of_logs
from robot_energy_identify.drives.total_power import fit_structure, fit_total, predict
from robot_energy_identify.drives.total_sums import Sums, sums
from robot_energy_identify.stats.cross_validation import rms_of
from robot_energy_logs.log_formats import LOG_FORMATS
from robot_energy_logs.log_import import contents_of, open_logs
from robot_energy_logs.mapping import load_mapping
from robot_energy_papers.job_pool import StudyRun
from robot_energy_papers.pages import Piece

DATA = "ROBOT_ENERGY_DATA"  # names the folder of the recordings
ECBOT_TRAIN, ECBOT_TEST = (1.42, 2.80), (1.45, 5.25)  # W, of four robots
EXAMPLES = Path(__file__).parents[1] / "examples"
WITHOUT = {
    "ur3_cobotops": "UR3: currents, temperatures and speeds of the joints; no power, no voltage, "
    "no positions",
    "xarm6_j3": "xArm 6: current of one joint; no power, no voltage",
    "kr300": "KR 300: torques; no power, and no cobot",
    "tx40": "TX40: drive signals; no power, and no cobot",
}
"""Sets without power of the whole robot, by folder."""


class TestedRecording(Described):
    """One recording that no fit has seen."""

    name: str
    readings: int
    duration: Annotated[float, "That they cover. [s]"]
    mean_power: Annotated[float, "Measured. [W]"]
    rms: Annotated[float, "Error of the power. [W]"]
    energy_error: Annotated[float, "Predicted over measured energy minus 1. [-]"]
    tool_path: Annotated[float | None, "Way of the tool; None without kinematics. [m]"]
    body_work: Annotated[float | None, "What lifted and moved bodies; None without a model. [J]"]

    @property
    def energy_per_metre(self) -> float | None:
        """Measured energy over the path of the tool. [J/m]"""
        return None if not self.tool_path else self.mean_power * self.duration / self.tool_path

    @property
    def body_work_share(self) -> float | None:
        """Work on the bodies over the measured energy. [-]"""
        return (
            None if self.body_work is None else self.body_work / (self.mean_power * self.duration)
        )


class TestedRobot(Described):
    """One robot."""

    robot: str
    meter: str
    torque: Annotated[str, "Where the torque comes from, in words."]
    rate: Annotated[float, "Of the readings. [Hz]"]
    train_rms: Annotated[float, "Error of a fit to all recordings, on the same. [W]"]
    rms: Annotated[float, "Error on recordings that the fit has not seen. [W]"]
    constant_rms: Annotated[float, "The same of a constant power. [W]"]
    spread: Annotated[float, "Standard deviation of the measured power. [W]"]
    mean_power: Annotated[float, "Measured. [W]"]
    recordings: tuple[TestedRecording, ...]

    @property
    def of_mean(self) -> float:
        """Held-out error over the mean power. [-]"""
        return self.rms / self.mean_power

    @property
    def of_spread(self) -> float:
        """Held-out error over the standard deviation of the power; 1 says nothing. [-]"""
        return self.rms / self.spread


def data_folder(given: str | None = None) -> Path:
    """Return the folder of the recordings."""
    folder = Path(given or os.environ.get(DATA, "") or "-")
    if not (folder / "rad_ur3e").is_dir() or not (folder / "voraus").is_dir():
        raise ReportError(
            f"no recordings of robots in '{folder}'",
            "a folder with rad_ur3e/L*.csv and voraus/test.parquet",
            f"name it with --data or {DATA}; src/doc/reproduce.md says where they are published",
        )
    return folder


def study(options: StudyRun, folder: Path) -> tuple[TestedRobot, ...]:
    """Return the test of each robot."""
    done = options.steps(2)
    robots: list[TestedRobot] = []
    for test, place in ((_ur3e, "rad_ur3e"), (_yu_cobot, "voraus/test.parquet")):
        robots.append(test(folder / place))
        done()
    return tuple(robots)


def _ur3e(folder: Path) -> TestedRobot:
    """A UR3e by the RTDE interface; its controller reports voltage and current of the 48 V bus."""
    model, files = load("ur3e"), sorted(folder.glob("L*.csv"))
    recording = LOG_FORMATS["ur-rtde"].recording
    assert recording is not None
    with TemporaryFolder() as scratch:
        bags = [
            recording(str(file), scratch.path / file.stem, model.joint_names).bag for file in files
        ]
        data = drive_data(BagSource(bags).recordings(model), [None] * len(bags), False)
        # who observes a replay lets it keep joint positions
        replays = [replay(bag, model, on_output=lambda _: None).work for bag in bags]
        work = [(one.tool_path, one.body_work) for one in replays]
    names = [file.stem.removesuffix(".unix") for file in files]
    return tested(
        "UR3e (Universal Robots)", "DC bus, 48 V: controller's voltage x current",
        "model: shipped bodies and friction, nothing fitted", data, model, names, work,
    )  # fmt: skip


def _yu_cobot(file: Path) -> TestedRobot:
    return tested(
        "Yu-Cobot (Yuanda, voraus controller)", "DC supply: voltage x current",
        "measured motor torque", cobot_data(file), None, None, None,
    )  # fmt: skip


def cobot_data(file: Path) -> DriveData:
    """Return a Yu-Cobot with measured power of its supply and torque of each motor."""
    mapping = load_mapping(EXAMPLES / "mappings" / "voraus.yaml")
    logs = open_logs([str(file)], mapping)
    effort = mapping.joints.effort
    parts = [(contents_of(logs, mapping), [log.whole()]) for log in logs]
    return drive_data_of_logs(parts, "" if effort is None else effort.si_unit)


def tested(
    robot: str,
    meter: str,
    torque: str,
    data: DriveData,
    model: RobotModel | None,
    names: Sequence[str] | None,
    work: Sequence[tuple[float, float]] | None,
) -> TestedRobot:
    """Return how well each recording is predicted by a fit to the others.

    Structure and figures of a fit are chosen without the recording that it is tested on.

    Args:
        work: Path of the tool [m] and work on the bodies [J] of each; None where not known.
    """
    pieces = sums(data, model)
    numbers = np.unique(pieces.recording).tolist()
    predicted, constant = np.empty(len(pieces)), np.empty(len(pieces))
    rows: list[TestedRecording] = []
    for place, number in enumerate(numbers):
        out = pieces.recording == number
        train, test = replace(pieces, deviations=False)[~out], pieces[out]
        predicted[out] = predict(test, fit_total(train))
        constant[out] = predict(test, fit_structure(train, "constant"))
        path, moved = (None, None) if work is None else work[place]
        rows.append(
            TestedRecording(
                name=str(place + 1) if names is None else names[place],
                readings=len(test),
                duration=float(test.duration.sum()),
                mean_power=_mean(test.measured, test),
                rms=rms_of(predicted[out] - test.measured),
                energy_error=_mean(predicted[out], test) / _mean(test.measured, test) - 1.0,
                tool_path=path,
                body_work=moved,
            )
        )
    return TestedRobot(
        robot=robot,
        meter=meter,
        torque=torque,
        rate=len(pieces) / float(pieces.duration.sum()),
        train_rms=rms_of(predict(pieces, fit_total(pieces)) - pieces.measured),
        rms=rms_of(predicted - pieces.measured),
        constant_rms=rms_of(constant - pieces.measured),
        spread=float(pieces.measured.std()),
        mean_power=_mean(pieces.measured, pieces),
        recordings=tuple(rows),
    )


def _mean(power: Float, pieces: Sums) -> float:
    """Mean over time. [W]"""
    return float(power @ pieces.duration / pieces.duration.sum())


LABEL = "real recordings, each predicted by a fit that has not seen it"


def figures(result: tuple[TestedRobot, ...]) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1."""
    return {
        "label": LABEL,
        "ecbot": {"train_rms": ECBOT_TRAIN, "test_rms": ECBOT_TEST, "robots": 4},
        "robots": [
            {
                **json_value(robot),
                "rms_over_mean": robot.of_mean,
                "rms_over_spread": robot.of_spread,
                "recordings": [
                    {
                        **json_value(one),
                        "energy_per_metre": one.energy_per_metre,
                        "body_work_share": one.body_work_share,
                    }
                    for one in robot.recordings
                ],
            }
            for robot in result
        ],
        "without_power": WITHOUT,
    }


def context(result: tuple[TestedRobot, ...]) -> dict[str, Any]:
    """Return what the expressions of the templates use."""
    return {
        "robots": result, "label": LABEL, "train": ECBOT_TRAIN, "test": ECBOT_TEST,
        "without": WITHOUT,
    }  # fmt: skip


def pieces(result: tuple[TestedRobot, ...]) -> dict[str, Piece]:
    """Return figures and parts by name: the page has tables alone."""
    del result
    return {}
