"""What a file is by its first bytes, and how to use it where another kind was expected."""

from __future__ import annotations

from pathlib import Path
from shlex import quote

MAX_SHOWN = 16  # bytes of a file that are shown
TABLE = "import it with `robot-energy import table {path} --mapping FILE --out {bag}`"
EXPORT = "export its channels as CSV or Parquet, then `robot-energy import table`"
BAG = "name it as a bag, as in `robot-energy replay {path}`"
SQLITE, MCAP = b"SQLite format 3\x00", b"\x89MCAP0\r\n"
FIRST_BYTES: dict[bytes, tuple[str, str]] = {
    b"#ROSBAG V2.0": (
        "a ROS 1 bag",
        "convert it with `rosbags-convert --src {path} --dst {stem}`, then name the folder {stem}",
    ),
    MCAP: ("an MCAP file", BAG),
    SQLITE: ("an SQLite file, as of rosbag2", BAG),
    b"PAR1": ("a Parquet table", TABLE),
    b"\x1f\x8b": ("a file packed with gzip", f"unpack a bag first; if it is a table, {TABLE}"),
    b"DIAEXTENDED": ("the header of a DIAdem recording, as of a KUKA trace", EXPORT),
    b"\x89HDF\r\n\x1a\n": ("an HDF5 file, as of MATLAB", EXPORT),
    b"MATLAB 5.0": ("a MATLAB file", EXPORT),
    b"MDF     ": ("an ASAM MDF recording", EXPORT),
    b"UnFinMF ": ("an ASAM MDF recording that was not finished", EXPORT),
    b"TDSm": ("a TDMS recording of LabVIEW", EXPORT),
    b"ULog\x01\x12": ("a ULog recording of PX4", EXPORT),
    b"PK\x03\x04": ("an Excel table or another ZIP archive", "unpack it, or save it as CSV"),
    b"%PDF": ("a PDF document", ""),
    b"<?xml": ("an XML document", ""),
}
"""Beginning of a file: what it is, and the remedy, in which {path}, {stem} and {bag} may stand."""
MAX_MAGIC = max(map(len, FIRST_BYTES))


def named(path: Path, head: bytes) -> tuple[str, str]:
    """Return what a file is by its first bytes, as in "x.bag is a ROS 1 bag", and the remedy."""
    words = {"path": quote(str(path)), "stem": quote(path.stem), "bag": quote(f"{path.stem}_bag")}
    for magic, (what, remedy) in FIRST_BYTES.items():
        if head.startswith(magic):
            return f"{path} is {what}", remedy.format(**words)
    if not head:
        return f"{path} is empty", ""
    shown = head[:MAX_SHOWN]
    try:
        text = shown.decode("utf-8").split("\n")[0].strip()
    except UnicodeDecodeError:
        text = ""
    if text.isprintable() and text:
        remedy = f"if it is a log of a robot, {TABLE.format(**words)}"
        return f"{path} is a text that begins with '{text}'", remedy
    return f"{path} begins with the bytes {shown.hex(' ')}", ""
