"""Order of independent moves: the program as it is, its configurations in another order."""

from robot_energy.optimization.measures.table import MEASURES, variant

MEASURES.register(
    variant(
        "order",
        label="order of independent moves",
        line="configurations in the order that costs least, each with its rest",
        changes="order",
    )
)
