from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from cornerforge.errors import InputError, MissingExtraError
from cornerforge.library import CaseLibrary
from cornerforge.library.query import Asker


def test_sql_answers_over_the_cases(filled: Path) -> None:
    columns, rows = CaseLibrary.open(filled).query(
        "SELECT case_id, test * 2 AS twice, len(critical_bv_action) AS n FROM cases WHERE test > 10 ORDER BY test DESC"
    )
    assert columns == ["case_id", "twice", "n"]
    assert rows == [("7:20", 40, 6), ("7:13", 26, 6), ("7:12", 24, 6)]


def test_null_stays_null(filled: Path) -> None:
    assert CaseLibrary.open(filled).query("SELECT NULL, min(log_prob_policy) FROM cases")[1] == [(None, -10.0)]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "sql",
    [
        "COPY cases TO '{out}'",
        "COPY (SELECT 1) TO '{out}'",
        "EXPORT DATABASE '{out}'",
        "ATTACH '{out}' AS other",
        "CREATE TABLE mine AS SELECT * FROM cases",
        "DROP VIEW cases",
        "INSTALL httpfs",
        "LOAD httpfs",
        "SET enable_external_access = true",
        "RESET lock_configuration",
        "SELECT 1; COPY cases TO '{out}'",
        "SELECT * FROM read_csv('{secret}')",
        "SELECT * FROM read_text('{secret}')",
        "SELECT * FROM read_blob('{secret}')",
        "SELECT * FROM '{secret}'",
        "SELECT * FROM glob('{folder}/*')",
        "SELECT * FROM sniff_csv('{secret}')",
        "EXPLAIN ANALYZE COPY cases TO '{out}'",
        "EXPLAIN ANALYZE SELECT * FROM read_text('{secret}')",
        "SELECT * FROM query('COPY cases TO ''{out}''')",
        "SELECT * FROM json_execute_serialized_sql(json_serialize_sql('SELECT * FROM read_text(''{secret}'')'))",
        "SELECT * FROM columns_of_python",
    ],
)
def test_nothing_but_the_table_can_be_reached(filled: Path, tmp_path: Path, sql: str) -> None:
    columns_of_python = CaseLibrary.open(filled).scalars()
    secret, out = tmp_path / "secret.csv", tmp_path / "out"
    secret.write_text("password\nhunter2\n")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError):
        CaseLibrary.open(filled).query(sql.format(out=out, secret=secret, folder=tmp_path))
    assert sorted(tmp_path.rglob("*")) == before
    assert columns_of_python.num_rows == 6


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "sql", ["SELEC 1", "SELECT velocity FROM cases", "SELECT * FROM crashes", "SELECT 'a'::INTEGER"]
)
def test_a_mistake_is_one_plain_line(filled: Path, sql: str) -> None:
    with pytest.raises(InputError, match="cannot be answered") as caught:
        CaseLibrary.open(filled).query(sql)
    assert "\n" not in str(caught.value)


def test_a_mistake_names_what_there_is(filled: Path) -> None:
    """FINDINGS 4.15: columns that are alike, and the table."""
    library = CaseLibrary.open(filled)
    with pytest.raises(InputError, match=r"Candidate bindings: .*crash_time"):
        library.query("SELECT crash_tim FROM cases")
    with pytest.raises(InputError, match='The table is "cases"'):
        library.query("SELECT * FROM crashes")
    with pytest.raises(InputError, match=r'Did you mean "\d+:\d+"'):
        library.scenario(str(library.scalars(["test"])["test"][0].as_py()))


def test_what_comes_back_is_plain(filled: Path) -> None:
    """The sandbox's bytes are read as JSON, never unpickled."""
    columns, rows = CaseLibrary.open(filled).query(
        "SELECT sum(test), 0.1::DOUBLE + 0.2, 1.50, 'nan'::DOUBLE, '-inf'::DOUBLE, date '2020-01-02', true, 'ä', "
        "[1, NULL], {'a': 1.5}, 'x'::BLOB, sum(test) AS \"sum\" FROM cases"
    )
    assert len(columns) == 12
    total, exact, fixed, nan, low, *rest = rows[0]
    assert (type(total), exact, fixed, low) == (int, 0.1 + 0.2, 1.5, -math.inf)
    assert math.isnan(nan)
    assert rest == ["2020-01-02", True, "ä", [1, None], {"a": 1.5}, "b'x'", total]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "sql",
    ["SELECT map([date '2020-01-02'], [1])", f"SELECT {'[' * 400}1{']' * 400}", "SELECT timestamptz '2020-01-01'"],
)
def test_what_cannot_be_told_is_an_error(filled: Path, sql: str) -> None:
    with Asker(CaseLibrary.open(filled).scalars()) as asker:
        with contextlib.suppress(InputError):
            asker.ask(sql)
        assert asker.ask("SELECT 1")[1] == [(1,)]


@pytest.mark.parametrize("said", [b"cos\nsystem\n(S'exit 1'\ntR.", b"[" * 100_000, b"\xff"])
def test_a_worker_that_is_not_ones_own_does_no_harm(filled: Path, monkeypatch: pytest.MonkeyPatch, said: bytes) -> None:
    monkeypatch.setattr("cornerforge.library.query.read_message", lambda _: said)
    with Asker(CaseLibrary.open(filled).scalars()) as asker, pytest.raises(InputError, match="not whole"):
        asker.ask("SELECT 1")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("sql", ["", "  ", "-- nothing", "SELECT 1; SELECT 2"])
def test_one_select_it_has_to_be(filled: Path, sql: str) -> None:
    with pytest.raises(InputError, match="one SELECT statement"):
        CaseLibrary.open(filled).query(sql)


