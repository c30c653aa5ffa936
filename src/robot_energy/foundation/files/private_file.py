"""Refuses files of secrets that other users can read or write, as ssh does."""

from __future__ import annotations

import os
import shlex
import stat
from pathlib import Path

from robot_energy.foundation.errors import CredentialsError


def require_private(path: str, what: str, remedy: str = "") -> Path:
    """Return the path of a file of secrets; refuse one that others can read or write.

    Args:
        path: The file; ``~`` is the home folder.
    """
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
