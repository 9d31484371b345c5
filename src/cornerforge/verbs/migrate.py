"""`migrate` writes files of an earlier version anew, as the present version writes them; no other reader takes them."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from safetensors import SafetensorError, safe_open

from cornerforge._arrow import arrow_field
from cornerforge._checksums import KEY, read_arrays, read_tensors, write_arrays, write_tensors
from cornerforge._files import check_regular, read_bytes, reason, writing
from cornerforge._locks import claim_file, claim_folder, is_lock
from cornerforge._options import verb
from cornerforge._schema import parse
from cornerforge._table_checks import TableChecks, write_parquet
from cornerforge._values import table_fault
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.experiment.output import provenance, write_json
from cornerforge.fields import BODY, CASES, PARTNER, SHORTFALL, Field
from cornerforge.library import CaseLibrary
from cornerforge.library.manifest import MANIFEST, StoredFile, is_leftover, read_manifest
from cornerforge.library.schema import arrow_schema, tracks_fields
from cornerforge.library.shards import ShardReader, encode_tables
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import OLD_SCHEMA, SCHEMA_VERSION, load_model
from cornerforge.results.whole import Migrated
from cornerforge.sim import scripted
from cornerforge.types import CAR, Odd
from cornerforge.verbs.options.cases import Migrate
from cornerforge.work.progress import Progress

__all__ = ["migrate"]


@verb(Migrate)
def migrate(options: Migrate) -> Migrated:
    """Write files of an earlier version anew, with the present columns and checksums; the old ones stay as they are.

    What the earlier version did not record is filled in: vehicles are cars of the ODD's size. The cases themselves are
    those of the version that drove them, and a new library says which that was. Files of other programs, pages and
    logs are copied.

    Raises:
        InputError: There is nothing at `library`, `out` lies in it, or a link does, which may lead out of it.
        FileFormatError: Something is damaged: nothing is left out silently.
        OutputError: `out` is there already, or cannot be written.
    """
    old, new = Path(options.library), Path(options.out)
    if not old.exists():
        raise InputError(f"There is nothing at {old}; name a library, the folder of a run, or a file.")
    if old.resolve() in new.resolve().parents:
        raise InputError(f"{new} lies in {old}, which would be copied into itself; choose a place beside it.")
    if os.path.lexists(new) and not (new.is_dir() and all(is_lock(entry.name) for entry in new.iterdir())):
        raise OutputError(f"{new} is there already; choose a new place.")
    if link := next((one for one in old.rglob("*") if one.is_symlink()), None):
        raise InputError(f"{link} is a link, and within a folder none is followed; put there what it leads to.")
    (claim_folder if old.is_dir() else claim_file)(new)  # before anything of it could be removed
    try:
        cases, made_by = _bring(old, new, options.progress)
    except BaseException:  # Ctrl-C too: the old one is still there
        shutil.rmtree(new, ignore_errors=True)
        with suppress(OSError):
            new.unlink()
        raise
    options.progress("migrate", cases, cases)
    return Migrated(library=str(new), cases=cases, made_by=made_by or "an earlier version")


def _bring(old: Path, new: Path, progress: Progress) -> tuple[int, str]:
    """Write a file, a library or a folder anew; return its cases, and which version drove those of the last library."""
    if not old.is_dir():
        _file(old, new)
        return 0, ""
    if (old / MANIFEST).is_file():
        return _library(old, new, progress)
    cases, made_by = 0, ""
    for entry in sorted(old.iterdir()):
        if not is_lock(entry.name):
            more, driven_by = _bring(entry, new / entry.name, progress)
            cases, made_by = cases + more, driven_by or made_by
    return cases, made_by


def _library(old: Path, new: Path, progress: Progress) -> tuple[int, str]:
    """Write all cases of a library into another, and what lies beside them."""
    manifest, _ = read_manifest(old, old=True)
    library = CaseLibrary.create(new, manifest.run, manifest.odd)
    own = {name: kind for name, kind in (manifest.extra or {}).items() if name not in {one.name for one in CASES}}
    motion = tracks_fields(manifest.run)
    reader, total = ShardReader(old, manifest), sum(shard.cases for shard in manifest.shards)
    for shard in manifest.shards:
        progress("migrate", len(library), total)
        cases, tracks = (_table(old, reader, stored) for stored in (shard.cases_file, shard.tracks_file))
        cases = _as_now(_with_shortfall(_with_partner(cases, manifest.odd)), CASES, own, old / shard.cases_file.name)
        tracks = _with_starts(_with_bodies(tracks, manifest.odd), manifest.odd)
        tracks = _as_now(tracks, motion, {}, old / shard.tracks_file.name)
        crashes, end = len(library) + shard.cases, shard.last_test + 1
        encoded = encode_tables(cases, tracks)
        library.append_shard(encoded, next_test=end, tests=max(end, crashes), crashes=crashes)
    library.append_shard(None, next_test=manifest.next_test, tests=manifest.tests, crashes=manifest.crashes)
    if manifest.finished:
        library.finish()
    listed = {MANIFEST, *(file.name for shard in manifest.shards for file in (shard.cases_file, shard.tracks_file))}
    for entry in sorted(old.iterdir()):
        if entry.is_file() and not (entry.name in listed or is_leftover(entry.name, manifest) or is_lock(entry.name)):
            _file(entry, new / entry.name)
    made_by = str(manifest.run.get("cornerforge", manifest.created_by))
    write_json(new / "provenance.json", {**provenance(manifest.run), "migrated_from": str(old), "made_by": made_by})
    return total, made_by


def _table(folder: Path, reader: ShardReader, stored: StoredFile) -> pa.Table:
    """Read a file of a shard, which may carry no checksums besides the one of the manifest.

    Raises:
        FileFormatError: It is damaged.
    """
    content = reader.read(stored)
    if content is None:
        fault = reader.damaged[stored.name]
        raise FileFormatError(f"{folder} is damaged: {stored.name} {fault}; restore it from a copy.")
    return pq.read_table(pa.BufferReader(content))


def _as_now(table: pa.Table, fields: Sequence[Field], own: dict[str, str], file: Path) -> pa.Table:
    """Give the columns of the present form, in its order.

    Raises:
        FileFormatError: One is missing, or a value is out of its range.
    """
    schema = arrow_schema(tuple(fields), own)
    try:
        table = table.select(schema.names).cast(schema).combine_chunks()
    except (KeyError, ValueError, pa.ArrowException) as error:
        raise FileFormatError(f"{file} is no table of cases ({error}); restore it from a copy.") from None
    if (fault := table_fault(table, fields)) is not None:
        raise FileFormatError(f"{file}: {fault}; restore it from a copy, or generate it again.")
    return table


def _with_partner(cases: pa.Table, odd: Odd) -> pa.Table:
    """Say that the crash partners were cars of the ODD's size, where that is not said."""
    for field, of_car in zip(PARTNER, (CAR, odd.vehicle_length, odd.vehicle_width), strict=True):
        if field.name in cases.column_names:
            place = cases.column_names.index(field.name)
            cases = cases.set_column(place, arrow_field(field), cases.column(place).fill_null(of_car))
        else:
            values = pa.array([of_car] * cases.num_rows, arrow_field(field).type)
            cases = cases.append_column(arrow_field(field), values)
    return cases


