"""AVs that the paper's commands and suites take by themselves can drive where those are driven."""

from __future__ import annotations

import pytest

from cornerforge.errors import InputError
from cornerforge.experiment.setting import experiment
from cornerforge.ext.paper import bench
from cornerforge.ext.studies import suite


def test_avs_that_are_taken_where_none_is_named_drive_on_roads() -> None:
    for name in {*bench._TRIED, *suite._zoo(None)}:
        assert experiment(av=name).av.name == name
    with pytest.raises(InputError, match="drives at sites only"):
        experiment(av="idm-yield")
