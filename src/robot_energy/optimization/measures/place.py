"""Place of the workpiece: the program as it is, with the work shifted in a box."""

from robot_energy.optimization.measures.table import MEASURES, variant

MEASURES.register(
    variant(
        "place",
        label="place of the workpiece",
        line="the workpiece, or the base, shifted in a box, by inverse kinematics",
        changes="place of workpiece or base",
    )
)
