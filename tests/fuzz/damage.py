"""Damage: one change of one file, written down as a small object of JSON (a recipe) that can be made again.

A recipe names places by key, by name of an array or column, or by a share of the length (0 to 1), never by content: so
it still fits when a format changes a little. `drawn` draws one for a file by its suffix, `done` makes it.
"""

from __future__ import annotations

import gzip
import os
import re
import shutil
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
from fuzz.parts import Parts, parts_of, write_parts

__all__ = ["Recipe", "could_notice", "done", "drawn"]

Recipe = dict[str, Any]

NUMBERS = (
    "NaN", "Infinity", "-Infinity", "-1", "0", "1", "2", "0.5", "-0.0", "1e308", "-1e308", "1e999", "1e-320", "256",
    "1e6",
    "2147483648", "9223372036854775808", "-9223372036854775809", "1" + "0" * 30,
)  # fmt: skip
VALUES = (
    *NUMBERS, "null", "true", '""', '"text"', '"1"', '"NaN"', "[]", "{}", "[1]", '{"a": 1}', r'"\ud800"', r'"\u0000"',
    '"../../x"', "@deep", "@long", "@digits", "@junk",
)  # fmt: skip
"""What a value becomes, as JSON has it; with @: made when it is used."""
LONG = {
    "@deep": "[" * 100_000 + "]" * 100_000,
    "@long": '"' + "x" * 300_000 + '"',
    "@digits": "9" * 5000,
    "@junk": "nul",
}
_SAME_KIND = {"-1", "0", "1", "2", "0.5", "-0.0", "256", "1e6", "1e-320", "2147483648", "true", '"text"', '"1"', '""'}
"""Values that may be as right as the one before: whether a reader could notice depends on the place."""
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w])")
_PLACES = ("missing", "empty", "folder", "loop", "dangling", "fifo", "zero", "null", "sparse", "random", "text")
TEXTS = (
    "",
    "x",
    "NaN",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e999",
    '"',
    ",,,,",
    "\x00",
    "\u0663",
    "\ufeff",
    "é",
    "9" * 400,
    "-",
    "1,5",
)


def _take(rng: np.random.Generator, of: Any) -> Any:
    return of[int(rng.integers(len(of)))]


def _share(rng: np.random.Generator) -> float:
    return round(float(rng.random()), 4)


def _place(share: float, size: int) -> int:
    """Turn a share of a length into an index."""
    return min(int(share * size), max(size - 1, 0))


# --- Bytes ---


def _draw_bytes(rng: np.random.Generator) -> Recipe:
    op = _take(rng, ("flip", "flip", "set", "cut", "grow", "drop", "double", "swap", "head"))
    return {"op": f"bytes.{op}", "at": _share(rng), "to": _share(rng), "n": int(2 ** rng.integers(0, 11)),
    "bit": int(rng.integers(8))} | (
        {"value": int(_take(rng, (0, 255, 10, 34, 44, 65)))} if op in ("set", "grow", "head") else {}
    )  # fmt: skip


def _bytes(path: Path, r: Recipe) -> None:
    content = bytearray(path.read_bytes())
    at, n = _place(r["at"], len(content)), r["n"]
    match r["op"].partition(".")[2]:
        case "flip":
            if content:
                content[at] ^= 1 << r["bit"]
        case "set":
            content[at : at + n] = bytes([r["value"]]) * len(content[at : at + n])
        case "head":
            content[:n] = bytes([r["value"]]) * len(content[:n])
        case "cut":
            del content[at:]
        case "grow":
            content += bytes([r["value"]]) * n
        case "drop":
            del content[at : at + n]
        case "double":
            content[at:at] = content[at : at + n]
        case "swap":
            to = _place(r["to"], len(content))
            one, other = content[at : at + n], content[to : to + n]
            same = min(len(one), len(other))
            content[at : at + same], content[to : to + same] = other[:same], one[:same]
    path.write_bytes(content)


