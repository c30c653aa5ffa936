"""What is said of the inputs: options of the verbs that read bags, and parameters of the nodes."""

from collections.abc import Sequence
from typing import Annotated, TypedDict

from robot_energy.foundation.options import Option

TOPICS, SETTINGS = "topics", "settings, seldom needed"
LATEST = 1e6  # of a time that is waited for or bridged [s]


# fmt: off
class InputOptions(TypedDict, total=False):
    """What nodes and verbs that read bags have in common; see `robot_energy.inputs.parameters`."""

    joint_states: Annotated[str | Sequence[str] | None, Option(
        "topics of sensor_msgs/JointState; several where each brings some of the joints",
        value="TOPIC", several="in a row", group=TOPICS)]
    effort: Annotated[str | None, Option(
        "what the effort in the joint states is: it gives the measured shaft power of each joint; "
        "none: it is not used",
        absent="that of --inputs, else none", value="MEANING",
        choices=("none", "motor_current", "motor_torque", "joint_torque"), group=TOPICS)]
    derivative_window: Annotated[float | None, Option(
        "length of the window over which acceleration is estimated; 2.5 times as long where "
        "velocities come from the positions",
        absent="0.02 s", unit="s", low=1e-6, high=LATEST, group=SETTINGS)]
    stamp_source: Annotated[str | None, Option(
        "where the stamps of joint states come from: the header, or the time at which they were "
        "received or recorded, for drivers that do not set it",
        absent="that of --inputs, else header", choices=("header", "receive"), group=SETTINGS)]
    reorder_window: Annotated[float | None, Option(
        "how long a joint state waits for older ones that arrive later, to sort them",
        absent="that of --inputs, else 0 s", unit="s", low=0.0, high=0.5, group=SETTINGS)]
    max_gap: Annotated[float | None, Option(
        "longest time between two joint states that is bridged; 0: five times their usual period, "
        "0.1 s to 1 s",
        absent="that of --inputs, else 0", unit="s", low=0.0, high=60.0, group=SETTINGS)]
    learning: Annotated[str | None, Option(
        "friction and constant losses at work; off: nothing is learned; observe: what is learned "
        "is shown; apply: predictions use it",
        absent="observe", choices=("off", "observe", "apply"), group=SETTINGS)]
    meter_max_gap: Annotated[float | None, Option(
        "longest time between two meter readings that is bridged",
        absent="that of --inputs, else 2 s", unit="s", low=1e-6, high=LATEST, group=SETTINGS)]
# fmt: on