def _with_shortfall(cases: pa.Table) -> pa.Table:
    """Add the columns `SHORTFALL` where one is lacking; null where it is not known.

    The `shortfall_nats` of then, if any, is that of the possible actions, even where another was impossible.
    """
    if all(field.name in cases.column_names for field in SHORTFALL):
        return cases
    whole, possible, count, excess = SHORTFALL
    unknown = pa.nulls(cases.num_rows, pa.float64())
    known = cases.column(whole.name).combine_chunks() if whole.name in cases.column_names else unknown
    n = cases.column(count.name) if count.name in cases.column_names else pa.nulls(cases.num_rows, pa.int64())
    truth = pc.if_else(pc.greater(n, 0), pa.scalar(math.inf), known)
    cases = cases.drop_columns([field.name for field in SHORTFALL if field.name in cases.column_names])
    for field, values in ((whole, truth), (possible, known), (count, n), (excess, unknown)):
        cases = cases.append_column(arrow_field(field), values)
    return cases


def _with_bodies(tracks: pa.Table, odd: Odd) -> pa.Table:
    """Add class, size and time of lane changes of vehicles, where they are lacking: cars of the ODD."""
    of_car = {
        "kind": CAR, "length": odd.vehicle_length, "width": odd.vehicle_width, "change_time": odd.lane_change_duration,
    }  # fmt: skip
    sizes = [len(slots) for slots in tracks.column("slot").to_pylist()]
    for body in BODY:
        field = arrow_field(body.column)
        if field.name not in tracks.column_names:
            kind = pa.list_(field.type)
            values = pa.array([np.full(size, of_car[body.name]) for size in sizes], kind)
            tracks = tracks.append_column(pa.field(field.name, kind), values)
    return tracks


