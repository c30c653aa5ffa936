"""Options of the verbs that identify: how recordings are read, and what is made of them."""

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypedDict

from robot_energy.foundation.described import documented
from robot_energy.foundation.options import Option
from robot_energy.foundation.units import DQ_FACTORS, DqScaling

if TYPE_CHECKING:
    from robot_energy_identify.stats.systematic import SensorLimits

EFFORTS = ("motor_torque", "joint_torque", "motor_current")
SUBJECTS = ("dynamics", "friction", "cabinet", "drives", "capacitor", "thermal")
Subject = Literal["dynamics", "friction", "cabinet", "drives", "capacitor", "thermal"]
OF_DRIVES = "power of the drives"
Stages = Callable[[str], AbstractContextManager[Callable[[float], None]]]


@contextmanager
def silent(label: str) -> Generator[Callable[[float], None]]:
    """Yield what is called with the share done, 0 to 1, and shows nothing."""
    del label
    yield lambda share: None


# fmt: off
@documented
class SourceOptions(TypedDict, total=False):
    """How recordings are read for identification; all may be left out."""

    inputs: Annotated[str | Path | None,
        "Parameter file of a monitor: read the bags as that node reads its topics."]
    sensors: Annotated["SensorLimits | None",
        "Limits of the constant errors of the sensors; None for the usual ones."]
    progress: Annotated["Stages",
        "Called with what is going on; gives a function of the share done."]


@documented
class IdentifyOptions(SourceOptions, total=False):
    """What is identified and how it is tested; all may be left out."""

    test: Annotated[str | Path | Sequence[str | Path], Option(
        "recordings for the test alone", value="BAG", several="in a row", default=())]
    held_out: Annotated[bool, Option(
        "whether to test the energy on held-out recordings", default=True)]
    drive_power: Annotated[str | Sequence[str] | None, Option(
        "array with the power of each drive [W]; or four arrays, from which the power is computed: "
        "currents d and q [A], voltages d and q [V]",
        value="TOPIC", several="in a row", group=OF_DRIVES)]
    drive_joints: Annotated[Sequence[str] | None, Option(
        "joints in the order of these arrays (default: of the model)",
        value="JOINT", several="in a row", group=OF_DRIVES)]
    dq_scaling: Annotated[DqScaling, Option(
        "what the four arrays hold: peak or RMS values of a phase, or those of the "
        "power-invariant transformation (default: peak)",
        choices=tuple(DQ_FACTORS), default="peak", group=OF_DRIVES)]
    skip: Annotated[Sequence[Subject], Option(
        "leave these as the model has them",
        value="PART", choices=SUBJECTS, several="in a row", default=())]
    link_voltages: Annotated[tuple[float, float] | None,
        "Of the DC link: rectified mains, start of the brake chopper. [V]"]
    share_shape: Annotated[bool, Option(
        "axes whose range of temperature or speed is too small take the temperature shape of the "
        "others; only its size is fitted", default=False)]
# fmt: on
