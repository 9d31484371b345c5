"""`migrate` writes a library of an earlier version anew, as the present version writes it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa

from cornerforge._arguments import checked
from cornerforge._arrow import arrow_field
from cornerforge._files import reason, writing
from cornerforge._locks import claims
from cornerforge.errors import FileFormatError, OutputError
from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.output import provenance, write_json
from cornerforge.fields import BODY, CASES, TRACKS
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.schema import EXTRA_TYPES, ON_RAILS, RAILS_TRACKS, SCRIPTED, SCRIPTED_TRACKS, arrow_schema
from cornerforge.library.shards import encode_tables
from cornerforge.ndd.model import load_model, save_model
from cornerforge.results.whole import Migrated
from cornerforge.types import CAR, Odd

__all__ = ["migrate"]


@checked
@claims()
def migrate(library: Path | str, *, out: Path | str, progress: Progress = NO_PROGRESS) -> Migrated:
    """Write a library of an earlier version anew, with the present columns and checksums; the old one stays as it is.

    What the earlier version did not record is filled in as its readers take it: vehicles are cars of the ODD's size.
    The cases themselves are those of the version that drove them, and the new library says which that was.

    Args:
        library: The library.
        out: A new folder.
        progress: Is told how many cases are done.

    Raises:
        FileFormatError: It is no library, or a shard of it is damaged: nothing is left out silently.
        OutputError: `out` is there already, or cannot be written.
    """
    old = CaseLibrary.open(library)
    place = Path(out)
    damaged = old.verify()
    if damaged:
        raise FileFormatError(f"{old.path} is damaged: {damaged[0]}; restore it from a copy.")
    new = CaseLibrary.create(place, old.identity, old.odd)
    made_by = str(old.identity.get("cornerforge", "an earlier version"))
    try:
        _fill(old, new, progress)
        for file in sorted(old.path.glob("*")):
            _copy_beside(file, place)
        told = {**provenance(old.identity), "migrated_from": str(old.path), "made_by": made_by}
        write_json(place / "provenance.json", told)
    except BaseException:  # Ctrl-C too: the old one is still there
        shutil.rmtree(place, ignore_errors=True)
        raise
    return Migrated(library=str(place), cases=len(new), made_by=made_by)


def _fill(old: CaseLibrary, new: CaseLibrary, progress: Progress) -> None:
    """Write all cases of a library into another."""
    names = {str(kind): name for name, kind in EXTRA_TYPES.items()}
    own = [name for name in old.extra if name not in {column.name for column in CASES}]
    kinds = RAILS_TRACKS if old.identity.get(ON_RAILS) else SCRIPTED_TRACKS if old.identity.get(SCRIPTED) else TRACKS
    for cases, tracks in old.shards():
        progress("migrate", len(new), len(old))
        extra = {name: names[str(cases.schema.field(name).type)] for name in own}
        table = _as_now(cases, arrow_schema(CASES, extra)), _as_now(_with_bodies(tracks, old.odd), arrow_schema(kinds))
        last = int(cases.column("test").to_numpy()[-1]) + 1
        crashes = len(new) + cases.num_rows
        new.append_shard(encode_tables(*table, extra), next_test=last, tests=max(last, crashes), crashes=crashes)
    new.append([], next_test=old.next_test, tests=old.tests, crashes=old.crashes)
    if old.finished:
        new.finish()
    progress("migrate", len(new), len(old))


def _as_now(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """Give the columns of a schema, in its order."""
    return table.select(schema.names).cast(schema).combine_chunks()


def _with_bodies(tracks: pa.Table, odd: Odd) -> pa.Table:
    """Add class, size and time of lane changes of vehicles, where an early library lacks them."""
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


def _copy_beside(file: Path, place: Path) -> None:
    """Write the model anew, with checksums, and copy policies and what was printed."""
    if file.name == MODEL_FILE:
        save_model(load_model(file), place / MODEL_FILE)
    elif file.suffix == ".safetensors":
        try:
            with writing(place / file.name) as part:
                shutil.copyfile(file, part)
        except OSError as error:
            raise OutputError(f"Cannot copy {file}: {reason(error)}.") from error
