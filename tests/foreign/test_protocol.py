"""Messages of an AV's process that are damaged: a fault in one line, never another error."""

from __future__ import annotations

import json
import socket
import struct
from pathlib import Path

import numpy as np
import pytest

from cornerforge.errors import CornerForgeError
from cornerforge.foreign.process import AvFailureError, AvProcess
from cornerforge.foreign.protocol import ANSWER, FAILED, JunkError, pack, pack_json
from cornerforge.foreign.session import context_of
from cornerforge.types import Odd

NOBODY = np.zeros(0, np.int64)
MUTATIONS = 2_000


def recorded(number: int, rows: int) -> list[bytes]:
    """Messages as a process sends them: answers, answers with failures, and failures."""
    answers = np.tile([-1.0, 1.0], (rows, 1)).tobytes()
    told = {"failed": {"1": ["raised", "raised ValueError(x)"]}, "traces": {"raised ValueError(x)": "Traceback\n"}}
    text = json.dumps(told).encode()
    return [
        pack(ANSWER, number, np.int64(0).tobytes(), answers),
        pack(ANSWER, number, np.int64(len(text)).tobytes(), text, answers),
        pack_json(FAILED, number, {"what": "raised", "message": "ValueError(x)", "trace": "Traceback\n"}),
        pack_json(FAILED, number, {"what": "answer", "message": "act returned nothing"}),
        pack_json(FAILED, number, {"what": "refused", "message": "no", "error": "InputError"}),
    ]


def mutated(message: bytes, rng: np.random.Generator) -> bytes:
    """Damage a message in one to four places: bytes that are others, gone, new, twice, or large lengths."""
    data = bytearray(message)
    for _ in range(rng.integers(1, 5)):
        k, n = int(rng.integers(len(data) or 1)), int(rng.integers(1, 9))
        match int(rng.integers(6)):
            case 0:
                data[k : k + n] = rng.bytes(n)
            case 1:
                del data[k : k + n]
            case 2:
                data[k:k] = rng.bytes(n)
            case 3:
                data += data[k:]
            case 4:
                data[9:17] = struct.pack("<Q", (0, 1, 1 << 20, 1 << 30, 1 << 32, (1 << 64) - 1)[rng.integers(6)])
            case _:
                data[17:25] = struct.pack("<q", (-1, 1, 7, 1 << 40, -(1 << 60))[rng.integers(5)])
    return bytes(data)


def test_a_damaged_answer_is_a_fault(avs: Path) -> None:  # noqa: ARG001
    process = AvProcess("avs:Good", timeout=20.0, first_timeout=20.0)
    process.setup(context_of(Odd(), batch=4, seed=0))
    rng, view = np.random.default_rng(5), np.ones((4, 13, 8), np.float32)
    ends = dict.fromkeys(("answered", "failed"), 0)
    for _ in range(MUTATIONS):
        ours, theirs = socket.socketpair()
        with theirs:
            process._connection = process._line = ours
            choices = recorded(process._question + 1, 4)
            theirs.sendall(mutated(choices[int(rng.integers(len(choices)))], rng))
            theirs.shutdown(socket.SHUT_WR)
            said = ""
            try:
                answers, failed = process.act(view, NOBODY, NOBODY)
            except (AvFailureError, CornerForgeError) as failure:
                said = str(failure) or "\n"
            ends["failed" if said else "answered"] += 1
            assert said.isprintable()
            assert said or answers.shape == (4, 2)
            assert said or set(failed) <= {0, 1, 2, 3}
        ours.close()
    assert min(ends.values()) > 50


def test_what_is_said_of_a_damaged_av_is_checked(avs: Path) -> None:  # noqa: ARG001
    process = AvProcess("avs:Good", timeout=20.0, first_timeout=20.0)
    rng = np.random.default_rng(6)
    said: dict[str, object] = dict(process.about)
    loaded = 0
    for _ in range(500):
        ours, theirs = socket.socketpair()
        with theirs:
            process._connection = process._line = ours
            theirs.sendall(mutated(pack_json(ANSWER, process._question + 1, said), rng))
            theirs.shutdown(socket.SHUT_WR)
            try:
                about = process._load()
            except (AvFailureError, JunkError, CornerForgeError):
                continue
            finally:
                ours.close()
        loaded += 1
        assert set(about) == set(said)
        assert about["form"] == "view"
        assert int(about["objects"] or 0) >= -1
    lies: tuple[dict[str, object], ...] = (
        {"form": "wish"}, {"objects": "x"}, {"hash": 7}, {"kind": None}, {"more": "x"}, {"remembers": []},
        {"read": "a\n"},
    )  # fmt: skip
    for lie in lies:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            process._connection = process._line = ours
            theirs.sendall(pack_json(ANSWER, process._question + 1, said | lie))
            with pytest.raises(JunkError, match="it says of the AV"):
                process._load()
