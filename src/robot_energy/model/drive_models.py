"""Table of the drive models: from shaft power to electrical input, motor side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, model_validator

from robot_energy.foundation.kinds import Kind, Kinds, Part
from robot_energy.model.figure import ModelEntry, Number, PositiveFigure, Tag

if TYPE_CHECKING:
    from robot_energy.model.joint import Joint

COPPER_COEFFICIENT = PositiveFigure(
    value=0.0039, tag="assumed", source="copper, usual textbook figure"
)


class LossDrive(ModelEntry):
    """P_el = P_mech + c0 + c1 |w| + c2 w^2 + copper (1 + alpha (T - 20)) tau^2, motor side."""

    constant: Annotated[PositiveFigure, "c0. [W]"]
    linear: Annotated[PositiveFigure, "c1. [W s/rad]"]
    quadratic: Annotated[PositiveFigure, "c2. [W s^2/rad^2]"]
    copper: Annotated[
        PositiveFigure, "Copper loss per squared motor torque with windings at 20 degC. [W/(N m)^2]"
    ]
    copper_temperature_coefficient: Annotated[PositiveFigure, "alpha. [1/K]"] = COPPER_COEFFICIENT


class EfficiencyMap(ModelEntry):
    """Reduced efficiency map of one drive (paper B, section 6): points in four quadrants."""

    motor_velocity: Annotated[list[Number], Field(min_length=1), "Speeds of the points. [rad/s]"]
    motor_torque: Annotated[list[Number], Field(min_length=1), "Torques of the points. [N m]"]
    efficiency: Annotated[
        list[Number],
        Field(min_length=1),
        "P_mech / P_el at the points, not 0; above 1 in the generating quadrants. [-]",
    ]
    reach: Annotated[
        Number,
        Field(gt=0),
        "Standardised distance to the nearest point beyond which the result is flagged as "
        "extrapolated. [-]",
    ] = 0.5
    tag: Annotated[Tag, "How the points are known."]
    source: Annotated[str, "Where they come from."] = ""

    @model_validator(mode="after")
    def _check(self) -> EfficiencyMap:
        lengths = {len(self.motor_velocity), len(self.motor_torque), len(self.efficiency)}
        if len(lengths) != 1:
            raise ValueError("motor_velocity, motor_torque and efficiency differ in length")
        if any(abs(value) < 1e-3 for value in self.efficiency):
            raise ValueError("an efficiency of 0 gives no finite electrical power")
        return self


class LossMap(ModelEntry):
    """P_el = P_mech + L(|w|, |tau| sqrt(1 + alpha (T - 20))), L bilinear between knots, motor side.

    Beyond the last knots L continues along its last slopes, flagged as extrapolated.
    """

    motor_velocity: Annotated[
        list[Number], Field(min_length=2), "Knots of the speed, from 0, rising. [rad/s]"
    ]
    motor_torque: Annotated[
        list[Number],
        Field(min_length=2),
        "Knots of the torque that heats windings at 20 degC alike, from 0, rising. [N m]",
    ]
    loss: Annotated[
        list[list[Annotated[Number, Field(ge=0)]]],
        "L, one row per speed, >= 0 and nowhere falling along either axis. [W]",
    ]
    copper_temperature_coefficient: Annotated[PositiveFigure, "alpha. [1/K]"] = COPPER_COEFFICIENT
    tag: Annotated[Tag, "How the losses are known."]
    source: Annotated[str, "Where they come from."] = ""

    @model_validator(mode="after")
    def _check(self) -> LossMap:
        for name in ("motor_velocity", "motor_torque"):
            knots: list[float] = getattr(self, name)
            if knots[0] != 0.0 or any(b <= a for a, b in pairwise(knots)):
                raise ValueError(f"{name} must rise from 0, found {knots}")
        lengths = {len(row) for row in self.loss}
        if len(self.loss) != len(self.motor_velocity) or lengths != {len(self.motor_torque)}:
            raise ValueError(
                f"loss must have {len(self.motor_velocity)} rows of {len(self.motor_torque)}"
            )
        for line in (*self.loss, *zip(*self.loss, strict=True)):
            if any(b < a for a, b in pairwise(line)):
                raise ValueError("loss falls with speed or torque")
        return self


@dataclass(frozen=True, kw_only=True)
class DriveModel(Kind):
    """One kind of drive model. Only name, label, line and physics are needed.

    Attributes:
        key: Of its entry at every joint of a model file; empty if it has none.
        entry: Schema of that entry.
        physics: Makes a `robot_energy.physics.drives_and_cabinet.Drive` of all joints' entries.
        constant_loss: Loss of an entry that flows whether the drive moves or not. [W]
        lossless: Whether drive losses are missing from the energy.
        deviation: Makes a `robot_energy.certainty.figure_deviations.DriveDeviation` of the entries
            of all joints; None for a share of the loss.
        loss_deviations: Makes a `robot_energy.certainty.figure_deviations.LossDeviations` of the
            entries of all joints: what the error of each figure alone does; None: a share of it.
        in_identity: Whether the identity of a model counts an absent entry too, as it does
            for the first kinds there were.
        fitted: Makes an entry from what was identified of one axis, a
            `robot_energy_identify.drives.drives.AxisFit` with the samples of the drive, and the
            source; None where they do not determine it. None for a kind that has no fit. A kind
            with one takes part in the comparison on held-out data, and is chosen if it is best.
        way: Name of that fit in the comparison; empty: the name of the kind.
    """

    key: str = ""
    entry: type[ModelEntry] | None = None
    physics: Callable[[list[Any]], Any] | None = None
    constant_loss: Callable[[Any], float] = lambda entry: 0.0
    lossless: bool = False
    deviation: Callable[[list[Any]], Any] | None = None
    loss_deviations: Callable[[list[Any]], Any] | None = None
    figures: tuple[tuple[str, str, str], ...] = ()
    in_identity: bool = False
    fitted: Callable[[Any, str], Any] | None = None
    way: str = ""

    def of(self, joint: Joint) -> Any:
        """Return the entry of a joint; None if it has none."""
        return getattr(joint, self.key, None) if self.key else None

    def entries(self, joints: list[Joint]) -> list[Any]:
        """Return the entries of the joints that have one, in their order."""
        return [entry for joint in joints if (entry := self.of(joint)) is not None]


DRIVE_MODELS = Kinds(
    "drive model",
    DriveModel(
        name="ideal",
        label="ideal",
        line="electrical input is shaft power (paper A, eq. 6)",
        physics=Part("robot_energy.physics.drives_and_cabinet:ideal"),
        lossless=True,
    ),
    DriveModel(
        name="efficiency_map",
        label="efficiency map",
        line="shaft power over the efficiency of the nearest measured torque and speed (paper B)",
        key="efficiency_map",
        entry=EfficiencyMap,
        physics=Part("robot_energy.physics.drives_and_cabinet:EfficiencyMaps"),
        fitted=Part("robot_energy_identify.drives.efficiency_map:fitted_map"),
        way="map",
        in_identity=True,
    ),
    DriveModel(
        name="loss_model",
        label="loss model",
        line="shaft power plus constant, speed-dependent and copper losses",
        key="losses",
        entry=LossDrive,
        physics=Part("robot_energy.physics.drives_and_cabinet:LossModel"),
        deviation=Part("robot_energy.certainty.figure_deviations:loss_model_deviation"),
        loss_deviations=Part("robot_energy.certainty.figure_deviations:loss_model_deviations"),
        fitted=Part("robot_energy_identify.drives.losses:fitted_losses"),
        way="losses",
        in_identity=True,
        constant_loss=lambda entry: entry.constant.value,
        figures=(
            ("constant", "constant loss", "W"),
            ("copper", "copper loss", "W/(N m)^2"),
            ("linear", "linear loss", "W s/rad"),
            ("quadratic", "quadratic loss", "W s^2/rad^2"),
        ),
    ),
    DriveModel(
        name="loss_map",
        label="loss map",
        line="shaft power plus losses over speed and torque, without an assumed form",
        key="loss_map",
        entry=LossMap,
        physics=Part("robot_energy.physics.drives_and_cabinet:LossMaps"),
        fitted=Part("robot_energy_identify.drives.losses:fitted_loss_map"),
        constant_loss=lambda entry: entry.loss[0][0],
    ),
)

register_drive_model = DRIVE_MODELS.register
"""Add a drive model of yours, with its physics and, where it needs figures, key and entry."""
