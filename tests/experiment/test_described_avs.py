"""An AV is described first, and started when something is asked that only its process can say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.interpreter import in_use
from cornerforge.foreign.named_avs import check_named
from cornerforge.sim import controllers
from cornerforge.world_options import WorldOptions

AV = """
import numpy as np

open("started", "a").write("once\\n")

class MyAv:
    interface, answers = 2, "curvature"
    def act(self, scenes):
        return np.zeros((len(scenes.running), 2))
"""


@pytest.mark.usefixtures("in_memory")
def test_an_experiment_starts_no_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_av.py").write_text(AV, encoding="utf-8")
    run = experiment(WorldOptions(av="my_av:MyAv"), takes_foreign=True)
    assert not (tmp_path / "started").exists()
    assert "my_av:MyAv" not in in_use()
    with pytest.raises(InputError, match="not named in this folder"):
        check_named("my_av:MyAv", tmp_path)
    identity = run.identity(0)
    assert (tmp_path / "started").read_text(encoding="utf-8") == "once\n"
    assert (identity["av_steers"], run.opened_setting.who.av) == (True, controllers.STEERED)
    assert "my_av:MyAv" in in_use()
    check_named("my_av:MyAv", tmp_path)


@pytest.mark.usefixtures("in_memory")
def test_an_av_that_is_not_there_is_missed_when_it_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = experiment(av="not_there:Av", takes_foreign=True)
    for _ in range(2):
        with pytest.raises(InputError, match="No module not_there"):
            run.av_hash  # noqa: B018


def test_an_experiment_answers_for_its_av_whichever_it_is() -> None:
    built_in, outside = experiment(), experiment(av="not_there:Av", takes_foreign=True)
    assert (built_in.asked, outside.asked and outside.asked.name) == (None, "not_there:Av")
    assert type(replace(outside, bv="idm")) is type(outside)
    own = vars(type(outside)).keys()
    answers = {name for name, value in vars(Experiment).items() if not name.startswith("_") and callable(value)}
    assert answers - own == {"identity", "script_driver"}


def test_a_number_out_of_range_is_refused_before_anything_starts() -> None:
    with pytest.raises(InputError, match="av_batch"):
        experiment(av="not_there:Av", av_batch=0, takes_foreign=True)