def test_a_missing_extra_names_its_command(filled: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "duckdb", None)
    with pytest.raises(MissingExtraError, match=r'pip install "cornerforge\[query\]"'):
        CaseLibrary.open(filled).query("SELECT 1")


# DuckDB does not stop in the middle of these when it is interrupted, or takes more memory than it may.
ENDLESS = "SELECT list_reduce(range(1000000), lambda a, b: a + levenshtein(repeat('a', 3000), repeat('b', 3000) || b))"
GREEDY = "SELECT list_sort(list_transform(range(100000000), lambda x: hash(x)))[1]"


@pytest.mark.full
def test_a_statement_that_does_not_end_is_stopped_and_the_next_is_answered(filled: Path) -> None:
    with Asker(CaseLibrary.open(filled).scalars(), seconds=1.0) as asker:
        begin = time.monotonic()
        for endless in (ENDLESS, "WITH RECURSIVE t(n) AS (SELECT 1 UNION ALL SELECT 1 FROM t) SELECT count(*) FROM t"):
            with pytest.raises(InputError, match="more than 1 s"):
                asker.ask(endless)
        assert time.monotonic() - begin < 60.0  # not that fast, but not for ever
        assert asker.ask("SELECT count(*) FROM cases")[1] == [(6,)]


@pytest.mark.full
@pytest.mark.parametrize("greedy", [GREEDY, "SELECT * FROM range(100000000) ORDER BY hash(range)"])
def test_a_statement_that_needs_much_memory_is_stopped(filled: Path, greedy: str) -> None:
    with Asker(CaseLibrary.open(filled).scalars(), megabytes=128) as asker:
        with pytest.raises(InputError, match="more than 128 MB"):
            asker.ask(greedy)
        assert asker.ask("SELECT 1")[1] == [(1,)]


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"seconds": 0.0}, "seconds = 0.0 s is out of range; allowed: 0.1 to 86400.0 s"),
        ({"seconds": math.nan}, "seconds = nan s is out of range"),
        ({"seconds": math.inf}, "seconds = inf s is out of range"),
        ({"megabytes": 15}, "megabytes = 15 is out of range; allowed: from 16 to 1048576"),
        ({"megabytes": 2.5}, "megabytes = 2.5 is not a whole number"),
    ],
)
def test_the_limits_have_limits(filled: Path, limits: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        CaseLibrary.open(filled).query("SELECT 1", **limits)


@pytest.mark.full
def test_who_asks_may_allow_more(filled: Path) -> None:
    """Twelve million hashes do not fit into 64 MB, and do into 2 GB."""
    library = CaseLibrary.open(filled)
    some = "SELECT count(*) FROM (SELECT hash(range) AS h FROM range(12000000) GROUP BY h)"
    with pytest.raises(InputError, match="more than 64 MB of memory, so it was stopped; ask for less, or allow more"):
        library.query(some, seconds=600.0, megabytes=64)
    assert library.query(some, seconds=600.0, megabytes=2048)[1] == [(12_000_000,)]


@pytest.mark.full
def test_the_time_to_start_is_no_time_of_the_answer(filled: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that starts slowly, as on a busy machine: longer than an answer may take."""
    started = subprocess.Popen

    def slow(command: list[str], **rest: Any) -> subprocess.Popen[bytes]:
        late = f"sys.argv = {command[2:]!r}; time.sleep(2); runpy.run_path(sys.argv[0], run_name='__main__')"
        return started([command[0], "-P", "-c", f"import runpy, sys, time; {late}"], **rest)

    monkeypatch.setattr(subprocess, "Popen", slow)
    with Asker(CaseLibrary.open(filled).scalars(), seconds=1.0) as asker:
        assert asker.ask("SELECT count(*) FROM cases")[1] == [(6,)]


def test_half_a_character_is_no_statement(filled: Path) -> None:
    with pytest.raises(InputError, match=r"no UTF-8: character 9 is '\\udcff'"):
        CaseLibrary.open(filled).query("SELECT '\udcff'")


@pytest.mark.full
def test_closing_stops_the_question_and_those_that_wait(filled: Path) -> None:
    asker = Asker(CaseLibrary.open(filled).scalars())
    told: list[str] = []

    def ask(sql: str) -> None:
        try:
            told.append(str(asker.ask(sql)))
        except InputError as error:
            told.append(str(error))

    asked = [threading.Thread(target=ask, args=(sql,)) for sql in (ENDLESS, "SELECT 1", "SELECT 2")]
    for thread in asked:
        thread.start()
        time.sleep(1.0)  # the first is being answered
    begin = time.monotonic()
    asker.close()
    for thread in asked:
        thread.join()
    assert time.monotonic() - begin < 5.0
    assert told == ["The query was stopped, because what answers it is ending."] * 3
    assert asker._process is None
    with pytest.raises(InputError, match="was stopped"):
        asker.ask("SELECT 1")


ASKS_FOR_LONG = f"""
import pyarrow as pa
from cornerforge.library.query import Asker
asker = Asker(pa.table({{"a": [1]}}), seconds=3600.0)  # its own deadline is far
asker.ask("SELECT 1")
print(asker._process.pid, flush=True)
asker.ask({ENDLESS!r})
"""


def is_running(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.full
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_the_process_ends_by_itself_when_who_asked_was_killed() -> None:
    asking = subprocess.Popen([sys.executable, "-c", ASKS_FOR_LONG], stdout=subprocess.PIPE, text=True)
    assert asking.stdout is not None
    worker = int(asking.stdout.readline())
    time.sleep(1.0)  # it is at work
    assert is_running(worker)
    asking.kill()
    asking.communicate()
    end = time.monotonic() + 15.0
    try:
        while is_running(worker):
            assert time.monotonic() < end
            time.sleep(0.1)
    finally:
        if is_running(worker):
            os.kill(worker, 9)
