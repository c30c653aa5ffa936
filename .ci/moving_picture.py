"""Draws the moving picture of the README: a robot warms up, and the prediction stays on the meter.

``python .ci/moving_picture.py`` simulates a virtual robot that warms up 40 times too fast, predicts
its power with friction that follows the temperature and with friction fixed at 20 degC, and writes
``src/doc/images/warming_up.gif``.
"""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from PIL import Image

mpl.use("Agg")
from matplotlib import pyplot

import robot_energy as re

ROOT = Path(__file__).resolve().parent.parent
BAG, OUT = ROOT / "build/warming_up", ROOT / "src/doc/images/warming_up.gif"
SECONDS, SPEEDUP, WINDOW = 120.0, 40, 5.0  # [s], [-], [s] of a mean
FRAMES, FRAME_MS, LAST_MS = 36, 160, 2500
SIZE, DPI, COLOURS = (7.2, 3.4), 100, 32
SIMULATE = ("simulate", "--duration", f"{SECONDS:g}", "--speedup", str(SPEEDUP), "--dwell", "0")


def means(time: Any, values: Any) -> tuple[Any, Any]:
    """Return means over windows, without those of which nothing is known."""
    edges = np.arange(0.0, SECONDS + WINDOW, WINDOW)
    place = np.digitize(time, edges) - 1
    found = [
        np.nanmean(values[place == k]) if np.isfinite(values[place == k]).any() else np.nan
        for k in range(len(edges) - 1)
    ]
    return (edges[:-1] + WINDOW / 2) * SPEEDUP / 60.0, np.array(found)


def main() -> None:
    """Simulate, predict, draw."""
    command = [sys.executable, "-m", "robot_energy", *SIMULATE, "--out", str(BAG), "--overwrite"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    follows, fixed = re.replay(BAG, "kr16"), re.replay(BAG, "kr16", temperature=20.0)
    curves = {}
    for label, result, name in (
        ("measured by the meter", follows, "measured_power"),
        ("predicted, friction follows the temperature", follows, "predicted_power_at_meter"),
        ("predicted, friction fixed at 20 °C", fixed, "predicted_power_at_meter"),
    ):
        table = result.power
        time = table.time
        curves[label] = means(time, table[name])
        degc = means(time, np.nanmean(table["motor_temperature_degc"], axis=1))
    frames = [frame(curves, degc, (k + 1) / FRAMES) for k in range(FRAMES)]
    frames[0].save(
        OUT, save_all=True, append_images=frames[1:], optimize=True, loop=0,
        duration=[FRAME_MS] * (FRAMES - 1) + [LAST_MS],
    )  # fmt: skip
    print(f"{OUT}: {OUT.stat().st_size / 1e3:.0f} kB")


def frame(curves: dict[str, tuple[Any, Any]], degc: tuple[Any, Any], share: float) -> Any:
    """Draw the first part of all curves."""
    end = share * SECONDS * SPEEDUP / 60.0
    figure, (top, below) = pyplot.subplots(
        2, 1, figsize=SIZE, height_ratios=(2.4, 1), sharex=True, layout="constrained"
    )
    for (label, (x, y)), colour in zip(
        curves.items(), ("#b4470b", "#0b5cad", "#8a8f98"), strict=True
    ):
        top.plot(x[x <= end], y[x <= end], color=colour, label=label, linewidth=2.0)
    highest = max(np.nanmax(y) for _, y in curves.values())
    top.set(ylim=(0.0, 1.65 * highest), ylabel="power [W]")
    top.legend(loc="upper right", fontsize="small")
    below.plot(degc[0][degc[0] <= end], degc[1][degc[0] <= end], color="#c2570c", linewidth=2.0)
    below.set(xlim=(0.0, SECONDS * SPEEDUP / 60.0), ylim=(15.0, np.nanmax(degc[1]) + 5.0))
    below.set(xlabel="time of work [min], virtual robot", ylabel="motors [°C]")
    picture = io.BytesIO()
    figure.savefig(picture, dpi=DPI)
    pyplot.close(figure)
    return Image.open(picture).convert("RGB").quantize(COLOURS)


if __name__ == "__main__":
    main()
