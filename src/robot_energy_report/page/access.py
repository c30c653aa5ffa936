"""Who may see the page and act on it: address, token, Host and Origin."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Sequence
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import PageError
from robot_energy.foundation.files.regular_file import (
    read_regular_text,
    require_private,
    why_unreadable,
)

LOOPBACK = "127.0.0.1"
MIN_TOKEN, MAX_TOKEN = 16, 512
MAKE_TOKEN = "make one with: (umask 077; openssl rand -hex 24 > token)"
READABLE = "powers, energies, temperatures, joint names, job intervals, costs and diagnostics"


class PageAccess(Described):
    """Rules of access to one page."""

    address: str
    port: Annotated[int, "TCP port; 0 for any free one."]
    token: Annotated[str, "What readers from elsewhere and writers must state; empty for none."]
    allow_control: bool
    hosts: Annotated[frozenset[str], "Names in the Host header that are served, without the port."]

    @property
    def loopback(self) -> bool:
        """Whether only this computer reaches the page; if not, reading needs the token."""
        return ipaddress.ip_address(self.address).is_loopback

    def sentences(self, url: str) -> list[str]:
        """Return what the start says: the address, and what becomes readable and by whom."""
        lines = [f"energy page at {url}"]
        if self.loopback:
            lines.append("only this computer can open it")
        else:
            lines.append(
                f"whoever reaches {self.address} and has the token can read {READABLE}; the token "
                "and all figures travel unencrypted: use a network you trust, or a proxy with TLS"
            )
        if self.allow_control:
            lines.append(
                "with the token, job intervals can be opened and closed, registers reset and "
                "prices of the history set"
            )
        return lines

    def knows_host(self, header: str | None) -> bool:
        """Whether a Host header names this page; another is a rebound name of a foreign site."""
        return header is not None and _name(header) in self.hosts

    def same_origin(self, origin: str | None, host: str | None) -> bool:
        """Whether a request comes from this page or from no page at all."""
        return origin is None or origin.lower() == f"http://{host}".lower()

    def permits(self, authorization: str | None) -> bool:
        """Whether an Authorization header states the token."""
        if not self.token or authorization is None:
            return False
        kind, _, given = authorization.partition(" ")
        same = hmac.compare_digest(given.strip().encode(), self.token.encode())
        return same and kind.lower() == "bearer"


def page_access(
    address: str = LOOPBACK,
    port: int = 0,
    token_file: str = "",
    allow_control: bool = False,
    hosts: Sequence[str] = (),
) -> PageAccess:
    """Return the rules of access, checked."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        raise PageError(
            f"the address of the page is '{address}'",
            "an IP address, such as 127.0.0.1 or 0.0.0.0",
        ) from None
    token = _token(token_file) if token_file else ""
    if not token and not found.is_loopback:
        raise PageError(
            f"the page would listen on {address}, where others can read it, but it has no token",
            "a file with a token",
            MAKE_TOKEN,
        )
    if not token and allow_control:
        raise PageError(
            "the page would have buttons that change the registers, but it has no token",
            "a file with a token",
            MAKE_TOKEN,
        )
    names = {"localhost", *map(_name, hosts)}
    if found.is_unspecified:
        names |= {LOOPBACK, "[::1]", *_own_names()}
    else:
        names |= {f"[{found.compressed}]" if found.version == 6 else found.compressed}
    return PageAccess(str(found), port, token, allow_control, frozenset(names))


def _token(path: str) -> str:
    full = require_private(path, "token file", MAKE_TOKEN)
    try:
        token = read_regular_text(full, 4096).strip()
    except (OSError, UnicodeDecodeError) as error:
        raise PageError(
            f"the token file '{path}' cannot be read ({why_unreadable(error)})",
            "a file with one line",
            MAKE_TOKEN,
        ) from error
    if not MIN_TOKEN <= len(token) <= MAX_TOKEN or not token.isascii() or not token.isprintable():
        raise PageError(
            f"the token in '{path}' cannot be used",
            f"one line of {MIN_TOKEN} to {MAX_TOKEN} printable ASCII characters",
            MAKE_TOKEN,
        )
    return token


def _own_names() -> set[str]:
    import socket

    names = {socket.gethostname().lower()}
    try:
        names |= {str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None)}
    except OSError:
        pass
    return names


def _name(host: str) -> str:
    """The name in a Host header, without the port, in lower case."""
    host = host.strip().lower()
    if host.startswith("["):
        return host.partition("]")[0] + "]"
    return host.partition(":")[0]
