from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge._checksums import (
    NoChecksumError,
    read_arrays,
    read_json,
    read_tensors,
    with_checksum,
    write_arrays,
    write_tensors,
)
from cornerforge._table_checks import TableChecks, read_parquet, with_checks, write_parquet
from cornerforge.errors import FileFormatError

ARRAYS = {"a": np.arange(12.0).reshape(3, 4), "b": np.array([1, 2], np.int8), "text": np.array("hello")}


def a_table() -> pa.Table:
    return pa.table(
        {
            "id": pa.array(["a", "bc", "", None]),
            "speed": pa.array([1.5, None, float("nan"), -0.0]),
            "lane": pa.array([1, 2, 3, 4], pa.int8()),
            "here": pa.array([True, False, None, True]),
            "xs": pa.array([[1.0, 2.0], [], None, [3.0]], pa.list_(pa.float32())),
            "pair": pa.array([[1.0, 2.0]] * 4, pa.list_(pa.float32(), 2)),
        }
    )


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(), JSON))
def test_an_object_keeps_its_checksum_through_a_file(content: dict[str, object]) -> None:
    content.pop("sha256", None)
    path = Path(os.environ["CHECKSUM_TMP"]) / "o.json"
    path.write_text(json.dumps(with_checksum(content), indent=2), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_json(path, "make it again") == content


@pytest.fixture(autouse=True, scope="module")
def _place(tmp_path_factory: pytest.TempPathFactory) -> None:
    os.environ["CHECKSUM_TMP"] = str(tmp_path_factory.mktemp("checksum"))


def test_a_changed_value_of_an_object_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "o.json"
    path.write_text(json.dumps(with_checksum({"crashes": 12, "deep": {"n": [1, 2]}})), encoding="utf-8")
    text = path.read_text(encoding="utf-8")
    for old, new in (("12", "13"), ("[1, 2]", "[2, 1]"), ('"n"', '"m"')):
        path.write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(FileFormatError, match=r"o\.json has been changed since it was written"):
            read_json(path, "make it again")


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b"\xff\xfe", b"[" * 100_000, rb'{"a": ["\ud800"]}'])
def test_what_is_no_object_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "o.json"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"o\.json .*; make it again\."):
        read_json(path, "make it again")


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for read in (
        lambda path: read_json(path, "make it again"),
        lambda path: read_arrays(path, "model"),
        lambda path: read_tensors(path, "k", "policy"),
        lambda path: read_parquet(path, "cornerforge analyse"),
    ):
        with pytest.raises(FileFormatError, match="is no regular file"):
            read(tmp_path / "pipe")


def test_arrays_come_back_and_name_the_part_that_was_changed(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    write_arrays(path, ARRAYS)
    found = read_arrays(path, "model")
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array)
    checksums = np.load(path)["checksums"]
    for changed in (ARRAYS["b"][::-1], ARRAYS["b"].astype(np.int16), ARRAYS["b"][:1]):
        np.savez(path, **{**ARRAYS, "b": changed}, checksums=checksums)  # type: ignore[arg-type]
        with pytest.raises(FileFormatError, match='its part "b" has been changed'):
            read_arrays(path, "model")
    np.savez(path, **{name: ARRAYS[name] for name in ("a", "text")}, checksums=checksums)  # type: ignore[arg-type]
    with pytest.raises(FileFormatError, match='its part "b" is missing'):
        read_arrays(path, "model")
    np.savez(path, **ARRAYS)  # type: ignore[arg-type]
    with pytest.raises(NoChecksumError, match="cornerforge migrate"):
        read_arrays(path, "model")
    assert read_arrays(path, "model", old=True).keys() == ARRAYS.keys()


def test_any_changed_bit_of_arrays_is_noticed_or_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    write_arrays(path, ARRAYS)
    whole = path.read_bytes()
    noticed = 0
    for bit in range(0, 8 * len(whole), 7):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            found = read_arrays(path, "model")
        except FileFormatError:
            noticed += 1
            continue
        assert all(np.array_equal(found[name], array) for name, array in ARRAYS.items())  # a date in the archive
    assert noticed > 0.6 * len(range(0, 8 * len(whole), 7))


