"""Pictures one after another into a video: GIF by Pillow, MP4 and WebM by ffmpeg, which is called as a program."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import InputError, MissingExtraError, OutputError

__all__ = ["FORMATS", "Format", "check_format", "encode"]

Picture = NDArray[np.uint8]
"""Red, green, blue and opacity of each pixel, shape (height, width, 4)."""


@dataclass(frozen=True)
class Format:
    """A kind of video.

    Attributes:
        size: Width and height [pixels].
        per_second: Pictures a second.
        codec: Options of ffmpeg; () for the format that Pillow writes.
    """

    size: tuple[int, int]
    per_second: int
    codec: tuple[str, ...] = ()


_WHOLE = ("-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact")
"""No names of programs, no times: the same pictures give the same bytes with the same ffmpeg."""
_H264 = "-c:v libx264 -crf 20 -preset veryfast -movflags +faststart -f mp4"
_VP9 = "-c:v libvpx-vp9 -crf 32 -b:v 0 -deadline realtime -cpu-used 7 -row-mt 1 -f webm"
FORMATS: dict[str, Format] = {
    ".mp4": Format((1280, 720), 30, tuple(_H264.split())),
    ".gif": Format((800, 450), 10),
    ".webm": Format((1280, 720), 30, tuple(_VP9.split())),
}
"""Encoders by the ending of the file's name. MP4: H.264 with its index first, so that it plays while it loads."""


def check_format(path: Path) -> Format:
    """Check, before long work, that a video of this name can be made here.

    Raises:
        InputError: The name ends otherwise than a video's.
        MissingExtraError: What writes it is not installed.
    """
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise InputError(f"{path} ends neither in .mp4 nor in .gif nor in .webm; name the video with one of them.")
    if kind.codec:
        _ffmpeg()
    return kind


def _ffmpeg() -> str:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise MissingExtraError("imageio-ffmpeg", "video") from None
    try:
        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError:
        raise InputError(
            "imageio-ffmpeg found no ffmpeg for this machine; install ffmpeg, or write a .gif instead."
        ) from None


def encode(pictures: Iterable[Picture], part: Path, kind: Format) -> None:
    """Write a video.

    Args:
        pictures: One after another, all of the format's size; each may be overwritten when the next is asked for.
        part: The file; an existing one is replaced.
        kind: What it shall be.

    Raises:
        OutputError: It cannot be written.
    """
    if kind.codec:
        _by_ffmpeg(pictures, part, kind)
    else:
        _by_pillow(pictures, part, kind)


def _by_ffmpeg(pictures: Iterable[Picture], part: Path, kind: Format) -> None:
    width, height = kind.size
    command = [
        _ffmpeg(), "-hide_banner", "-loglevel", "error", "-nostdin", "-y",
        "-f", "rawvideo", "-pix_fmt", "rgba", "-s", f"{width}x{height}", "-r", str(kind.per_second), "-i", "pipe:0",
        # Stated, because players assume HDTV's colours for a film of this size.
        "-vf", "scale=out_color_matrix=bt709:out_range=tv", "-pix_fmt", "yuv420p",
        "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709",
        *_WHOLE, *kind.codec, str(part.absolute()),
    ]  # fmt: skip
    with tempfile.TemporaryFile() as said:
        try:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said)
        except OSError as error:
            raise OutputError(f"ffmpeg cannot be started ({error}); write a .gif instead.") from error
        assert process.stdin is not None
        try:
            with suppress(BrokenPipeError):  # it ended early, and its status says so
                for picture in pictures:
                    process.stdin.write(picture.tobytes())
            with suppress(BrokenPipeError):
                process.stdin.close()
            status = process.wait()
        except BaseException:
            process.kill()
            with suppress(BrokenPipeError):
                process.stdin.close()
            process.wait()
            raise
        if status != 0:
            said.seek(0)
            lines = said.read().decode(errors="replace").strip().splitlines()
            why = lines[-1] if lines else f"status {status}"
            raise OSError(f"ffmpeg could not write the video ({why})")


def _by_pillow(pictures: Iterable[Picture], part: Path, kind: Format) -> None:
    from PIL import Image

    images = (Image.fromarray(picture[..., :3].copy()) for picture in pictures)
    next(images).save(
        part, format="GIF", save_all=True, append_images=images, duration=1000 // kind.per_second, loop=0,
        optimize=False, disposal=1,
    )  # fmt: skip
