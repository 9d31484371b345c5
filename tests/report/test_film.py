"""Films: as long as the case, in real time, with the AV in its colour where it must be; whole or not at all."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from cornerforge.analysis.avoidability import WayOut
from cornerforge.errors import InputError, MissingExtraError, OutputError
from cornerforge.ext.pictures.film import STANDS_S, check_film, film
from cornerforge.types import Scenario

MakeScenario = Callable[[int, str], Scenario]
BLUE, MINT, RED = (0x00, 0x72, 0xB2), (0x4F, 0xE0, 0xB5), (0xCC, 0x29, 0x36)
METRE = 16  # pixels of a film 1280 wide that shows 80 m


@pytest.fixture
def scenario(make_scenario: MakeScenario) -> Scenario:
    """A crash in which the AV keeps the middle one of three lanes."""
    return make_scenario(3, "cut-in")


def frames_of(path: Path) -> tuple[str, list[NDArray[np.uint8]]]:
    """What ffmpeg says of a video's stream, and its pictures, shape (720, 1280, 3)."""
    from imageio_ffmpeg import get_ffmpeg_exe

    asked = [get_ffmpeg_exe(), "-hide_banner", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1"]
    told = subprocess.run(asked, capture_output=True, check=True)
    about = next(line for line in told.stderr.decode().splitlines() if "Stream #" in line)
    return about, list(np.frombuffer(told.stdout, np.uint8).reshape(-1, 720, 1280, 3))


def is_near(pixel: NDArray[np.uint8], colour: tuple[int, int, int], by: int = 14) -> bool:
    return bool((np.abs(pixel.astype(int) - colour) <= by).all())


def has(picture: NDArray[np.uint8], colour: tuple[int, int, int]) -> bool:
    return bool((np.abs(picture.astype(int) - colour) <= 20).all(axis=-1).sum() > 40)


@pytest.mark.full
@pytest.mark.parametrize(("name", "codec"), [("a.mp4", "h264"), ("b.WEBM", "vp9")])
def test_a_film_in_real_time(scenario: Scenario, tmp_path: Path, name: str, codec: str) -> None:
    path = film(scenario, tmp_path / "new" / name, title="Case 0:3", sentence="BV cuts in", seconds=1.0)
    about, frames = frames_of(path)
    assert re.search(rf"Video: {codec}.* yuv420p.* 1280x720.* 30 fps", about)
    assert len(frames) == 30 + 1 + round(30 * STANDS_S)
    middle = round(720 * (1.0 - 0.40 - 0.43 / 2))  # of the road, and of the AV's lane
    for frame in frames:
        assert is_near(frame[middle, 640 - METRE], BLUE), "the AV stays in its place"
        for side in (-1, 1):
            assert is_near(frame[middle + side * 13, 640 - METRE], BLUE)
            assert not is_near(frame[middle + side * 20, 640 - METRE], BLUE), "it is 2 m wide"
        for end in (-1, 1) if frame is frames[0] else ():
            assert is_near(frame[middle, 640 + end * 37], BLUE)
            assert not is_near(frame[middle, 640 + end * 44], BLUE) or end < 0, "it is 5 m long, with a trail behind"
    assert [has(frames[k][middle - 40 : middle + 40], RED) for k in (0, -1)] == [False, True]
    stands = frames[-round(30 * STANDS_S) :]
    assert max(float(np.abs(one.astype(int) - stands[-1].astype(int)).mean()) for one in stands) < 1.0
    assert [path] == list((tmp_path / "new").iterdir())
    assert name.endswith("WEBM") or path.read_bytes().index(b"moov") < path.read_bytes().index(b"mdat")


@pytest.mark.full
def test_a_gif_plays_as_long_and_keeps_its_colours(scenario: Scenario, tmp_path: Path) -> None:
    path = film(scenario, tmp_path / "a.gif", title="Case 0:3", seconds=1.0)
    with Image.open(path) as gif:
        assert (gif.size, getattr(gif, "n_frames", 1)) == ((800, 450), 10 + 1)
        times = []
        for k in range(11):
            gif.seek(k)
            times.append(gif.info["duration"])
            pixels = np.asarray(gif.convert("RGB"))
            assert tuple(pixels[173, 400 - 10]) == BLUE
            assert tuple(pixels[0, 0]) == (255, 255, 255)
    assert times == [100] * 10 + [100 + 500], "it stands for half a second"
    again = film(scenario, tmp_path / "b.gif", title="Case 0:3", seconds=1.0)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.full
def test_the_way_out_is_seen_where_there_is_one(scenario: Scenario, tmp_path: Path) -> None:
    n = 12
    x = scenario.x[-6, 0] - 6.0 + 3.0 * np.arange(n)
    way = WayOut(0.5, x, np.full(n, 10.0), np.full(n, 30.0), np.zeros(n))
    pictures = []
    for way_out in (None, way):
        film(scenario, tmp_path / "a.gif", title="Case", seconds=0.4, way_out=way_out)
        with Image.open(tmp_path / "a.gif") as gif:
            pictures.append(np.asarray(gif.convert("RGB")))
    assert [has(picture, MINT) for picture in pictures] == [False, True]


def test_a_case_without_a_crash_ends_with_the_recording(scenario: Scenario, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    quiet = replace(scenario, crash=None)
    film(quiet, tmp_path / "a.gif", title="Case", seconds=0.5, progress=lambda *at: calls.append(at))
    assert calls == [(k, 11) for k in range(1, 12)]


class StoppedError(Exception):
    pass


@pytest.mark.parametrize("name", ["a.mp4", "a.gif"])
def test_a_film_is_whole_or_absent(scenario: Scenario, tmp_path: Path, name: str) -> None:
    def stop(*at: int) -> None:
        if at[0] == 4:
            raise StoppedError

    with pytest.raises(StoppedError):
        film(scenario, tmp_path / name, title="Case", seconds=1.0, progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_of_ffmpeg_is_one_line(scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "fails").write_text("#!/bin/sh\necho first >&2\necho no room >&2\nexit 3\n", encoding="utf-8")
    (tmp_path / "fails").chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(tmp_path / "fails"))
    with pytest.raises(OutputError, match=r"could not write the video \(no room\)"):
        film(scenario, tmp_path / "a.mp4", title="Case", seconds=1.0)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(tmp_path / "none"))
    with pytest.raises(OutputError, match=r"write a \.gif instead"):
        film(scenario, tmp_path / "a.mp4", title="Case", seconds=1.0)
    assert [path.name for path in tmp_path.iterdir()] == ["fails"]


def test_what_cannot_be_made_is_told_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"neither in \.mp4 nor in \.gif nor in \.webm"):
        check_film(tmp_path / "a.avi")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match=r"cornerforge\[video\]"):
        check_film(tmp_path / "a.mp4")
    check_film(tmp_path / "a.gif")  # Pillow comes with matplotlib
