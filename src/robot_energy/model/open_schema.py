"""Keeps the schema of model files in step with the tables of drive models and friction laws."""

from __future__ import annotations

from typing import Any, Union

from pydantic.fields import FieldInfo

from robot_energy.foundation.schema_errors import forget_schemas
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.model.joint import Joint, JointFriction
from robot_energy.model.schema import RobotModel

OWN_KEYS = frozenset(Joint.model_fields)  # declared in the class
OWN_LATE = Joint.LATE


def follow_tables() -> None:
    """Let model files hold the entries of every kind that the tables have now."""
    fields = Joint.model_fields
    for key in [key for key in fields if key not in OWN_KEYS]:
        del fields[key]
    for kind in DRIVE_MODELS.values():
        if kind.key and kind.key not in OWN_KEYS:
            annotation: Any = kind.entry | None if kind.entry is not None else None
            fields[kind.key] = FieldInfo(annotation=annotation, default=None)
    Joint.LATE = (*OWN_LATE, *(k.key for k in DRIVE_MODELS.values() if not k.in_identity))
    laws: Any = Union[tuple(kind.entry for kind in FRICTION_LAWS.values())]  # noqa: UP007 (made of a table)
    JointFriction.model_fields["viscous"] = (
        FieldInfo(annotation=laws, discriminator="law")
        if len(FRICTION_LAWS) > 1
        else FieldInfo(annotation=laws)
    )
    for model in (JointFriction, Joint, RobotModel):
        model.model_rebuild(force=True)
    forget_schemas()


DRIVE_MODELS.on_change(follow_tables)
FRICTION_LAWS.on_change(follow_tables)
