"""The case library: an append-only folder of Parquet shards that a kill at any moment leaves usable."""

from __future__ import annotations

import importlib.metadata
import warnings
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge._extensions import extension
from cornerforge._files import reason
from cornerforge._locks import claim_folder, claims, is_lock
from cornerforge._words import shown
from cornerforge.errors import FileFormatError, InputError, OutputError, UnknownCaseError, UnknownNameError
from cornerforge.fields import CASES, HISTORY_SHAPE
from cornerforge.library.manifest import (
    MANIFEST,
    Identity,
    Manifest,
    Shard,
    check_identity,
    first_difference,
    is_leftover,
    read_manifest,
    replace_file,
    shard_names,
    write_manifest,
)
from cornerforge.library.query import MEGABYTES, SECONDS, run_sql
from cornerforge.library.schema import AV_SIZES, arrow_schema, tracks_fields
from cornerforge.library.shards import (
    DamagedShardWarning,
    EncodedShard,
    ShardReader,
    encode_tables,
    write_shard,
)
from cornerforge.library.tables import restore, script_of
from cornerforge.results.html import html_of, html_table
from cornerforge.sim import Script
from cornerforge.types import Odd, Scenario

__all__ = ["CaseLibrary", "StoredCase"]

_READERS = 4
"""Files of cases that are read at the same time."""


@dataclass(frozen=True, repr=False)
class StoredCase:
    """One case as stored; a notebook plays it.

    Attributes:
        scenario: The vehicles that were stored; values have float32 precision.
        scalars: Column name to value, without the history; see `schema.CASES`.
        history: Shape (16, 2, 4); see `CaseLibrary.history`.
        script: Start and actions of its replay; None where they are drawn from the seed.
    """

    scenario: Scenario
    scalars: dict[str, Any]
    history: NDArray[np.float64]
    script: Script | None = None

    def __repr__(self) -> str:
        return f"<case {self.scalars['case_id']}: crash after {self.scalars['crash_time_s']:.1f} s>"

    def _repr_html_(self) -> str:
        html: str = extension("players").player(self.scalars["case_id"], self.scenario)
        return html


