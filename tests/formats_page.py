# ruff: noqa: E501  (rows of tables)
"""The page docs/formats.md: every file that cornerforge writes and reads again, from the types and lists that readers check."""

from __future__ import annotations

from collections.abc import Iterable
from math import inf
from typing import Any, get_type_hints

import msgspec
from library_relations import RELATIONS

from cornerforge._schema import unit_of
from cornerforge.adversary.checkpoint import CHECKPOINT_SCHEMA, CheckpointHeader
from cornerforge.experiment.av_file import AV_FILE_SCHEMA, AvHeader
from cornerforge.experiment.policy_file import POLICY_SCHEMA, PolicyHeader
from cornerforge.ext.studies.model_draws import Draw
from cornerforge.fields import Field
from cornerforge.library.manifest import Manifest, Shard, StoredFile
from cornerforge.library.schema import SCHEMA_VERSION, RunIdentity
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import SCHEMA_VERSION as MODEL_SCHEMA
from cornerforge.ndd.model import SLOW, TABLES, InitialState, NddModel
from cornerforge.rates.monte_carlo import MonteCarlo

__all__ = ["formats_markdown"]


def _table(rows: Iterable[Field], key: str = "key") -> list[str]:
    lines = [f"| {key} | type | unit | allowed | meaning |", "| --- | --- | --- | --- | --- |"]
    return [*lines, *(f"| `{r.name}` | {r.type} | {r.unit} | {r.allowed} | {r.meaning} |" for r in rows), ""]


def _keys(kind: type) -> list[str]:
    """Keys of an object, from the type that checks them."""
    whole = msgspec.json.schema(kind)["$defs"][kind.__name__]
    lines = ["| key | type | unit | allowed | meaning |", "| --- | --- | --- | --- | --- |"]
    for name, one in whole["properties"].items():
        kinds = one.get("anyOf", [one])
        about = one if "description" in one else kinds[0]
        words = " or ".join(map(_in_words, kinds)) + ("" if name in whole["required"] else ", may be missing")
        low, high = kinds[0].get("minimum", -inf), kinds[0].get("maximum", inf)
        allowed = Field("", "", "", "", (low, high)).allowed
        lines.append(f"| `{name}` | {words} | {about.get('unit', '')} | {allowed} | {about['description']} |")
    return [*lines, ""]


def _in_words(kind: dict[str, Any]) -> str:
    if "pattern" in kind:
        return "hex"
    if kind.get("type") == "array":
        return f"list of {_in_words(kind['items'])}"
    return "object" if "$ref" in kind or "allOf" in kind else str(kind["type"])


def _numbers(kind: type) -> list[str]:
    """Numbers of a part of a model, from the types that its reader checks."""
    lines = ["| number | unit | allowed |", "| --- | --- | --- |"]
    for name, declared in get_type_hints(kind, include_extras=True).items():
        for said in getattr(declared, "__metadata__", ()):
            lines.append(f"| `{name}` | {unit_of(said)} | {said.ge:g} to {said.le:g} |")
    return [*lines, ""]


def formats_markdown() -> str:
    """Write the page."""
    relations = [f"- `{one.column}`: {one.must}." for one in RELATIONS]
    return "\n".join([_BEGIN, *_LIBRARY, *relations, "", *_MODEL, *_WEIGHTS, *_RUN, *_VERSIONS, ""])


_BEGIN = """# Formats of files

What cornerforge writes and reads again. The tables are made from the types and lists that its readers check (`make golden`), so a
value outside a range here is refused: one line says the file, the field, what it is and what it must be.

## What holds for all files

- A file is whole or absent: it is written under another name (`.NAME.part`) and renamed.
- **Checksums.** A JSON object holds the SHA-256 of its other keys under `sha256` (of the object as JSON with sorted keys
  and without spaces, so it may be formatted anew). A `.npz` holds one of each array under `checksums`. A safetensors file
  holds one of its header and weights in its metadata. A Parquet file holds CRC-32 of each column and each row in its
  metadata, so that a changed cell is named; a library's manifest holds the SHA-256 of each shard besides.
- Reading compares them. `cornerforge verify PATH` reads everything at a place.
- A checksum tells of damage and of edits by hand. It is no signature: see [SECURITY.md](../SECURITY.md).
- Files of version 0.1 carry none; they are refused with the line that brings them to the present form
  (`cornerforge migrate OLD --out NEW`).
- Numbers are little-endian, texts UTF-8; `hex` is 1 to 64 hexadecimal digits. No file holds pickles or code.
- Pages, pictures, films, logs and what `export` writes are not read again and have no checksums here. Case files have
  [a schema of their own](interchange.md), since people write them.
"""

