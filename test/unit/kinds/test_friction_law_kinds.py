"""A friction law of a user."""

from typing import Literal

import numpy as np
import pytest

from robot_energy.model import load, validate
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.friction_laws import (
    FRICTION_LAWS,
    FrictionLaw,
    LawEntry,
    register_friction_law,
)
from robot_energy.physics.friction import ViscousLaw, viscous_law
from robot_energy_cli.kinds import kinds_listing
from robot_energy_identify.friction.laws import fitted_laws
from robots import figure
from toy_kinds import TOY, refused, wheel


class Linear(LawEntry):
    """fv = at_zero + slope T."""

    law: Literal["linear"]
    at_zero: PositiveFigure
    slope: Figure


def linear(entry):
    at_zero, slope = entry.at_zero.value, entry.slope.value
    return ViscousLaw(0.0, 100.0, lambda t: at_zero + slope * t, lambda t: np.full(t.shape, np.nan))


@pytest.fixture
def law():
    kind = FrictionLaw(name="linear", label="line", line="a line", entry=Linear, curve=linear)
    yield register_friction_law(kind)
    FRICTION_LAWS.remove("linear")


def with_viscous(**viscous):
    friction = {"coulomb": figure(0.5), "viscous": viscous}
    data = wheel(drive="ideal", joint={"friction": friction})
    del data["joints"][0][TOY]
    return data


def test_a_friction_law_is_known_to_model_physics_and_tables(law):
    line = {"law": "linear", "at_zero": figure(0.03), "slope": figure(-1e-4)}
    model = validate(with_viscous(**line), "toy.yaml")
    curve = viscous_law(model.joints[0].friction.viscous)
    assert curve.viscous(50.0) == pytest.approx(0.025)
    error = refused(with_viscous(**{**line, "law": "lineer"}))
    assert "linear" in error.remedy
    assert "`linear`" in kinds_listing()
    assert law.text(model.joints[0].friction.viscous.model_dump()) == "at_zero 0.03, slope -0.0001"
    assert "linear" not in fitted_laws()


def test_a_law_that_is_gone_is_unknown():
    line = {"law": "linear", "at_zero": figure(0.03), "slope": figure(-1e-4)}
    assert "linear" in refused(with_viscous(**line)).found


def test_a_kind_that_the_schema_cannot_take_is_not_kept():
    class Nameless(LawEntry):
        law: str

    with pytest.raises(Exception, match="Nameless"):
        register_friction_law(FrictionLaw(name="bad", label="", line="", entry=Nameless))
    assert "bad" not in FRICTION_LAWS
    assert len(load("kr16").joints) == 6