class CaseLibrary:
    """Corner cases of one run, in a folder.

    Make one with `create`, `resume` (both write) or `open` (reads only). A reader sees it as it was when opened.
    """

    def __init__(self, path: Path, manifest: Manifest, committed: bytes | None) -> None:
        self._path = path
        self._manifest = manifest
        self._committed = committed  # the manifest's bytes, to notice a second writer; None: read only
        self._reader = ShardReader(path, manifest)

    def _repr_html_(self) -> str:
        told = {"folder": str(self.path)} | {name: self.identity.get(name) for name in ("av", "bv", "odd", "seed")}
        told |= {"tests": self.tests, "crashes": self.crashes, "cases": len(self)}
        return html_table(
            ("", "value"), ((name, html_of(value)) for name, value in told.items()), "A library of cases."
        )

    @classmethod
    def create(cls, path: Path | str, identity: Identity, odd: Odd) -> CaseLibrary:
        """Start a library in a new or empty folder.

        Args:
            path: The folder; parents are made.
            identity: Flat JSON that names the run, with the whole number `seed`: hashes of model, policy, AV and so on.
            odd: Road and rules of all cases.

        Raises:
            OutputError: The folder cannot be made, holds something, or another call writes there.
            InputError: It holds the library of another run, or the identity is not flat JSON.
        """
        folder = Path(path)
        with _claimed(folder):
            if _holds_library(folder, identity, odd):
                raise OutputError(
                    f"{folder} holds a library of this run already; what has --resume can go on with it, else remove "
                    "it or choose another place."
                )
            return cls._start(folder, identity, odd)

    @classmethod
    def resume(cls, path: Path | str, identity: Identity, odd: Odd) -> CaseLibrary:
        """Continue a library of the same run after its last commit, or start it if it does not exist yet.

        Files that a killed run left are removed. The next test to drive is `next_test`.

        Raises:
            OutputError: The folder cannot be written, holds something else, or another call writes there.
            InputError: It holds the library of another run; the message names the first difference.
            FileFormatError: Its manifest is damaged or of another schema.
        """
        folder = Path(path)
        with _claimed(folder):
            if not _holds_library(folder, identity, odd):
                return cls._start(folder, identity, odd)
            manifest, committed = read_manifest(folder)
            try:
                for entry in folder.iterdir():
                    if is_leftover(entry.name, manifest):
                        entry.unlink()
            except OSError as error:
                raise OutputError(f"Cannot tidy {folder}: {error.strerror}; make it writable.") from error
        library = cls(folder, manifest, committed)
        library._reader.check_sizes(manifest.shards)
        return library

    @classmethod
    def open(cls, path: Path | str) -> CaseLibrary:
        """Open a library for reading.

        Warns with `DamagedShardWarning` of shards that are missing or truncated.

        Raises:
            FileFormatError: There is no library, or it is damaged or of another schema.
        """
        manifest, _ = read_manifest(Path(path))
        library = cls(Path(path), manifest, None)
        library._reader.check_sizes(manifest.shards)
        return library

    @classmethod
    def _start(cls, folder: Path, identity: Identity, odd: Odd) -> CaseLibrary:
        manifest = Manifest(
            importlib.metadata.version("cornerforge"), check_identity(identity), odd, extra=None, shards=(),
            next_test=0, tests=0, crashes=0, finished=False,
        )  # fmt: skip
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"Cannot make the folder {folder}: {error.strerror}; choose another place.") from error
        return cls(folder, manifest, write_manifest(folder, manifest))

    @property
    def path(self) -> Path:
        """The folder."""
        return self._path

    @property
    def identity(self) -> dict[str, str | int | float | bool | None]:
        """Identity of the run: flat JSON with its seed and hashes."""
        return dict(self._manifest.run)

    @property
    def odd(self) -> Odd:
        """Road and rules of all cases."""
        return self._manifest.odd

    @property
    def extra(self) -> tuple[str, ...]:
        """Names of the caller's own columns."""
        return tuple(self._manifest.extra or ())

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns that `scalars` can read, the history too."""
        return tuple(arrow_schema(CASES, self._manifest.extra).names)

    @property
    def scripted(self) -> bool:
        """Whether its cases are scripted, not tests of a seed."""
        return self._manifest.scripted

    @property
    def on_rails(self) -> bool:
        """Whether the other vehicles of its cases are on rails."""
        return self._manifest.on_rails

    @property
    def next_test(self) -> int:
        """Next test to drive: all tests below it are done."""
        return self._manifest.next_test

    @property
    def tests(self) -> int:
        """Tests done."""
        return self._manifest.tests

    @property
    def crashes(self) -> int:
        """AV crashes in these tests; may exceed the cases stored."""
        return self._manifest.crashes

    @property
    def finished(self) -> bool:
        """Whether the run reached its target."""
        return self._manifest.finished

    @property
    def damaged(self) -> list[str]:
        """Files found damaged so far, each with its fault; `verify` reads all."""
        return [f"{name} {fault}" for name, fault in self._reader.damaged.items()]

    def __len__(self) -> int:
        """Number of cases outside shards known to be damaged."""
        return sum(shard.cases for shard in self._manifest.shards if shard.cases_file.name not in self._reader.damaged)

    @claims()
    def append_shard(self, shard: EncodedShard | None, *, next_test: int, tests: int, crashes: int) -> None:
        """Write packed cases as one shard and commit it with the progress of the run. 1000 cases make a good shard.

        Args:
            shard: New cases (`shards.encode_tables`) of this library's ODD, ascending by test, from `self.next_test`
                to below `next_test`; None: no cases.
            next_test: All tests below it are done now.
            tests: Tests done in the whole run.
            crashes: AV crashes in the whole run.

        Raises:
            InputError: Cases or progress do not continue the library, or the caller's own columns are others.
            OutputError: It cannot be written, is open for reading only, or another process wrote to it.
        """
        self._check_progress(next_test, tests, crashes)
        self._check_writable()
        if shard is not None:
            self._check_follows(shard, next_test)
        self._append(shard, next_test, tests, crashes)

    def _check_follows(self, shard: EncodedShard, next_test: int) -> None:
        """Check that cases are of the seed, come after the stored ones, and have the same columns."""
        in_order = shard.ascending and self.next_test <= shard.first_test <= shard.last_test < next_test
        if shard.seeds != {self._manifest.run["seed"]} or not in_order:
            raise InputError(
                f"Cases of tests {shard.first_test} to {shard.last_test} of seeds {sorted(shard.seeds)} do not "
                f"continue the library {self._path}; they must ascend in [{self.next_test}, {next_test})."
            )
        motion = {one.name for one in tracks_fields(self._manifest.run)}
        if motion != set(shard.motion):
            raise InputError(
                f"Of cases scripted or on rails more is stored than of tests of a seed: tests {shard.first_test} to "
                f"{shard.last_test} and the library {self._path} are not of the same kind; keep the two apart."
            )
        if self._manifest.extra is not None and dict(self._manifest.extra) != dict(shard.extra):
            raise InputError(
                f"The cases have the extra columns {dict(shard.extra)}, this library has "
                f"{dict(self._manifest.extra)}; all cases need the same columns of the same types."
            )

    def open_cases(self, shard_cases: int) -> int:
        """Number of cases in the last shard if it is undamaged and has fewer than `shard_cases`: `fill` adds to it."""
        return 0 if (last := self._last_short(shard_cases)) is None else last[0].num_rows

    def _last_short(self, shard_cases: int) -> tuple[pa.Table, pa.Table] | None:
        shards = self._manifest.shards
        if not shards or shards[-1].cases >= shard_cases:
            return None
        return self._both(shards[-1])

    @claims()
    def fill(
        self, cases: pa.Table, tracks: pa.Table, *, next_test: int, tests: int, crashes: int, shard_cases: int
    ) -> None:
        """Save cases so that the files do not depend on the number of calls: each shard but the last is full.

        The last shard is filled up first. Its new files do not replace the listed ones, but get other names, so that a
        kill before the commit leaves it as it was.

        Args:
            cases, tracks: New cases, as for `encode_tables`; there may be none.
            next_test, tests, crashes: As for `append_shard`.
            shard_cases: Cases in a full shard; the same in all calls.

        Raises:
            InputError, OutputError: As for `append_shard`.
        """
        self._check_progress(next_test, tests, crashes)
        self._check_writable()
        if not cases.num_rows:
            self._append(None, next_test, tests, crashes)
            return
        new = encode_tables(cases, tracks)
        self._check_follows(new, next_test)
        shards = self._manifest.shards
        if (last := self._last_short(shard_cases)) is not None:
            # The new rows' schema: what is read back carries numbers of Parquet's columns, which would be stored.
            cases = pa.concat_tables([last[0].cast(cases.schema), cases])
            tracks = pa.concat_tables([last[1].cast(tracks.schema), tracks])
            shards = shards[:-1]
        for start in range(0, cases.num_rows, shard_cases):
            part = encode_tables(cases.slice(start, shard_cases), tracks.slice(start, shard_cases))
            index = len(shards)
            listed = self._manifest.shards[index : index + 1]
            growing = bool(listed) and listed[0].cases_file.name == shard_names(index)[0]
            shards = (*shards, write_shard(self._path, index, part, growing=growing))
        now = replace(self._manifest, shards=shards, extra=dict(new.extra), finished=False)
        self._commit(replace(now, next_test=next_test, tests=tests, crashes=crashes))

    def _settle(self) -> None:
        """Give grown shards their usual names, and remove their older files."""
        shards = list(self._manifest.shards)
        for index, shard in enumerate(shards):
            if shard.cases_file.name != shard_names(index)[0]:
                files = []
                for file, name in zip((shard.cases_file, shard.tracks_file), shard_names(index), strict=True):
                    content = self._reader.read(file)
                    if content is None:
                        return  # damaged: it keeps its name, and is named so
                    replace_file(self._path / name, memoryview(content))
                    files.append(replace(file, name=name))
                shards[index] = replace(shard, cases_file=files[0], tracks_file=files[1])
        if tuple(shards) != self._manifest.shards:
            self._commit(replace(self._manifest, shards=tuple(shards)))
        for entry in self._path.glob("*-growing.parquet"):
            if is_leftover(entry.name, self._manifest):
                entry.unlink()

    def _append(self, shard: EncodedShard | None, next_test: int, tests: int, crashes: int) -> None:
        old = self._manifest
        shards, extra = old.shards, old.extra
        if shard is not None:
            extra = dict(shard.extra)
            shards = (*shards, write_shard(self._path, len(shards), shard))
        self._commit(
            replace(old, shards=shards, extra=extra, next_test=next_test, tests=tests, crashes=crashes, finished=False)
        )

    def _check_progress(self, next_test: int, tests: int, crashes: int) -> None:
        check_integer("next_test", next_test, low=self.next_test)
        check_integer("tests", tests, low=self.tests)
        check_integer("crashes", crashes, low=self.crashes)

    @claims()
    def finish(self) -> None:
        """Mark the run as finished. Later cases remove the mark.

        Raises:
            OutputError: As for `append_shard`.
        """
        self._check_writable()
        self._settle()
        self._commit(replace(self._manifest, finished=True))

    def _check_writable(self) -> None:
        if self._committed is None:
            raise OutputError(f"{self._path} is open for reading; open it with CaseLibrary.resume to append.")
        claim_folder(self._path)
        if read_manifest(self._path)[1] != self._committed:
            raise OutputError(f"Another process writes to {self._path}; stop one of the two, then use --resume.")

    def _commit(self, manifest: Manifest) -> None:
        self._committed = write_manifest(self._path, manifest)
        self._manifest = manifest
        self._reader.own_columns = manifest.extra or {}

    def scalars(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Read all cases, one row each, ascending by test, without trajectories.

        Args:
            columns: Names from `schema.CASES` or the caller's own; None: all but the history.

        Raises:
            UnknownNameError: No column has this name.
        """
        schema = arrow_schema(CASES, self._manifest.extra)
        if columns is None:
            columns = [name for name in schema.names if name != "history"]
        for name in columns:
            if name not in schema.names:
                raise UnknownNameError("column", name, schema.names)
        # A file is read, checked and unpacked outside Python's lock.
        with ThreadPoolExecutor(_READERS) as pool:
            tables = list(pool.map(lambda shard: self._reader.cases(shard, columns), self._manifest.shards))
        empty = schema.empty_table().select(list(columns))
        return pa.concat_tables([empty, *(table for table in tables if table is not None)])

    def shards(self) -> Iterator[tuple[pa.Table, pa.Table]]:
        """Read all cases with their trajectories, a shard at a time; damaged shards are left out.

        Yields:
            Rows of `schema.CASES` with the caller's own columns, and of the same cases in the same order of
            `schema.TRACKS`.
        """
        for shard in self._manifest.shards:
            both = self._both(shard)
            if both is not None:
                yield both

    def _both(self, shard: Shard) -> tuple[pa.Table, pa.Table] | None:
        """Read a shard's cases and trajectories; None if one of the two is damaged."""
        cases = self._reader.cases(shard, None)
        tracks = None if cases is None else self._reader.tracks(shard)
        motion = None if tracks is None else tracks.all()
        return None if cases is None or motion is None else (cases, motion)

    def history(self) -> tuple[list[str], NDArray[np.float64]]:
        """Read the last seconds before each crash.

        Returns:
            Case ids, and an array of shape (S, 16, 2, 4): [x m, y m, speed m/s, heading rad] of the AV and its crash
            partner k = 0..15 s before first contact; NaN where the test had not begun or the vehicle was absent.
        """
        table = self.scalars(["case_id", "history"])
        chunks = [chunk.flatten().to_numpy() for chunk in table.column("history").chunks]
        flat = np.concatenate(chunks) if chunks else np.empty(0)
        return table.column("case_id").to_pylist(), flat.astype(np.float64).reshape(-1, *HISTORY_SHAPE)

    def sizes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Read lengths and widths [m] of the AV and its crash partner, (S, 2) each, in the order of `history`.

        The AV has the size of the ODD's cars, unless own columns `av_length_m` and `av_width_m` give another one.
        """
        of_av = [field.name for field in AV_SIZES if field.name in self.extra]
        table = self.scalars(["bv_length_m", "bv_width_m", *of_av])
        found = []
        for name, of_car in (("length_m", self.odd.vehicle_length), ("width_m", self.odd.vehicle_width)):
            partner = table.column(f"bv_{name}").to_numpy()
            av = table.column(f"av_{name}").to_numpy() if f"av_{name}" in of_av else np.full(partner.size, of_car)
            found.append(np.stack([av, partner], axis=1))
        return found[0], found[1]

    def query(
        self, sql: str, *, seconds: float = SECONDS, megabytes: int = MEGABYTES
    ) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Answer one SELECT over the table `cases`; see `query.run_sql`.

        Raises:
            InputError: The statement is wrong or forbidden.
            MissingExtraError: DuckDB is not installed.
        """
        return run_sql(self.scalars(), sql, seconds=seconds, megabytes=megabytes)

    def scenario(self, case_id: str) -> StoredCase:
        """Read one case with its trajectories.

        Raises:
            UnknownCaseError: No case has this id; the nearest are suggested.
            FileFormatError: It lies in a damaged shard.
        """
        shard = self._shard_of(case_id)
        table = self._reader.cases(shard, None)
        ids = [] if table is None else table.column("case_id").to_pylist()
        if table is not None and case_id not in ids:
            raise self._unknown(case_id, int(case_id.partition(":")[2]), table.column("test").to_pylist())
        tracks = None if table is None else self._reader.tracks(shard)
        motion = None if tracks is None else tracks.case(ids.index(case_id))
        if table is None or motion is None:
            raise FileFormatError(
                f"Case {case_id} lies in a damaged shard: {'; '.join(self.damaged)}; generate it again."
            )
        return self._stored(table, ids.index(case_id), motion, 0)

    def scenarios(self, case_ids: Collection[str]) -> Iterator[StoredCase]:
        """Read cases with their trajectories, in the order of the library: many at once cost a tenth of one by one.

        Raises:
            UnknownCaseError, FileFormatError: As for `scenario`, before the first case is read.
        """
        wanted: dict[Shard, set[str]] = {}
        for case_id in case_ids:
            wanted.setdefault(self._shard_of(case_id), set()).add(case_id)
        known: set[str] = set()
        for shard in wanted:
            names = self._reader.cases(shard, ["case_id"])
            known.update([] if names is None else names["case_id"].to_pylist())
        for case_id in case_ids:
            if case_id not in known:
                self.scenario(case_id)  # raises the error
        for shard in sorted(wanted, key=lambda one: one.first_test):
            both = self._both(shard)
            if both is None:
                raise FileFormatError(f"A shard is damaged: {'; '.join(self.damaged)}; generate its cases again.")
            table, motion = both[0], both[1].combine_chunks()
            for row, case_id in enumerate(table.column("case_id").to_pylist()):
                if case_id in wanted[shard]:
                    yield self._stored(table, row, motion, row)

    def _stored(self, cases: pa.Table, row: int, tracks: pa.Table, track: int) -> StoredCase:
        """Make the case of a row of the cases and of a row of the tracks."""
        scalars = cases.slice(row, 1).to_pylist()[0]
        history = np.array(scalars.pop("history"), dtype=np.float64).reshape(HISTORY_SHAPE)
        scenario = restore(scalars, tracks, track, self.odd)
        return StoredCase(scenario, scalars, history, script_of(scenario, tracks, track))

    def verify(self) -> list[str]:
        """Read every file and check all that can be checked; returns `damaged`, and files with impossible values."""
        return [f"{name} {fault}" for name, fault in self.faults() if fault is not None]

    def faults(self) -> Iterator[tuple[str, str | None]]:
        """Read file after file and check all that can be checked.

        Yields:
            The file's name, and what is wrong with it, or None.
        """
        for shard in self._manifest.shards:
            wrong: dict[str, str] = {}
            names = shard.cases_file.name, shard.tracks_file.name
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DamagedShardWarning)
                try:
                    wanted = names[0]
                    cases = self._reader.cases(shard, None)
                    wanted = names[1]
                    if cases is None:
                        self._reader.read(shard.tracks_file)
                    elif (tracks := self._reader.tracks(shard)) is not None:
                        tracks.all()
                except FileFormatError as error:
                    wrong[wanted] = str(error).removeprefix(f"{self._path / wanted}: ")
            for name in names:
                yield name, wrong.get(name, self._reader.damaged.get(name))

    def _shard_of(self, case_id: str) -> Shard:
        seed, _, number = case_id.partition(":") if ":" in case_id else ("", "", case_id)
        if not self._manifest.shards:
            raise InputError(f"{self._path} holds no case yet, so there is no {case_id}; generate some first.")
        test = int(number) if number.isdecimal() else None
        for shard in self._manifest.shards if seed == str(self._manifest.run["seed"]) else ():
            if test is not None and shard.first_test <= test <= shard.last_test:
                return shard
        # Only the nearest shard, not all names: to search a million for the most alike takes a minute.
        at = 0 if test is None else test
        nearest = min(self._manifest.shards, key=lambda s: max(s.first_test - at, at - s.last_test, 0))
        table = self._reader.cases(nearest, ["test"])
        tests = [nearest.first_test, nearest.last_test] if table is None else table.column("test").to_pylist()
        raise self._unknown(case_id, test, tests)

    def _unknown(self, case_id: str, test: int | None, tests: Sequence[int]) -> UnknownCaseError:
        """Suggest the cases of the nearest tests; for an invalid case id, the first ones."""
        near = sorted(set(tests), key=lambda other: other if test is None else abs(other - test))[:3]
        seed = self._manifest.run["seed"]
        ids = [f"{seed}:{other}" for other in near]
        return UnknownCaseError(case_id, ids, len(self), str(self._path), is_near=test is not None)


