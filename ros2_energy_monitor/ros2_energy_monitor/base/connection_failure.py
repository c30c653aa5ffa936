"""Why a connection failed, in words for a status."""

from __future__ import annotations

import ssl


def reason_of(error: BaseException | None) -> str:
    """Return the reason; a refused certificate is named with what is wrong with it.

    Args:
        error: What was raised; None for nothing known.
    """
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is refused: {error.verify_message}"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return "" if error is None else type(error).__name__