# --- Values of JSON, in a file of its own or in the header of another ---


def _nodes(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    if path:
        yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _nodes(item, (*path, key))
    elif isinstance(value, list):
        for i, item in enumerate(value[:6]):
            yield from _nodes(item, (*path, i))


def _draw_json(rng: np.random.Generator, parts: Parts) -> Recipe:
    document = _take(rng, sorted(parts.documents))
    nodes = list(_nodes(parts.documents[document]))
    op = _take(rng, ("set", "set", "set", "set", "drop", "add", "double", "root"))
    recipe: Recipe = {"op": f"json.{op}", "document": document, "value": _take(rng, VALUES)}
    return recipe if op == "root" or not nodes else recipe | {"path": list(_take(rng, nodes))}


def _json(parts: Parts, r: Recipe) -> None:
    """Change a document; what is no JSON value stands in as a text that `text_with_raw` replaces."""
    raw = f"@raw:{LONG.get(r['value'], r['value'])}"
    if r["op"] == "json.root" or "path" not in r:
        parts.documents[r["document"]] = raw
        return
    *above, last = r["path"]
    holder = parts.documents[r["document"]]
    for key in above:
        holder = holder[key]
    match r["op"]:
        case "json.set":
            holder[last]
            holder[last] = raw
        case "json.drop":
            del holder[last]
        case "json.add":
            if isinstance(holder, dict):
                holder["surplus"] = raw
            else:
                holder.append(raw)
        case "json.double":
            if isinstance(holder, dict):
                holder[f"@twice:{last}"] = raw
            else:
                holder.append(holder[last])


# --- Arrays ---


_DTYPES = ("float16", "float64", "int8", "int64", "uint8", "complex128", "bool", "U3", "S2", ">f4")


def _draw_array(rng: np.random.Generator, parts: Parts) -> Recipe:
    op = _take(rng, ("cell", "cell", "cell", "fill", "dtype", "shape", "drop", "add", "sort"))
    recipe: Recipe = {"op": f"array.{op}", "array": _take(rng, sorted(parts.arrays)), "at": _share(rng)}
    if op == "dtype":
        return recipe | {"value": _take(rng, _DTYPES)}
    if op == "shape":
        return recipe | {
            "value": _take(rng, ("flat", "more", "less", "turned", "empty", "scalar", "doubled", "fortran"))
        }
    return recipe | {"value": _take(rng, NUMBERS)}


def _array(parts: Parts, r: Recipe) -> None:
    array, value = parts.arrays[r["array"]], r["value"]
    match r["op"]:
        case "array.cell" | "array.fill":
            with np.errstate(all="ignore"):
                array = np.array(array)
                try:
                    number = np.array(float(value)).astype(array.dtype)
                except (ValueError, TypeError):
                    number = np.zeros((), array.dtype)
            if r["op"] == "array.fill":
                array[...] = number
            elif array.size:
                array.reshape(-1)[_place(r["at"], array.size)] = number
        case "array.dtype":
            with np.errstate(all="ignore"):
                array = array.astype(value)
        case "array.shape":
            made: dict[str, Callable[[], Any]] = {
                "flat": lambda: array.reshape(-1),
                "more": lambda: array[..., None],
                "less": lambda: array[:-1] if array.ndim else array.reshape(1),
                "turned": lambda: array.T,
                "empty": lambda: array.reshape(-1)[:0],
                "scalar": lambda: array.reshape(-1)[:1].reshape(()) if array.size else array,
                "doubled": lambda: np.concatenate([array.reshape(-1)] * 2),
                "fortran": lambda: np.asfortranarray(array),
            }
            array = made[value]()
        case "array.sort":
            array = np.array(array).reshape(-1)[::-1].reshape(array.shape)
        case "array.drop":
            del parts.arrays[r["array"]]
            return
        case "array.add":
            parts.arrays["surplus"] = np.zeros(3, np.float32)
            return
    parts.arrays[r["array"]] = array


# --- Tables: Parquet ---


def _draw_table(rng: np.random.Generator, parts: Parts) -> Recipe:
    assert parts.table is not None
    op = _take(
        rng, ("cell", "cell", "cell", "cell", "null", "drop", "add", "type", "less", "more", "turned", "order", "empty")
    )
    recipe: Recipe = {"op": f"table.{op}", "column": _take(rng, parts.table.column_names), "at": _share(rng)}
    if op == "type":
        return recipe | {"value": _take(rng, ("string", "float64", "float32", "int8", "int64", "bool", "binary"))}
    return recipe | ({"value": _take(rng, (*NUMBERS, "true", '""', '"text"', "@long"))} if op == "cell" else {})


def _of_type(raw: str, kind: pa.DataType) -> Any:
    """Return a value of a column's type that is as near to `raw` as can be."""
    raw = LONG.get(raw, raw).strip('"')
    if pa.types.is_floating(kind):
        try:
            return pa.scalar(float(raw), pa.float64()).cast(kind, safe=False).as_py()
        except ValueError:
            return float("nan")
    if pa.types.is_integer(kind):
        try:
            number = int(float(raw))
        except (ValueError, OverflowError):
            number = 2**62
        bits = kind.bit_width - (0 if str(kind).startswith("u") else 1)
        return max(min(number, 2**bits - 1), 0 if str(kind).startswith("u") else -(2**bits))
    if pa.types.is_boolean(kind):
        return raw in ("1", "true")
    if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
        return [_of_type(raw, kind.value_type)]
    return raw.encode() if pa.types.is_binary(kind) else raw


def _table(parts: Parts, r: Recipe) -> None:
    assert parts.table is not None
    table, name = parts.table, r["column"]
    i = table.column_names.index(name)
    row = _place(r["at"], table.num_rows)
    match r["op"]:
        case "table.cell" | "table.null":
            values = table.column(i).to_pylist()
            kind = table.schema.field(i).type
            if values:
                values[row] = None if r["op"] == "table.null" else _of_type(r["value"], kind)
            field = table.schema.field(i).with_nullable(table.schema.field(i).nullable or r["op"] == "table.null")
            try:
                made = pa.array(values, kind)
            except (pa.ArrowInvalid, pa.ArrowTypeError):
                made = pa.array([None if k == row else v for k, v in enumerate(values)], kind)
                field = field.with_nullable(True)
            table = table.set_column(i, field, made)
        case "table.drop":
            table = table.remove_column(i)
        case "table.add":
            table = table.append_column("surplus", pa.array([1.0] * table.num_rows))
        case "table.type":
            try:
                table = table.set_column(i, name, table.column(i).cast(r["value"], safe=False))
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
                table = table.set_column(i, name, pa.nulls(table.num_rows, pa.type_for_alias(r["value"])))
        case "table.less":
            table = pa.concat_tables([table.slice(0, row), table.slice(row + 1)])
        case "table.more":
            table = pa.concat_tables([table.slice(0, row), table.slice(row, 1), table.slice(row)])
        case "table.turned":
            table = table.take(pa.array(range(table.num_rows)[::-1]))
        case "table.order":
            table = table.select(table.column_names[::-1])
        case "table.empty":
            table = table.slice(0, 0)
    parts.table = table


# --- Text: CSV, TOML, XML, SQL ---


def _draw_text(rng: np.random.Generator) -> Recipe:
    op = _take(
        rng,
        (
            "number",
            "number",
            "number",
            "line.drop",
            "line.double",
            "line.swap",
            "word",
            "insert",
            "cell",
            "cells.drop",
            "header",
        ),
    )
    return {"op": f"text.{op}", "at": _share(rng), "to": _share(rng), "value": _take(rng, TEXTS)}


def _text(path: Path, r: Recipe) -> None:
    packed = path.suffix == ".gz"
    raw = gzip.decompress(path.read_bytes()) if packed else path.read_bytes()
    text = _changed_text(raw.decode("utf-8", "replace"), r)
    content = text.encode("utf-8", "surrogatepass")
    path.write_bytes(gzip.compress(content, mtime=0) if packed else content)


def _changed_text(text: str, r: Recipe) -> str:
    op, value = r["op"].partition(".")[2], r["value"]
    lines = text.split("\n")
    at, to = _place(r["at"], len(lines)), _place(r["to"], len(lines))
    if op in ("number", "word"):
        pattern = _NUMBER if op == "number" else re.compile(r"[A-Za-z_]\w*")
        found = list(pattern.finditer(text))
        if not found:
            return text + value
        one = found[_place(r["at"], len(found))]
        return text[: one.start()] + value + text[one.end() :]
    if op == "insert":
        at = _place(r["at"], len(text))
        return text[:at] + value + text[at:]
    if op in ("cell", "header"):
        row = 0 if op == "header" else at
        cells = lines[row].split(",")
        cells[_place(r["to"], len(cells))] = value
        lines[row] = ",".join(cells)
    elif op == "cells.drop":
        lines[at] = ",".join(lines[at].split(",")[: _place(r["to"], lines[at].count(",") + 1)])
    elif op == "line.drop":
        del lines[at]
    elif op == "line.double":
        lines.insert(to, lines[at])
    elif op == "line.swap":
        lines[at], lines[to] = lines[to], lines[at]
    return "\n".join(lines)


# --- XML ---


def _draw_xml(rng: np.random.Generator) -> Recipe:
    op = _take(
        rng,
        ("attribute", "attribute", "attribute", "attribute.drop", "drop", "double", "rename", "move", "wrap", "text"),
    )
    return {
        "op": f"xml.{op}",
        "at": _share(rng),
        "to": _share(rng),
        "value": _take(rng, (*TEXTS, "$x", "${1/0}", "INF", "true", "1970")),
    }


def _xml(path: Path, r: Recipe) -> None:
    root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    elements = list(root.iter())
    parent = {child: above for above in elements for child in above}
    one, other = elements[_place(r["at"], len(elements))], elements[_place(r["to"], len(elements))]
    op, value = r["op"].partition(".")[2], "".join(c for c in r["value"] if c != "\x00")
    if op.startswith("attribute"):
        holders = [e for e in elements if e.attrib]
        one = holders[_place(r["at"], len(holders))]
        name = list(one.attrib)[_place(r["to"], len(one.attrib))]
        if op == "attribute":
            one.set(name, value)
        else:
            del one.attrib[name]
    elif op == "rename":
        one.tag = "Other"
    elif op == "text":
        one.text = value
    elif op == "wrap":
        for _ in range(300):
            one = ElementTree.SubElement(one, one.tag)
    elif one in parent:
        if op == "double":
            parent[one].append(one)
        else:
            parent[one].remove(one)
            if op == "move" and other not in list(one.iter()):
                other.append(one)
    path.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")


# --- Members of a zip, and what stands in the place of the file ---


def _draw_zip(rng: np.random.Generator, path: Path) -> Recipe:
    with zipfile.ZipFile(path) as file:
        member = _take(rng, sorted(file.namelist()))
    return {"op": f"zip.{_take(rng, ('drop', 'empty', 'junk', 'text', 'double', 'up'))}", "member": member}


def _zip(path: Path, r: Recipe) -> None:
    with zipfile.ZipFile(path) as file:
        members = [(name, file.read(name)) for name in file.namelist()]
    op = r["op"].partition(".")[2]
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members:
            if name != r["member"]:
                file.writestr(name, content)
            elif op != "drop":
                made = {"empty": b"", "junk": bytes(range(256)), "text": b'{"a": [1, 2'}.get(op, content)
                file.writestr(f"../{name}" if op == "up" else name, made)


def _stand_in(path: Path, what: str) -> None:
    """Put something else in the place of a file or folder."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()
    match what:
        case "empty":
            path.write_bytes(b"")
        case "folder":
            path.mkdir()
        case "loop":
            path.symlink_to(path.name)
        case "dangling":
            path.symlink_to("nowhere")
        case "fifo":
            os.mkfifo(path)
        case "zero" | "null" | "random":
            path.symlink_to(f"/dev/{'urandom' if what == 'random' else what}")
        case "sparse":
            with path.open("wb") as file:
                file.truncate(2**38)
        case "text":
            path.write_text("no such thing\n", encoding="utf-8")


# --- All of them ---

_TEXTUAL = {".csv", ".toml", ".xosc", ".xml", ".xodr", ".gz", ".py", ".sql"}
_XML = {".xosc", ".xml", ".xodr"}


def drawn(rng: np.random.Generator, path: Path, name: str) -> Recipe:
    """Draw damage for a file.

    Args:
        rng: Where from.
        path: The undamaged file.
        name: Its place in the folder of the input.
    """
    if path.is_dir():
        return {"file": name, "op": f"place.{_take(rng, _PLACES)}"}
    kinds = ["bytes"] * 2 + ["place"] * (rng.random() < 0.25)
    if path.suffix in _TEXTUAL:
        kinds += ["text"] * 5
    if path.suffix in _XML:
        kinds += ["xml"] * 8
    if path.suffix == ".zip":
        kinds += ["zip"] * 2
    parts = parts_of(path)
    kinds += (
        ["json"] * 6 * bool(parts.documents)
        + ["array"] * 4 * bool(parts.arrays)
        + ["table"] * 8 * (parts.table is not None)
    )
    match _take(rng, kinds):
        case "bytes":
            recipe = _draw_bytes(rng)
        case "place":
            recipe = {"op": f"place.{_take(rng, _PLACES)}"}
        case "text":
            recipe = _draw_text(rng)
        case "xml":
            recipe = _draw_xml(rng)
        case "zip":
            recipe = _draw_zip(rng, path)
        case "json":
            recipe = _draw_json(rng, parts) | _checked(parts)
        case "array":
            recipe = _draw_array(rng, parts) | _checked(parts)
        case _:
            recipe = _draw_table(rng, parts) | _checked(parts)
    return {"file": name} | recipe


def _checked(parts: Parts) -> Recipe:
    """Say that the file carries checksums, which do not fit the damage: any change can be noticed."""
    return {"checked": True} if parts.has_checksums else {}


def done(folder: Path, recipe: Recipe) -> None:
    """Make damage.

    Args:
        folder: That of the input; a copy of the seed's.
        recipe: As `drawn` gave it.

    Raises:
        LookupError: The recipe fits the file no more: it names what is not there.
    """
    path = folder / recipe["file"]
    op = recipe["op"].partition(".")[0]
    plain: dict[str, Callable[[Path, Recipe], None]] = {"bytes": _bytes, "text": _text, "xml": _xml, "zip": _zip}
    if op == "place":
        _stand_in(path, recipe["op"].partition(".")[2])
    elif op in plain:
        plain[op](path, recipe)
    else:
        parts = parts_of(path).copied()
        {"json": _json, "array": _array, "table": _table}[op](parts, recipe)
        write_parts(path, parts)


def could_notice(recipe: Recipe) -> bool:
    """Tell whether a reader that looks at all it reads must notice: the damaged file cannot be meant as it is.

    Not so, in a file without checksums: a number that became another one that may be as right, values in another order,
    a row left out, a byte of free text. Nor the order of a table's columns, which is no content.
    """
    op, value = recipe["op"], recipe.get("value")
    if op == "table.order":
        return False
    if recipe.get("checked"):
        return True
    if op in ("json.set", "array.cell", "array.fill", "table.cell"):
        return value not in _SAME_KIND
    if op in ("array.sort", "table.turned") or value == "fortran":
        return False
    return op.startswith(("json.", "array.", "place.", "table.", "zip."))
