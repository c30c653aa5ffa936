"""Names of message types, as bags and parameters give them."""

import os
import sys
from pathlib import Path

from target import done, scratch

from ros2_energy_monitor.base.message_classes import NAME, message_class  # noqa: TID251

DECOYS = ("evil_msgs", "map_msgs", "shape_msgs", "json", "antigravity")
# A byte below their number stands for a piece, so that random bytes make names that nearly fit.
PIECES = (
    *DECOYS,
    "sensor_msgs",
    "os",
    "rclpy",
    "/msg/",
    "/srv/",
    "/",
    "..",
    "JointState",
    "Mesh",
    "T",
)
SEEDS = (b"sensor_msgs/msg/JointState", bytes([2, 8, 13]))


def _decoys() -> Path:
    """A folder with packages that leave a trace when they are imported."""
    folder = scratch() / "decoys"
    if folder.exists():
        return folder
    for name in DECOYS:
        for place in (folder / name, folder / name / "msg"):
            place.mkdir(parents=True)
            text = f"open({str(folder / 'ran')!r}, 'w')\nclass T: pass\n"
            (place / "__init__.py").write_text(text)
    return folder


def _name(data: bytes) -> str:
    spelt = [PIECES[byte].encode() if byte < len(PIECES) else bytes([byte]) for byte in data]
    return b"".join(spelt).decode("utf-8", "surrogateescape")


def type_names(data: bytes) -> bool:
    """A name is refused, or is that of a class of the ament prefixes; nothing else is imported."""
    folder, name = _decoys(), _name(data)
    before, known = sys.path[:], set(sys.modules)
    sys.path[:0] = ["", str(folder)]
    try:
        taken = done(lambda: message_class(name))
    finally:
        sys.path[:] = before
    foreign = {module.split(".")[0] for module in set(sys.modules) - known} & {"os", *DECOYS}
    for module in foreign:
        place = str(sys.modules[module].__file__)
        if not place.startswith(tuple(os.environ["AMENT_PREFIX_PATH"].split(":"))):
            raise AssertionError(f"{module} was imported from {place}")
    if (folder / "ran").exists():
        raise AssertionError("a package of another place was imported")
    if taken and not NAME.fullmatch(name):
        raise AssertionError("no name of a type")
    return taken


def type_seeds() -> list[bytes]:
    """Types that are installed."""
    return list(SEEDS)
