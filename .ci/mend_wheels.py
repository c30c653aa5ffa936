"""Mend two defects of the ROS wheels: foreign include folders and a parser called too often.

Twenty exported CMake files in `<environment>/share` name the Python and numpy
headers of the build machine (`/opt/python/cp311-cp311/...`), so no interface package
would compile. Each is replaced by the folder of the running environment. `parsed_once.py` says
what is mended in the parser.

Run it with the Python of the virtual environment. Running it again changes nothing.
"""

import re
import shutil
import sys
import sysconfig
from pathlib import Path

import numpy as np

PYTHON_HEADERS = re.compile(r"/opt/python/cp3\d+-cp3\d+/include/python3\.\d+")
NUMPY_HEADERS = re.compile(
    r"/opt/python/cp3\d+-cp3\d+/lib/python3\.\d+/site-packages/numpy/_core/include"
)
FOREIGN = "/opt/python/cp3"
PARSED_ONCE = Path(__file__).with_name("parsed_once.py")
USE_IT = "\nfrom rosidl_parser.parsed_once import parse_idl_file  # noqa: E402, F401, F811\n"


def main() -> int:
    """Rewrite the files and return the exit code: 1 if a foreign folder is left."""
    python_headers = sysconfig.get_paths()["include"]
    numpy_headers = np.get_include()
    mended, left = 0, []
    for path in sorted(Path(sys.prefix, "share").rglob("*.cmake")):
        text = path.read_text(encoding="utf-8")
        new = NUMPY_HEADERS.sub(lambda _: numpy_headers, text)
        new = PYTHON_HEADERS.sub(lambda _: python_headers, new)
        if new != text:
            rewrite(path, new)
            mended += 1
        if FOREIGN in new:
            left.append(path)
    print(f"mended the include folders in {mended} CMake files")
    parser = Path(sysconfig.get_paths()["purelib"], "rosidl_parser", "parser.py")
    shutil.copyfile(PARSED_ONCE, parser.with_name(PARSED_ONCE.name))
    text = parser.read_text(encoding="utf-8")
    if not text.endswith(USE_IT):
        rewrite(parser, text + USE_IT)
    for path in left:
        print(f"{path} still names a folder below /opt/python: extend mend_wheels.py")
    return 1 if left else 0


def rewrite(path: Path, text: str) -> None:
    """Replace a file: uv may have linked it to the copy in its cache, which stays as it is."""
    path.unlink()
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
