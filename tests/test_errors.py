"""Messages: one readable line, whatever stands in a file's name or in another library's message."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.cli import main
from cornerforge.errors import FileFormatError, OutputError, one_line


@given(st.text(st.characters(), max_size=3000))
def test_any_text_becomes_one_line_that_can_be_printed(text: str) -> None:
    line = one_line(text)
    assert line.isprintable()
    assert len(line) <= 2000
    line.encode()


def test_a_plain_message_stays_as_it_is() -> None:
    text = 'Größe "x" = -0.5 m/s² is out of range; allowed: 0 to 5 × 3.'
    assert one_line(text) == str(FileFormatError(text)) == str(OutputError(text)) == text


def test_a_message_over_several_lines_is_one() -> None:
    assert str(FileFormatError("damaged: Couldn't read:\nInvalid data")) == "damaged: Couldn't read:\\nInvalid data"
    assert len(str(FileFormatError("\0" * 10_000))) <= 2000


@pytest.mark.parametrize("name", ["a\nb.npz", "a\x1b[2Jb.npz", "n" * 9000 + ".npz"])
def test_the_command_line_complains_in_one_line(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "--tests", "1", "--model", name]) == 2
    said = capsys.readouterr().err
    assert said.startswith("cornerforge: ")
    assert said.removesuffix("\n").isprintable()
    assert len(said) < 2100
