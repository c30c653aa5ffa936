"""Each interface definition is parsed once, instead of once by each of the generators.

The Earley parser of `rosidl_parser` takes 0.3 s for a definition, and each generator is a process
of its own. `mend_wheels.py` copies this module into that package, whose `parse_idl_file` it
replaces. A parsed definition is kept next to the `.idl` file that colcon makes in the build folder,
under the hash of its text; where nothing can be written, it is parsed again.
"""

import contextlib
import hashlib
import os
import pickle
from typing import Any

from rosidl_parser import parser
from rosidl_parser.definition import IdlFile, IdlLocator


def parse_idl_file(locator: IdlLocator, png_file: Any = None) -> IdlFile:
    """Return the parsed definition; a picture of it is not drawn."""
    path = locator.get_absolute_path()
    text = path.read_text(encoding="utf-8")
    digest = hashlib.sha256(text.encode()).hexdigest()
    kept = path.with_name(f".{path.name}.{digest}")
    if kept.exists():
        return IdlFile(locator, pickle.loads(kept.read_bytes()))
    content = parser.parse_idl_string(text)
    with contextlib.suppress(OSError):
        part = kept.with_name(f"{kept.name}.{os.getpid()}")
        part.write_bytes(pickle.dumps(content))
        part.replace(kept)
    return IdlFile(locator, content)