@pytest.mark.full
def test_the_same_tensors_give_the_same_bytes_in_every_process(tmp_path: Path) -> None:
    """The library itself writes the metadata in an order that it draws: of ten files some would differ."""
    script = (
        "import sys; from pathlib import Path; import numpy as np; from cornerforge._checksums import write_tensors\n"
        "write_tensors(Path(sys.argv[1]), 'ours', {'a': 'ä'}, {'weights': np.arange(3.0)}, 'it')"
    )
    files = [tmp_path / f"{number}.safetensors" for number in range(10)]
    for file in files:
        subprocess.run([sys.executable, "-c", script, str(file)], check=True)
    assert len({file.read_bytes() for file in files}) == 1


def test_tensors_come_back_and_a_changed_header_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "p.safetensors"
    write_tensors(path, "kind", {"n": 3}, {"w": ARRAYS["a"]}, "the policy")
    header, tensors = read_tensors(path, "kind", "policy")
    assert header == {"n": 3}
    np.testing.assert_array_equal(tensors["w"], ARRAYS["a"])
    path.write_bytes(path.read_bytes().replace(b'\\"n\\": 3', b'\\"n\\": 4'))
    with pytest.raises(FileFormatError, match="has been changed"):
        read_tensors(path, "kind", "policy")
    with pytest.raises(FileFormatError, match="no model of cornerforge"):
        read_tensors(path, "other", "model")


def test_a_table_keeps_its_checks_through_a_file(tmp_path: Path) -> None:
    path, table = tmp_path / "t.parquet", a_table()
    write_parquet(path, table)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert str(read_parquet(path, "make it").to_pydict()) == str(table.to_pydict())  # as texts: NaN is in it
        assert read_parquet(path, "make it", ["lane"]).column_names == ["lane"]
    with pytest.raises(FileFormatError, match=r"lacks the column\(s\) nothing; write it again with: make it"):
        read_parquet(path, "make it", ["lane", "nothing"])
    assert read_parquet(path, "make it", ["lane", "nothing"], fewer=True).column_names == ["lane"]
    pq.write_table(table, path)
    with pytest.raises(NoChecksumError):
        read_parquet(path, "make it")


CELLS = {
    "id": (1, "bd"), "speed": (0, 1.5000000000000002), "lane": (3, 5), "here": (2, False),
    "xs": (1, [0.0]), "pair": (2, [2.0, 1.0]),
}  # fmt: skip


@pytest.mark.parametrize("column", CELLS)
def test_a_changed_cell_is_named_by_column_and_row(column: str, tmp_path: Path) -> None:
    table = with_checks(a_table())
    row, value = CELLS[column]
    values = table.column(column).to_pylist()
    values[row] = value
    place = table.column_names.index(column)
    changed = table.set_column(place, table.field(column), pa.array(values, table.field(column).type))
    pq.write_table(changed, tmp_path / "t.parquet")
    with pytest.raises(FileFormatError, match=f"changed in the column {column}, row {row} since"):
        read_parquet(tmp_path / "t.parquet", "make it")
    checks = TableChecks.of(table.schema)
    assert checks is not None
    assert checks.fault(changed.select([column])) == f"has been changed in the column {column}"
    rows = [checks.row_fault(changed.slice(i, 1), i) for i in range(4)]
    assert [i for i, fault in enumerate(rows) if fault is not None] == [row]


@pytest.mark.parametrize(
    "change", [lambda t: t.slice(1), lambda t: t.take([1, 0, 2, 3]), lambda t: t.append_column("n", t["id"])]
)
def test_other_rows_and_columns_are_noticed(change: object, tmp_path: Path) -> None:
    changed = change(with_checks(a_table()))  # type: ignore[operator]
    pq.write_table(changed, tmp_path / "t.parquet")
    with pytest.raises(FileFormatError):
        read_parquet(tmp_path / "t.parquet", "make it")


def test_checks_do_not_depend_on_how_a_table_lies_in_memory() -> None:
    table = a_table()
    checks = TableChecks.of(with_checks(table).schema)
    assert checks is not None
    pieces = pa.concat_tables([table.slice(0, 1), table.slice(1, 2), table.slice(3)])
    assert checks.fault(pieces) is None
    assert checks.fault(pa.concat_tables([table.slice(2), table]).slice(2)) is None
