"""IDM and MOBIL against highway-env's own functions (full size: `make bench`); skipped where it is not installed."""

from __future__ import annotations

import warnings
from dataclasses import replace
from types import ModuleType

import pytest

from cornerforge.drivers.avs import AVS, AvModel


@pytest.fixture(scope="module")
def functions() -> ModuleType:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what it stands on
        pytest.importorskip("highway_env")
        import versus_functions
    return versus_functions


@pytest.mark.parametrize("name", ["idm-mobil", "idm-mobil-d2rl"])
def test_idm(functions: ModuleType, name: str) -> None:
    result = functions.compare_idm(AVS[name], states=500, seed=1)
    assert max(result.largest, result.plain_largest) <= functions.TOLERANCE
    assert result.plain_states > 100
    assert result.below_s0 > 10, "the states must need point 2"


@pytest.mark.parametrize("politeness", [0.0, 0.5])
def test_mobil(functions: ModuleType, politeness: float) -> None:
    model = AVS["idm-mobil"]
    result = functions.compare_mobil(
        replace(model, mobil=replace(model.mobil, politeness=politeness)), states=300, seed=1
    )
    assert result.restated_differ == 0
    assert 20 < result.changes < 280
    assert result.plain_differ > 0, "the states must need the stated changes"


def test_a_difference_is_seen(functions: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    # Negative control: an IDM that is a millionth stronger than the one compared with.
    idm = functions.idm_acceleration
    monkeypatch.setattr(functions, "idm_acceleration", lambda *a: idm(*a) * (1.0 + 1e-6))
    model: AvModel = AVS["idm-mobil"]
    with pytest.raises(RuntimeError, match="differs from highway-env"):
        functions.compare_idm(model, states=50)
