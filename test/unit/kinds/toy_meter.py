"""A meter that publishes whole milliwatts, in one file as a user writes it."""

from robot_energy.inputs.meter.kinds import MeterKind, register_meter_kind

KIND = register_meter_kind(
    MeterKind(
        name="std_msgs/msg/Int32",
        label="milliwatts",
        line="whole milliwatts at the grid",
        unit="mW",
        location="grid",
        instantaneous=True,
        headed=False,
        found_by_type=True,
    )
)
