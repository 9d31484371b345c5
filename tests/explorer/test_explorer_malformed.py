"""5,000 malformed requests over sockets: no error of the server, nothing read that is not shown, and it goes on."""

from __future__ import annotations

import contextlib
import json
import random
import re
import socket
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest
from explorer.conftest import CANARY, Running

pytestmark = pytest.mark.full

N = 5_000
PATHS = [
    "/", "/assets/explorer.js", "/api/about", "/api/columns", "/api/case/adversary/3:0", "/api/case/natural/4:1",
    "/api/case/adversary/3:0/ghosts", "/api/case/adversary/3:0/with/idm-mobil", "/api/case/adversary/3:0/download/json",
    "/api/sql",
]  # fmt: skip
UP = ["..", "../..", "%2e%2e", "%2E%2E", "..%2f", "..%5c", "%2e%2e%2f", "..%c0%af", "..%252f", "%252e%252e%252f",
      "....//",
      "..;/", "%c0%ae%c0%ae/", "..\\", "%uff0e%uff0e/", "..%00/", ".%2e", "%2e./", "//", "/./", "file:///", "~",
      "%7e"]  # fmt: skip
SECRETS = ["secret.txt", "library/secret.txt", "manifest.json", "library/manifest.json", "etc/passwd",
           "proc/self/environ",
           "proc/self/cmdline", "run/library/tracks-000000.parquet", "C:/Windows/win.ini", "__init__.py"]  # fmt: skip
NAMES = ["", "a" * 5000, "%00", "%0d%0aX: y", "'", '"', "<script>", "${7*7}", "{{7*7}}", "NaN", "-1", "1e999", "%ff%fe",
         "%F0%9F%9A%97", "None", "null", "..", ".", "*", "?", "#", "%", "%%", "%zz", ";", "a:b:c", "9" * 400, "0x1",
         "natural",
         "3:0%20", " 3:0", "3:-1", "3:99999999999999999999", "0:0", "3:0@rl", "\\u202e", "CON", "con.json"]  # fmt: skip
METHODS = [
    "GET",
    "HEAD",
    "POST",
    "PUT",
    "DELETE",
    "PATCH",
    "OPTIONS",
    "TRACE",
    "CONNECT",
    "get",
    "BREW",
    "PROPFIND",
    "M" * 300,
]
BODIES = [
    b"", b"{", b"[]", b"null", b"NaN", b'{"where": NaN}', b'{"where": 1}', b'{"where": ""}', b'{"where": null}',
    b"\xff\xfe{}",
    b'{"where": "\\ud800"}', b"[" * 50_000, b'{"a":' * 5_000, b'{"where": [1], "more": 2}',
    b"1e999999",
    b'{"where": "' + b"a" * 20_000 + b'"}', b"x" * 70_000, b'"\\u0000"',
    b"\x00" * 100,
    b'{"where": "(((("}', b'{"where": "select * from read_text(\'secret.txt\')"}', b"9" * 30_000,
    b'{"where": {"where": "1"}}',
]  # fmt: skip


def request(
    method: str,
    target: str,
    headers: list[tuple[str, str]] | None = None,
    body: bytes = b"",
    *,
    port: int,
    version: str = "1.1",
) -> bytes:
    lines = [f"{method} {target} HTTP/{version}", f"Host: 127.0.0.1:{port}", "Connection: close"]
    lines += [f"{name}: {value}" for name, value in headers or []]
    if body:
        lines.append(f"Content-Length: {len(body)}")
    return "\r\n".join(lines).encode("utf-8", "surrogatepass") + b"\r\n\r\n" + body


