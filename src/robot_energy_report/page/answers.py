"""What routes of the page share: the body of a request, bounded, and answers that are packed."""

from __future__ import annotations

import asyncio
import gzip
import json
from typing import Any

from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

PATIENCE = 5.0  # for a body to arrive [s]


async def json_of(request: Request, most: int) -> Any:
    """Return what the body of a request says; None if it is too long, late or no JSON."""
    body = b""
    try:
        async with asyncio.timeout(PATIENCE):
            async for chunk in request.stream():
                body += chunk
                if len(body) > most:
                    return None
        return json.loads(body)
    except (TimeoutError, ClientDisconnect, ValueError, RecursionError):
        return None


def takes_gzip(request: Request) -> bool:
    """Whether who asks unpacks answers."""
    return "gzip" in request.headers.get("accept-encoding", "")


def packed(request: Request, content: bytes, kind: str) -> Response:
    """Return an answer, packed for who unpacks it."""
    if not takes_gzip(request):
        return Response(content, media_type=kind)
    headers = {"content-encoding": "gzip", "vary": "accept-encoding"}
    return Response(gzip.compress(content, 5, mtime=0), media_type=kind, headers=headers)