@contextmanager
def _claimed(folder: Path) -> Iterator[None]:
    """Claim a library's folder: up to the end of the call that is at work, or, where there is none, for this moment."""
    try:
        is_taken = folder.exists() and not folder.is_dir()
    except OSError as error:  # the name is too long
        raise OutputError(f"Cannot write {shown(str(folder))}: {reason(error)}; choose another place.") from error
    if is_taken:
        raise OutputError(f"{folder} cannot be used as a folder: Not a directory; choose another place.")
    claim_folder(folder)
    with claims():
        claim_folder(folder)
        yield


def _holds_library(folder: Path, identity: Identity, odd: Odd) -> bool:
    """Say whether a folder holds a library of this run (True), or nothing (False).

    Raises:
        OutputError: It is no folder, or holds something else.
        InputError: It holds the library of another run.
        FileFormatError: It holds a library that cannot be read.
    """
    try:
        names = {entry.name for entry in folder.iterdir() if not is_lock(entry.name)}
    except FileNotFoundError:
        return False
    except OSError as error:
        raise OutputError(f"{folder} cannot be used as a folder: {error.strerror}; choose another place.") from error
    if MANIFEST not in names:
        foreign = sorted(name for name in names if not is_leftover(name, None))
        if foreign:
            raise OutputError(f"{folder} holds something else ({foreign[0]}); choose a new or empty folder.")
        if shards := sorted(name for name in names if not name.startswith(".")):  # the manifest comes before all shards
            raise OutputError(
                f"{folder} holds cases ({shards[0]}) but no {MANIFEST}, which says what they are; restore it from a "
                "copy, or choose another place."
            )
        return False
    difference = first_difference(read_manifest(folder)[0], check_identity(identity), odd)
    if difference is not None:
        raise InputError(
            f"{folder} holds the library of another run: {difference}; use the same options, or another place."
        )
    return True
