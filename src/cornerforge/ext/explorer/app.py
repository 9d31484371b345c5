"""The explorer over HTTP: routes, and what guards them. No path from a request reaches the file system."""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Mapping
from importlib import resources
from typing import Any
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cornerforge._schema import parse
from cornerforge.errors import CornerForgeError, FileFormatError, OutputError
from cornerforge.ext.explorer.exhibit import Exhibit, UnknownKeyError
from cornerforge.ext.explorer.room import UnavailableError

__all__ = ["POLICY", "Guard", "explorer_app", "read_page"]

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self' data:; "
    "media-src 'self' blob:; worker-src 'self' blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""Rights of the page: run scripts of this server, and ask this server only."""
_MOST_BYTES = 64 * 1024
"""Longest body of a request: a condition in SQL."""
_TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "txt": "text/plain", "svg": "image/svg+xml",
          "woff2": "font/woff2", "map": "application/json"}  # fmt: skip
_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "content-security-policy": POLICY,
}


def read_page() -> dict[str, bytes]:
    """Read what `make web` built, by name; empty if it is not there."""
    folder = resources.files("cornerforge.ext.explorer").joinpath("static")
    if not folder.is_dir():
        return {}
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}


def _json(content: Any, status: int = 200) -> Response:
    body = json.dumps(content, allow_nan=False, separators=(",", ":"), ensure_ascii=False)
    return Response(body.encode("utf-8", "replace"), status, media_type="application/json")


def _fault(status: int, line: str) -> Response:
    return _json({"error": line}, status)


class Guard:
    """Looks at each request before the application does.

    Args:
        app: The application.
        hosts: Names by which the server may be called, with the port (against DNS rebinding); None: any, since a
            cookie is needed.
        token: What the address must hold once, and a cookie from then on; None: no token is needed.
        port: Part of the cookie's name, because browsers keep one of a name for all ports of a host.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str] | None, token: str | None, port: int) -> None:
        self._app, self._hosts, self._token, self._cookie = app, hosts, token, f"cornerforge-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or hand on."""
        if scope["type"] != "http":  # no web sockets, no lifespan
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1003})
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = dict(_HEADERS)
                if not scope["path"].startswith("/assets/"):
                    extra["cache-control"] = "no-store"
                message["headers"] = [
                    *message["headers"],
                    *((name.encode("latin-1"), value.encode("latin-1")) for name, value in extra.items()),
                ]
            await send(message)

        refused = self._refuse(scope)
        await (self._app if refused is None else refused)(scope, receive, guarded)

    def _refuse(self, scope: Scope) -> Response | None:
        headers: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1"), []).append(value.decode("latin-1"))
        host = headers.get("host", [""])
        if len(host) != 1 or (self._hosts is not None and host[0].lower() not in self._hosts):
            return _fault(421, "This server answers to its own address only; open the one that cornerforge printed.")
        site = headers.get("sec-fetch-site", ["none"])  # which browsers tell; it is a question of another page
        if scope["path"].startswith("/api/") and not {"same-origin", "none"} >= set(site):
            return _fault(403, "Only the explorer's own page may ask this.")
        if scope["method"] not in ("GET", "HEAD"):
            origin, kind = headers.get("origin", []), headers.get("content-type", [""])
            if origin and origin != [f"http://{host[0]}"]:
                return _fault(403, "Only the explorer's own page may ask this.")
            if kind[0].partition(";")[0].strip().lower() != "application/json":
                return _fault(415, "Send JSON, with the content type application/json.")
        return None if self._token is None else self._ask_token(scope, headers, self._token)

    def _ask_token(self, scope: Scope, headers: Mapping[str, list[str]], token: str) -> Response | None:
        given = _token_in(scope["query_string"].decode("latin-1"))
        if scope["path"] == "/" and secrets.compare_digest(given.encode(), token.encode()):
            answer = RedirectResponse("/", 303)
            answer.set_cookie(self._cookie, token, httponly=True, samesite="strict", path="/")
            return answer
        for line in headers.get("cookie", []):
            for part in line.split(";"):
                name, _, value = part.strip().partition("=")
                if name == self._cookie and secrets.compare_digest(value.encode(), token.encode()):
                    return None
        return _fault(401, "This explorer needs the whole address that cornerforge printed, with its token.")


def _token_in(query: str) -> str:
    try:
        return parse_qs(query, max_num_fields=10).get("token", [""])[0]
    except ValueError:  # too many fields
        return ""


async def _body(request: Request) -> Any:
    """Read a JSON body.

    Raises:
        HTTPException: It is too long, or no JSON.
    """
    content = b""
    async for piece in request.stream():
        content += piece
        if len(content) > _MOST_BYTES:
            raise HTTPException(413, f"That is too long; at most {_MOST_BYTES:,} bytes.")
    try:
        return parse(content.decode())
    except ValueError:
        raise HTTPException(400, "The body is not JSON.") from None


def explorer_app(exhibit: Exhibit, page: Mapping[str, bytes]) -> Starlette:
    """Make the application.

    Args:
        exhibit: What is shown.
        page: Files of the page by name.
    """

    async def asset(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in page:
            raise HTTPException(404, "There is no such file.")
        kind = _TYPES.get(name.rpartition(".")[2], "application/octet-stream")
        return Response(page[name], media_type=f"{kind}; charset=utf-8" if kind.startswith("text/") else kind)

    # Starlette calls functions that are not async in a thread.

    def told(what: Callable[..., Any]) -> Callable[[Request], Response]:
        return lambda request: _json(what(**request.path_params))

    def columns(request: Request) -> Response:
        names = [name for name in request.query_params.get("names", "").split(",") if name]
        return Response(exhibit.table.stream(names), media_type="application/vnd.apache.arrow.stream")

    def download(request: Request) -> Response:
        media, name, content = exhibit.download(**request.path_params)
        return Response(content, media_type=media, headers={"content-disposition": f'attachment; filename="{name}"'})

    async def sql(request: Request) -> Response:
        asked = await _body(request)
        where = asked.get("where") if isinstance(asked, dict) else None
        if not isinstance(where, str):
            raise HTTPException(400, 'Send {"where": "a condition in SQL"}.')
        bits = await run_in_threadpool(exhibit.rows_where, where)
        return Response(bits, media_type="application/octet-stream")

    one = "/api/case/{source}/{case_id}"
    app = Starlette(
        routes=[
            Route("/", asset),
            Route("/assets/{name}", asset),
            Route("/api/about", told(exhibit.about)),
            Route("/api/columns", columns),
            Route(one, told(exhibit.case)),
            Route(f"{one}/ghosts", told(exhibit.ghosts)),
            Route(one + "/with/{av:path}", told(exhibit.case_with)),
            Route(one + "/download/{name}", download),
            Route("/api/sql", sql, methods=["POST"]),
        ],
        exception_handlers={
            HTTPException: lambda _, error: _fault(error.status_code, error.detail),
            UnknownKeyError: lambda _, error: _fault(404, str(error)),
            UnavailableError: lambda _, error: _fault(503, str(error)),
            CornerForgeError: lambda _, error: _fault(_status(error), str(error)),
            ClientDisconnect: lambda _, __: _fault(400, "The request ended early."),
            Exception: lambda _, __: _fault(500, "The server failed at this; what it says in its terminal is a bug."),
        },
    )
    app.router.redirect_slashes = False  # no answer is made of a request's Host
    return app


def _status(error: Exception) -> int:
    """Damaged files and full disks are no fault of the server's code, nor of the request."""
    return 409 if isinstance(error, (FileFormatError, OutputError)) else 400
