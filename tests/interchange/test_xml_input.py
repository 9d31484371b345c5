"""XML from anywhere: read with its lines, or refused with one clear error."""

from __future__ import annotations

from pathlib import Path

import pytest

from cornerforge.errors import CornerForgeError, DataError, FileFormatError, InputError
from cornerforge.ext.interchange import xml_input
from cornerforge.ext.interchange.xml_input import Element, read_xml

BOMB = """<?xml version="1.0"?>
<!DOCTYPE a [<!ENTITY b "bang"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">]>
<a>&c;</a>"""


def read(tmp_path: Path, text: str | bytes, root: str = "a") -> Element:
    file = tmp_path / "some.xml"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_xml(file, root=root, what="a file of a's")


def test_elements_know_their_lines(tmp_path: Path) -> None:
    top = read(tmp_path, '<a xmlns:n="u">\n  <b n:x="1.5" y="3"/>\n\n  <b x="2"><c> 7 </c></b>\n</a>')
    first, second = top.all("b")
    assert (first.line, second.line, top.line) == (2, 4, 1)
    assert first.number("x") == 1.5
    assert first.integer("y", low=0, high=5) == 3
    assert second.need("c").number(None) == 7.0
    assert second.place == "some.xml, line 4"
    assert top.child("b", "c") is None  # the first b has none
    assert first.string("z", "none") == "none"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1", "cp1252"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    stated = {"utf-8-sig": "utf-8", "latin-1": "iso-8859-1", "cp1252": "windows-1252"}.get(encoding, encoding)
    text = f'<?xml version="1.0" encoding="{stated}"?><a b="größer"/>'
    assert read(tmp_path, text.encode(encoding)).string("b") == "größer"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: this is no whole XML file"),
        ("no xml at all", "no whole XML file"),
        ('<a>\n<b x="1"/>\n', "line 3: this is no whole XML file.*cut off"),
        ("<a><b></a></b>", "mend it"),
        ("<a/><a/>", "no whole XML file"),
        ("<b/>", "not a file of a's: it begins with <b>"),
        (BOMB, "line 2: it declares a document type or entities"),
        ('<!DOCTYPE a SYSTEM "http://127.0.0.1/x.dtd"><a/>', "declares a document type"),
        ('<!DOCTYPE a [<!ENTITY f SYSTEM "file:///etc/hostname">]><a>&f;</a>', "declares a document type"),
        ("<a>&unknown;</a>", "no whole XML file"),
        ('<?xml version="1.0" encoding="klingon"?><a/>', "encoding"),
        ('<?xml version="1.0" encoding="utf-7"?><a/>', "encoding"),
        (b'<?xml version="1.0" encoding="utf-8"?><a b="\xff\xfe"/>', "no whole XML file"),
        ("<a>" + "<b>" * 100_000, "more than 64 deep"),
        (b"<a>\x00</a>", "no whole XML file"),
    ],
)  # fmt: skip
def test_what_is_refused(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path, text)


def test_too_many_elements(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xml_input, "_MOST_ELEMENTS", 1000)  # a million of them take a third of a gigabyte
    assert len(read(tmp_path, "<a>" + "<b/>" * 999 + "</a>").children) == 999
    with pytest.raises(FileFormatError, match="more than 1,000 elements"):
        read(tmp_path, "<a>" + "<b/>" * 1000 + "</a>")


def test_files_that_are_none(tmp_path: Path) -> None:
    for place in (tmp_path, tmp_path / "nowhere.xml", Path("a\0b"), Path("x" * 5000)):
        with pytest.raises(InputError):
            read_xml(place, root="a", what="a file of a's")
    large = tmp_path / "large.xml"
    with large.open("wb") as file:
        file.truncate(65 * 2**20)
    with pytest.raises(FileFormatError, match=r"65 MB; up to 64 MB"):
        read_xml(large, root="a", what="a file of a's")


@pytest.mark.parametrize("value", ["NaN", "inf", "-inf", "1e999", "", "two", "9" * 400, "11"])
def test_numbers_that_are_none(tmp_path: Path, value: str) -> None:
    top = read(tmp_path, f'<a x="{value}"><b>{value}</b></a>')
    with pytest.raises(DataError, match=r'some.xml, line 1: x of a is ".*"; allowed: 0 to 10 m') as caught:
        top.number("x", low=0.0, high=10.0, unit="m")
    assert len(str(caught.value)) < 150
    with pytest.raises(DataError, match="b is"):
        top.need("b").number(None, low=0.0, high=10.0)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    top = read(tmp_path, '<a x="1.5"/>')
    with pytest.raises(DataError, match="a lacks b/c"):
        top.need("b", "c")
    with pytest.raises(DataError, match="a lacks y"):
        top.string("y")
    with pytest.raises(DataError, match="y of a is missing"):
        top.number("y")
    with pytest.raises(DataError, match=r"x of a is 1\.5, no whole number"):
        top.integer("x", low=0, high=3)
    assert issubclass(DataError, CornerForgeError)
