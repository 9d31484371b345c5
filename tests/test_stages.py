"""Stages of a run: each is done once, and again only if what it made is gone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cornerforge.verbs.stages import PlainRates
from cornerforge.work.stages import Stage, Stages


def test_a_finished_stage_is_done_again_only_if_what_it_made_is_gone(tmp_path: Path) -> None:
    done: list[str] = []

    def work() -> PlainRates:
        done.append("once")
        (tmp_path / "made").touch()
        return PlainRates((), 1.5)

    for _ in range(2):
        assert Stages(tmp_path).do("stage", PlainRates, work, ("made",)) == PlainRates((), 1.5)
    assert len(done) == 1
    (tmp_path / "made").unlink()
    Stages(tmp_path).do("stage", PlainRates, work, ("made",))
    assert len(done) == 2
    assert (tmp_path / "made").exists()


def rates(seconds: float) -> PlainRates:
    return PlainRates((), seconds)


def test_each_stage_comes_as_early_in_the_list_as_those_before_it_allow(tmp_path: Path) -> None:
    begun: list[str] = []

    def stage(name: str, *after: str, is_kept: bool = True) -> Stage:
        def work() -> PlainRates:
            begun.append(name)
            assert found.keys() >= set(after)
            return rates(len(begun))

        return Stage(name, PlainRates, work, after, is_kept=lambda: is_kept)

    found: dict[str, Any] = {}
    stages = [stage("d", "c"), stage("a"), stage("c", "b", is_kept=False), stage("b", "a"), stage("e")]
    Stages(tmp_path).go(stages, found)
    assert begun == ["a", "b", "c", "d", "e"]
    assert found == {name: rates(1.0 + k) for k, name in enumerate("abcde")}
    assert {path.name for path in (tmp_path / "stages").iterdir()} == {"a.json", "b.json", "d.json", "e.json"}
    found.clear()
    Stages(tmp_path).go(stages, found)
    assert begun[5:] == ["c"], "what is not kept is made again"


def test_stages_that_wait_for_each_other_or_for_none_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(StopIteration):
        Stages(tmp_path).go([Stage("a", PlainRates, lambda: rates(1.0), ("no such",))], {})
    assert not (tmp_path / "stages").exists()