def _with_starts(tracks: pa.Table, odd: Odd) -> pa.Table:
    """Fill starts that end before fields that came later with what is known of the vehicles and their drivers."""
    if "start" not in tracks.column_names:
        return tracks
    starts = []
    for row in range(tracks.num_rows):
        bodies = {one.name: np.array(tracks.column(one.column.name)[row].as_py(), np.float64) for one in BODY}
        fields = np.array(tracks.column("start")[row].as_py(), np.float64).reshape(len(bodies["kind"]), -1)
        traits = scripted.average_traits(fields[:, scripted.START_FIELDS.index("speed")], odd.lane_change_duration)
        later = dict(zip(scripted.TRAITS, traits.T, strict=True)) | bodies
        missing = [later[name] for name in scripted.START_FIELDS[fields.shape[1] :]]
        starts.append(np.column_stack([fields, *missing]).ravel())
    place = tracks.column_names.index("start")
    return tracks.set_column(place, "start", pa.array(starts, pa.list_(pa.float64())))


def _file(old: Path, new: Path) -> None:
    """Write a file anew if it is one of ours without checksums, or a model of an earlier form; else copy it.

    Raises:
        FileFormatError: It is damaged.
        OutputError: It cannot be written.
    """
    try:
        check_regular(old)
        if {
            ".json": _json,
            ".parquet": _parquet,
            ".npz": _arrays,
            ".safetensors": _tensors,
            ".checkpoint": _tensors,
        }.get(old.suffix, _other)(old, new):
            return
        with writing(new) as part:
            shutil.copyfile(old, part)
    except OSError as error:
        raise OutputError(f"Cannot copy {old}: {reason(error)}.") from error
    except (ValueError, KeyError, TypeError, pa.ArrowException, SafetensorError) as error:
        raise FileFormatError(f"{old} is damaged ({error}); restore it from a copy, or make it again.") from error


def _other(_: Path, __: Path) -> bool:
    return False


def _json(old: Path, new: Path) -> bool:
    """Add the checksum to an object; not to one that names its format: a case file, which people write."""
    content = parse(read_bytes(old).decode())
    if not isinstance(content, dict) or KEY in content or "format" in content:
        return False
    write_json(new, content)
    return True


def _parquet(old: Path, new: Path) -> bool:
    table = pq.read_table(pa.BufferReader(read_bytes(old)))
    if TableChecks.of(table.schema) is not None:
        return False
    write_parquet(new, table)
    return True


def _tensors(old: Path, new: Path) -> bool:
    with safe_open(old, framework="numpy") as file:
        key = next((key for key in file.metadata() or {} if key.startswith("cornerforge")), None)
    if key is None:
        return False
    write_tensors(new, key, *read_tensors(old, key, "file of weights", old=True), "the file of weights")
    return True


def _arrays(old: Path, new: Path) -> bool:
    """Write arrays with checksums, those of a model in the present form."""
    arrays: dict[str, Any] = read_arrays(old, "file", old=True)
    header = parse(str(arrays["header"]), finite=False) if "header" in arrays else {}
    if header.get("schema_version") == OLD_SCHEMA:
        # Drivers had no memory, and who would certainly refuse the gap turned back.
        refused = np.minimum(arrays["lc_accept_lead"], arrays["lc_accept_rear"]) == 0.0
        arrays["lc_turn_back"] = refused.astype(np.float32)
        said = {"free_pull": 0.0, "lc_desire_free": 0.0, "overlook": 0.0, "overlook_conflict": 0.0} | header
        header = {**said, "memory": asdict(Memory()) | header.get("memory", {}), "schema_version": SCHEMA_VERSION}
        arrays["header"] = np.array(json.dumps(header, sort_keys=True, indent=1))
    write_arrays(new, arrays, "the file")
    if header:
        load_model(new)
    return True