def malformed(rng: random.Random, port: int) -> Iterator[bytes]:
    """One after the other: by hand first, then drawn."""
    host = f"Host: 127.0.0.1:{port}".encode()
    upgrade = [("Upgrade", "websocket"), ("Connection", "Upgrade"), ("Sec-WebSocket-Version", "13"),
               ("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ==")]  # fmt: skip
    json_line = b"\r\nContent-Type: application/json\r\n"
    yield from (request("GET", path, upgrade, port=port) for path in PATHS)
    yield from (request("GET", path, [("Upgrade", "h2c"), ("Connection", "Upgrade")], port=port) for path in PATHS)
    yield from [
        b"GET /\r\n\r\n", b"GET / HTTP/0.9\r\n\r\n", b"\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"\x00" * 2000,
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n", b"GET / HTTP/9.9\r\n" + host + b"\r\n\r\n",
        b"GET  / HTTP/1.1\r\n" + host + b"\r\n\r\n", b"GET / HTTP/1.1\n" + host + b"\n\n",
        b"GET http://evil/ HTTP/1.1\r\n" + host,
        b"GET http://evil.example/api/about HTTP/1.1\r\n" + host + b"\r\n\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\n" + host + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\n" + host + b"\r\n\r\n", b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1:1\r\n\r\n", b"GET / HTTP/1.1\r\nHost:\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: \xff\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\nX: " + b"a" * 200_000 + b"\r\n\r\n",
        b"GET /" + b"a" * 200_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\n" + b"".join(b"X%d: y\r\n" % i for i in range(5_000)) + b"\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\nno colon\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\n folded: y\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\nX\x00Y: y\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\nX: y\x00z\r\n\r\n",
        b"POST /api/sql HTTP/1.1\r\n" + host + b"\r\nContent-Length: -1\r\n\r\n", b"*" * 100_000,
        b"POST /api/sql HTTP/1.1\r\n" + host + b"\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\nabcdef",
        b"POST /api/sql HTTP/1.1\r\n" + host + b"\r\nContent-Length: 99999999999999999999\r\n\r\nx",
        b"POST /api/sql HTTP/1.1\r\n" + host + b"\r\nContent-Length: 9\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        b"POST /api/sql HTTP/1.1\r\n" + host + b"\r\nTransfer-Encoding: chunked\r\n\r\nzzz\r\n",
        b"POST /api/sql HTTP/1.1\r\n" + host + b"\r\nTransfer-Encoding: gzip\r\n\r\nzzz\r\n",
        b"POST /api/sql HTTP/1.1\r\n" + host + json_line + b"Content-Length: 500\r\n\r\n{",
        b"GET /api/columns?" + b"&".join(b"a%d=1" % i for i in range(3_000)) + b" HTTP/1.1\r\n" + host + b"\r\n\r\n",
        b"GET /api/columns?names=" + b",".join([b"pc1"] * 8_000) + b" HTTP/1.1\r\n" + host + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\nRange: bytes=0-1,5-9,99999999999-\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\nExpect: 100-continue\r\nContent-Length: 3\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\nContent-Encoding: br\r\nAccept-Encoding: zstd;q=NaN\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"\r\nCookie: " + b"a=b; " * 3_000 + b"\r\n\r\n",
    ]  # fmt: skip
    for up in UP:
        for times in (1, 3, 8):
            for secret in SECRETS[:6]:
                way = "/".join([up] * times)
                for before in ("/", "/assets/", "/api/case/adversary/"):
                    yield request("GET", f"{before}{way}/{secret}".replace(" ", "%20"), port=port)
    json_body = [("Content-Type", "application/json")]
    while True:
        kind = rng.randrange(6)
        name, path = rng.choice(NAMES).replace(" ", "%20"), rng.choice(PATHS)
        if kind == 0:  # the wrong method, with or without a body
            yield request(rng.choice(METHODS), path, json_body, rng.choice(BODIES), port=port)
        elif kind == 1:  # bad bodies for what takes one
            head = [*json_body, ("Origin", f"http://127.0.0.1:{port}")][: rng.randrange(3)]
            yield request("POST", "/api/sql", head, rng.choice(BODIES), port=port)
        elif kind == 2:  # absurd names
            way = rng.choice([f"/api/case/{name}/3:0", f"/api/case/adversary/{name}",
                              f"/api/case/adversary/3:0/with/{name}",
                              f"/api/case/adversary/3:0/download/{name}", f"/assets/{name}", f"/{name}",
                              f"/api/columns?names={name}", f"/api/columns?names=pc1,{name}",
                              f"/api/about?{name}={name}",
                              f"/api/case/{name}/{name}/ghosts", f"/api/case/adversary/3:0/{name}"])  # fmt: skip
            yield request("GET", way, port=port)
        elif kind == 3:  # headers
            odd = [("Host", "evil.example"), ("Origin", "http://evil.example"), ("Origin", "null"), ("Range",
                   f"bytes={name}-"),
                   ("Content-Type", "text/plain"), ("Content-Type", name), ("Cookie", f"cornerforge={name}"),
                   ("Referer", name),
                   ("X-Forwarded-Host", "evil.example"), ("X-Forwarded-For", "1.2.3.4"), ("Transfer-Encoding", name),
                   ("Connection", "close, keep-alive"), ("X-HTTP-Method-Override", "PUT"), ("If-None-Match",
                   "*")]  # fmt: skip
            method = rng.choice(["GET", "GET", "POST", "PUT"])
            yield request(method, path, rng.sample(odd, 2), rng.choice(BODIES) if method != "GET" else b"", port=port)
        elif kind == 4:  # bytes of a good request, changed
            good = bytearray(request("GET", path, [("Accept", "*/*")], port=port))
            for _ in range(rng.randrange(1, 6)):
                good[rng.randrange(len(good))] = rng.randrange(256)
            yield bytes(good)
        else:  # or cut off, or noise
            whole = request("POST", "/api/sql", json_body, b'{"where": "value > 1"}', port=port)
            yield whole[: rng.randrange(len(whole))] if rng.random() < 0.7 else rng.randbytes(rng.randrange(1, 300))


