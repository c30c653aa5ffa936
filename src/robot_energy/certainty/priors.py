"""Standard deviations of model figures that state none.

A figure without a standard deviation gets a share of its value: that of its quantity where it
is assumed, and a part of that share where more is known of it. ``src/doc/priors.md`` has the
sources.
"""

from __future__ import annotations

from robot_energy.model.figure import LEAST_KNOWN, Figure, Tag

# Standard deviation of an assumed figure as a share of its value. [-]
SPREAD = {
    "coulomb": 0.6,
    "viscous": 0.6,
    "viscous_exponent": 0.2,
    "copper": 0.6,
    "constant": 0.8,
    "linear": 0.8,
    "quadratic": 0.8,
    "loss_grid": 0.5,
    "loss_dc": 0.6,
    "bodies": 0.2,  # rigid-body power
    "payload": 0.2,  # the part of it that the payload takes
    "drive": 0.3,  # loss of a drive model whose figures have no deviation of their own
}
TAGS = dict(zip(LEAST_KNOWN, (1.0, 0.5, 0.3, 0.2), strict=True))
"""What part of that share remains, by the tag."""
MISSING_LOSS = 0.08
"""Loss of a drive that the model leaves out, as a share of its shaft power. [-]

Copper, iron and inverter losses of a servo axis at work."""


def relative_std(quantity: str, tag: Tag) -> float:
    """Return the standard deviation of a figure that states none, as a share of its value."""
    return SPREAD[quantity] * TAGS[tag]


def figure_std(figure: Figure, quantity: str) -> float:
    """Return the standard deviation of a figure, in its unit: its own, or that of its prior."""
    if figure.std is not None:
        return figure.std
    return relative_std(quantity, figure.tag) * abs(figure.value)
