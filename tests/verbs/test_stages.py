"""Stages of a run: each is done once, and again only if what it made is gone."""

from __future__ import annotations

from pathlib import Path

from cornerforge.verbs.stages import PlainRates, Stages


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
