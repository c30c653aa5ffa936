"""What routes of the page share: the body of a request, bounded, and answers that are packed."""

from __future__ import annotations

import asyncio
import gzip

from starlette.requests import Request
from starlette.responses import Response

PATIENCE = 5.0  # for a body to arrive [s]


async def body_of(request: Request, most: int) -> bytes:
    """Return the body of a request.

    Raises:
        TimeoutError: If it does not arrive.
        ValueError: If it is too long.
    """
    body = b""
    async with asyncio.timeout(PATIENCE):
        async for chunk in request.stream():
            body += chunk
            if len(body) > most:
                raise ValueError(f"a body of more than {most} bytes")
    return body


def takes_gzip(request: Request) -> bool:
    """Whether who asks unpacks answers."""
    return "gzip" in request.headers.get("accept-encoding", "")


def packed(request: Request, content: bytes, kind: str) -> Response:
    """Return an answer, packed for who unpacks it."""
    if not takes_gzip(request):
        return Response(content, media_type=kind)
    headers = {"content-encoding": "gzip", "vary": "accept-encoding"}
    return Response(gzip.compress(content, 5, mtime=0), media_type=kind, headers=headers)
