"""Who is answered: by which name, from which page, with which token."""

from __future__ import annotations

import asyncio
import socket

import pytest
from starlette.types import ASGIApp, Message

from cornerforge.errors import InputError, OutputError
from cornerforge.ext.explorer.app import Guard, explorer_app
from cornerforge.ext.explorer.exhibit import Exhibit
from cornerforge.ext.explorer.server import PORT, open_door

pytestmark = pytest.mark.full


def answer_of(
    app: ASGIApp, path: str, *, method: str = "GET", body: bytes = b"", **headers: str
) -> tuple[int, dict[str, str], bytes]:
    """Ask an application, without a socket: status, headers, content."""
    sent: list[Message] = []
    way, _, query = path.partition("?")
    given = {"host": "127.0.0.1:80", **{name.replace("_", "-"): value for name, value in headers.items()}}
    scope = {
        "type": "http", "method": method, "path": way, "raw_path": way.encode(), "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in given.items()],
    }  # fmt: skip

    async def receive() -> Message:
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: Message) -> None:
        sent.append(message)

    async def ask() -> None:
        await app(scope, receive, send)

    asyncio.run(ask())
    told = {name.decode().lower(): value.decode() for name, value in sent[0]["headers"]}
    return sent[0]["status"], told, b"".join(message.get("body", b"") for message in sent[1:])


def test_a_token_opens_once_and_a_cookie_then(exhibit: Exhibit) -> None:
    app = Guard(explorer_app(exhibit, {"index.html": b"page"}), None, "secret", 80)
    for path in ("/", "/?token=wrong", "/api/about?token=secret", "/?" + "a=1&" * 50 + "token=secret"):
        assert answer_of(app, path)[0] == 401
    assert answer_of(app, "/", cookie="cornerforge-80=wrong; cornerforge-81=secret; a=b")[0] == 401
    status, told, _ = answer_of(app, "/?token=secret")
    assert (status, told["location"]) == (303, "/")
    assert "httponly" in told["set-cookie"].lower()
    assert "samesite=strict" in told["set-cookie"].lower()
    cookie = told["set-cookie"].partition(";")[0]
    assert answer_of(app, "/", cookie=f"a=b; {cookie}", host="any.name:1")[2] == b"page"


def test_only_its_own_name_and_page_are_heard(exhibit: Exhibit) -> None:
    app = Guard(explorer_app(exhibit, {"index.html": b"page"}), frozenset({"127.0.0.1:80"}), None, 80)
    assert answer_of(app, "/")[0] == 200
    assert answer_of(app, "/", host="rebound.example:80")[0] == 421

    def change(origin: str, kind: str = "application/json") -> int:
        return answer_of(app, "/api/sql", method="POST", body=b'{"where": 1}', origin=origin, content_type=kind)[0]

    assert change("http://evil.example") == 403
    assert change("null") == 403
    assert change("http://127.0.0.1:80", "text/plain") == 415
    assert change("http://127.0.0.1:80") == 400


@pytest.mark.parametrize(
    ("site", "status"), [("same-origin", 200), ("none", 200), ("same-site", 403), ("cross-site", 403)]
)
def test_a_browser_asks_for_its_own_page_only(exhibit: Exhibit, site: str, status: int) -> None:
    """Any page may make a browser ask; what it asks for may be long work."""
    app = Guard(explorer_app(exhibit, {"index.html": b"page"}), frozenset({"127.0.0.1:80"}), None, 80)
    assert answer_of(app, "/api/about", sec_fetch_site=site)[0] == status
    assert answer_of(app, "/", sec_fetch_site=site)[0] == 200  # a link leads to it


def test_a_taken_port_is_passed_over_or_an_error() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(OutputError, match=f"Port {taken.getsockname()[1]} is taken"):
            open_door("127.0.0.1", taken.getsockname()[1])
    first, second = open_door("127.0.0.1", None), open_door("127.0.0.1", None)
    assert first.port >= PORT
    assert second.port > first.port
    assert not second.usual
    assert first.token is None
    first.listening.close()
    second.listening.close()
    reachable = open_door("0.0.0.0", 0)
    assert reachable.token is not None
    reachable.listening.close()
    with pytest.raises(InputError, match=r"no\.such\.host\.invalid"):
        open_door("no.such.host.invalid", 0)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "127.1", "LOCALHOST"])
def test_any_name_of_loopback_is_answered_without_a_token(exhibit: Exhibit, host: str) -> None:
    door = open_door(host, 0)
    app = Guard(explorer_app(exhibit, {"index.html": b"page"}), door.hosts, door.token, door.port)
    address = door.listening.getsockname()[0]
    assert door.token is None
    assert door.url == f"http://{host}:{door.port}/"
    for name in (host, host.lower(), address, "localhost"):
        assert answer_of(app, "/", host=f"{name}:{door.port}")[0] == 200
    for name in ("127.0.0.3", "evil.example", host + "."):
        assert answer_of(app, "/", host=f"{name}:{door.port}")[0] == 421
    door.listening.close()


def test_the_address_of_all_addresses_has_the_name_of_the_machine() -> None:
    door = open_door("0.0.0.0", 0)
    assert door.url == f"http://{socket.gethostname()}:{door.port}/?token={door.token}"
    door.listening.close()
