"""Reads files that others name: regular ones alone, at once, and no more than is asked for.

A pipe would be waited for, a device may never end, and opening one can have effects. So a file
is opened without waiting, looked at, and read only if it is a regular one. What is wrong is an
``OSError`` whose ``strerror`` completes "cannot be read (...)".
"""

from __future__ import annotations

import codecs
import errno
import os
import re
import shlex
import stat
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from robot_energy.foundation.errors import CredentialsError


def require_private(path: str, what: str, remedy: str = "") -> Path:
    """Return the path of a file of secrets; refuse one that others can read or write."""
    full = Path(path).expanduser()
    try:
        status = full.stat()
    except OSError as error:
        raise CredentialsError(
            f"the {what} {full} cannot be read ({error.strerror})", "a file of this user", remedy
        ) from error
    mode = stat.S_IMODE(status.st_mode)
    if mode & 0o077:
        raise CredentialsError(
            f"the {what} {full} has the permissions {mode:04o}",
            "0600: only its owner can read it",
            f"chmod 600 {shlex.quote(str(full))}",
        )
    if status.st_uid not in (os.getuid(), 0):
        raise CredentialsError(
            f"the {what} {full} belongs to the user {status.st_uid}",
            f"the user of this process, {os.getuid()}",
        )
    return full


_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (b"<\0", "utf-16-le"),
    (b"\0<", "utf-16-be"),
)
_DECLARED = re.compile(rb"""\s*<\?xml[^>]{0,200}?\sencoding\s*=\s*["']([A-Za-z][\w.:-]*)["']""")
DECLARE = 'declare its encoding in the first line, as <?xml version="1.0" encoding="ISO-8859-1"?>'


def xml_encoding(data: bytes) -> str:
    """Return the name of the encoding of an XML file: UTF-8 if it states none.

    A declaration that cannot be true, such as UTF-16 in a file of single bytes, counts as none.

    Raises:
        LookupError: If it declares an encoding that is not known.
    """
    for mark, name in _MARKS:
        if data.startswith(mark):
            return name
    declared = _DECLARED.match(data[:400])
    if declared is None:
        return "utf-8"
    name = declared[1].decode("ascii")
    try:
        plausible = declared[0].decode(name, "replace") == declared[0].decode("ascii", "replace")
    except UnicodeError:
        plausible = False
    return name if plausible else "utf-8"


_KINDS = {
    **{stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"},
    **{stat.S_IFSOCK: "a socket", stat.S_IFDIR: "a folder"},
}


def open_regular(path: str | Path, buffering: int = -1) -> BinaryIO:
    """Return a regular file, or one that a link leads to, open for reading.

    Raises:
        OSError: If it cannot be opened or is not a regular file.
    """
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
    try:
        _require_regular(os.stat(path).st_mode, path)  # not even opened otherwise
        number = os.open(path, flags)
    except ValueError as error:
        raise OSError(errno.EINVAL, "its name holds a NUL", repr(path)) from error
    try:
        _require_regular(os.fstat(number).st_mode, path)
    except OSError:
        os.close(number)
        raise
    return os.fdopen(number, "rb", buffering)


def read_regular(path: str | Path, max_bytes: int) -> bytes:
    """Return the content of a regular file of bounded size.

    Raises:
        OSError: If it cannot be read, is not a regular file or is larger.
    """
    with open_regular(path) as file:
        data = b""
        if os.fstat(file.fileno()).st_size <= max_bytes:
            data = file.read(max_bytes + 1)  # it may grow
            if len(data) <= max_bytes:
                return data
    raise OSError(errno.EFBIG, f"it is larger than {max_bytes} bytes", str(path))


def read_regular_text(
    path: str | Path, max_bytes: int, encoding_of: Callable[[bytes], str] | None = None
) -> str:
    """Return the text of a regular file of bounded size, UTF-8 by default, with line feeds alone.

    Raises:
        OSError: If it cannot be read, is not a regular file, is larger or has no known encoding.
        UnicodeDecodeError: If it does not have its encoding.
    """
    data = read_regular(path, max_bytes)
    try:
        text = data.decode("utf-8" if encoding_of is None else encoding_of(data))
    except UnicodeDecodeError:
        raise
    except (LookupError, UnicodeError) as error:
        raise OSError(errno.EINVAL, f"it has no known encoding: {error}", str(path)) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def why_unreadable(error: OSError | UnicodeDecodeError) -> str:
    """Return what is wrong with a file, to stand in brackets."""
    if isinstance(error, OSError):
        return str(error.strerror)
    return f"it is not {error.encoding.upper().removesuffix('-SIG')}"


def _require_regular(mode: int, path: str | Path) -> None:
    if not stat.S_ISREG(mode):
        folder, kind = stat.S_ISDIR(mode), _KINDS.get(stat.S_IFMT(mode), "not a regular file")
        remedy = "" if folder else "; write its content to a file and name that"
        number = errno.EISDIR if folder else errno.EINVAL
        raise OSError(number, f"it is {kind}{remedy}", str(path))