def is_whole(content: bytes) -> bool:
    """Say whether the server can know where a request of `request` ends, and that no other comes."""
    head, end, body = content.partition(b"\r\n\r\n")
    length = re.search(rb"\r\nContent-Length: (\d+)$", head)
    return end != b"" and b"\r\nConnection: close\r\n" in content and len(body) == (int(length[1]) if length else 0)


def answer_to(content: bytes, port: int, *, is_whole: bool = True) -> bytes:
    """Send and read to the end; of what is perhaps no whole request say soon that there is no more."""
    with socket.create_connection(("127.0.0.1", port), timeout=10 if is_whole else 0.01) as to:
        got = b""
        with contextlib.suppress(OSError):  # it need not read all of it
            to.sendall(content)
        with contextlib.suppress(ConnectionError):
            try:
                while piece := to.recv(65536):
                    got += piece
            except TimeoutError:
                to.settimeout(30)
                to.shutdown(socket.SHUT_WR)
                while piece := to.recv(65536):
                    got += piece
        return got


def test_malformed_requests_break_nothing_and_show_nothing(server: Running, place: Path) -> None:
    before = {path: path.read_bytes() for path in place.parent.rglob("*") if path.is_file()}
    rng, seen = random.Random(20_210_206), Counter[str]()
    for number, content in zip(range(N), malformed(rng, server.port), strict=False):
        if b"/ghosts" in content or b"/with/idm-mobil" in content:
            continue  # these are good requests, and driving takes time
        got = answer_to(content, server.port, is_whole=is_whole(content))
        status = got[9:12].decode("latin-1") if got.startswith(b"HTTP/1.1 ") else "none"
        seen[status] += 1
        assert not status.startswith("5"), (number, content[:300], got[:300])
        assert CANARY.encode() not in got, (number, content[:300])
        assert b"root:" not in got, (number, content[:300])
        assert b"Traceback" not in got, (number, content[:300])
    # They reached what they were meant to reach.
    assert {"200", "400", "403", "404", "405", "413", "415", "421", "none"} <= set(seen), seen
    assert server.process.poll() is None
    with urlopen(server.url + "api/about") as answer:
        assert json.load(answer)["name"] == "run"
    assert {path: path.read_bytes() for path in place.parent.rglob("*") if path.is_file()} == before


def test_the_canary_would_be_seen(place: Path) -> None:
    """The secret is where the paths of the requests lead."""
    for secret in ("secret.txt", "../secret.txt", "library/secret.txt"):
        assert (place / secret).read_text(encoding="utf-8") == CANARY


@pytest.mark.parametrize("path", ["/", "/api/about", "/api/nothing", "/assets/explorer.js"])
def test_every_answer_is_guarded(server: Running, path: str) -> None:
    got = answer_to(request("GET", path, [("Connection", "close")], port=server.port), server.port).lower()
    for header in (b"content-security-policy: default-src 'none'", b"x-content-type-options: nosniff"):
        assert header in got
    assert (b"cache-control: no-store" in got) == (not path.startswith("/assets"))