_LIBRARY = [
    f"""## A library (folder; schema 1 to {SCHEMA_VERSION})

`manifest.json`, and for each shard `cases-NNNNNN.parquet` and `tracks-NNNNNN.parquet`
([their columns](library-columns.md)). Replacing the manifest commits a shard; a file that it does not list is left over
from a kill. `cases-NNNNNN-growing.parquet` is the last shard while it grows. Beside them lie `provenance.json`, the
model (`model.npz`) and the policies that drove.

### manifest.json
""",
    *_keys(Manifest), "Besides `format`, always `cornerforge case library`; `schema_version`, the lowest that can read it; `sha256`, of the other keys.", "",
    "Of `run`, where cases are driven by cornerforge (other keys may be there):", "", *_keys(RunIdentity),
    "Of each shard:", "", *_keys(Shard), "Of each file:", "", *_keys(StoredFile),
    "### What holds between values",
    "",
    "cornerforge writes every row so, and its tests look; a reader does not look again.",
    "",
]  # fmt: skip

_MODEL = [
    f"""## A model (`.npz`; schema 1 to {MODEL_SCHEMA})

Arrays, and `header`, JSON as text with `schema_version`, the numbers below, `provenance` (free text and numbers), and
the objects `memory` and `initial`. What the numbers mean stands at `NddModel`, `Memory` and `InitialState`
([design](design.md)). A model whose initial traffic can hardly be drawn is refused, too.
""",
    *_table((*TABLES, SLOW), "array"), "Numbers of the header:", "", *_numbers(NddModel), "Of `memory`:", "", *_numbers(Memory),
    "`near` + `far` + `habit` are at most 1. Of `initial`:", "", *_numbers(InitialState),
    "Each `..._low` is at most its `..._high`.", "",
]  # fmt: skip

_WEIGHTS = [
    f"""## A policy (`.safetensors`; schema {POLICY_SCHEMA})

The array `weights` (float32: all layers one after the other, as at `drivers.policy.PolicyNumbers`, finite, as many as
the network has), and the header `cornerforge` in the metadata:
""",
    *_keys(PolicyHeader),
    f"""## A learned AV (`.safetensors`; schema {AV_FILE_SCHEMA})

The array `weights`, and the header `cornerforge_av`:
""",
    *_keys(AvHeader),
    f"""## An unfinished training (`.checkpoint`, a safetensors file; schema {CHECKPOINT_SCHEMA})

It lies beside the policy, and goes when the training ends. Its header `cornerforge_checkpoint`:
""",
    *_keys(CheckpointHeader),
]  # fmt: skip

_RUN = [
    """## Folders of commands

| folder of | holds |
| --- | --- |
| all | `provenance.json`: version, command, `identity` (what decides the result), time, machine |
| `run` | `summary.json`, `stages/NAME.json` (results of finished stages, [as commands print them](results-json.md)), `exposure.json`, `training.json`, `policy.safetensors`, `library/`, `analysis/`, `natural/`, `report.html` |
| `rate` | `rate.json`, and so that it can go on: `counts.json` (counted), or `taught.npz` and `trees/NNNNNN.npz` (trees: arrays of each block), `draws/` (other models), and a library of the crashes |
| `analyse` | `analysis.json`, `points.parquet`, `cases.parquet` ([columns](case-columns.md)), `witnesses.parquet` |
| `reproduce` | `items.json`, `inputs/` |
| `report --evidence` | `evidence.html`, `evidence.json` beside the page |
| `suite run`, `r157` | `suite.json`, `scenarios.csv`, `library/` of the failures, the page |
| `ndd validate`, `ndd fit` | `validation.json`; the model and a report |

### counts.json
""",
    *(line.replace(", may be missing", "") for line in _keys(MonteCarlo)), "### A file of draws/", "", *_keys(Draw),
]  # fmt: skip

_VERSIONS = [
    """## Versions, and how older files are read

| file | version | what a reader does |
| --- | --- | --- |
| library | 1 | Reads it. Cases are tests of a seed. |
| | 2 | Reads it: cases may be scripted, their start and actions are in their tracks. |
| | 3 | Reads it: other vehicles may be on rails. A library has the lowest version that can read it. |
| model | 2 | Reads it; numbers that it does not say mean what they meant then. |
| policy | 1, 2 | Reads them; one for another observation is refused: train it again. |
| learned AV | 1 | Reads it; the same. |
| unfinished training | 6 | Earlier ones are refused: go on with the version that began it, or begin again. |
| any | later | Refused: upgrade cornerforge. |

What version 0.1 wrote is refused in one line that names `cornerforge migrate OLD --out NEW`. Nothing is rewritten in
place: `migrate` writes a library, the folder of a run, or one file anew, with the present columns and checksums, and
leaves the old one as it is. What the earlier version did not record is filled in:

| lacking | becomes |
| --- | --- |
| class and size of vehicles | cars of the ODD |
| times of lane changes | the ODD's |
| `shortfall_nats` and what belongs to it | null |
| traits of drivers in starts | medians; each desires the speed that it has |
| memory and traits of drivers in models of schema 1 | none; who would certainly refuse a gap turns back |
| checksums | those of the content as it is |

Tables of an analysis that lack columns are made again by `analyse`. The numbers of an early library are those of its
version's simulator: `replay --check` says whether the present one drives them to the same bit.
""",
]
