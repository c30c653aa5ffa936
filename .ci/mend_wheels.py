"""Mend the one defect of the ROS wheels: include folders of the machine that built them.

Twenty exported CMake files in `<environment>/share` name the Python and numpy
headers of the build machine (`/opt/python/cp311-cp311/...`), so no interface package
would compile. Each is replaced by the folder of the running environment.

Run it with the Python of the virtual environment. Running it again changes nothing.
"""

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

PYTHON_HEADERS = re.compile(r"/opt/python/cp3\d+-cp3\d+/include/python3\.\d+")
NUMPY_HEADERS = re.compile(
    r"/opt/python/cp3\d+-cp3\d+/lib/python3\.\d+/site-packages/numpy/_core/include"
)
FOREIGN = "/opt/python/cp3"


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
            path.write_text(new, encoding="utf-8")
            mended += 1
        if FOREIGN in new:
            left.append(path)
    print(f"mended the include folders in {mended} CMake files")
    for path in left:
        print(f"{path} still names a folder below /opt/python: extend mend_wheels.py")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
