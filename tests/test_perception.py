"""Perceptions as options and files have them."""

from __future__ import annotations

import pytest

from cornerforge.errors import InputError
from cornerforge.perception import PERFECT, Perception, numbers_of_perception, perception_of
from cornerforge.types import Odd


def test_a_perception_is_read_as_it_is_written() -> None:
    text = "latency=0.2,range=120,dropout=0.01,noise=0.3,occlusion"
    found = perception_of(text)
    assert found == Perception(latency=0.2, range=120.0, dropout=0.01, noise=0.3, occlusion=True)
    assert found is not None
    assert found.in_words() == text
    assert perception_of(" latency = 0.2 , occlusion ") == Perception(latency=0.2, occlusion=True)
    assert numbers_of_perception(found).late == 2


@pytest.mark.parametrize("text", ["", "latency=0", "range=200,noise=0.0"])
def test_a_perfect_perception_is_none(text: str) -> None:
    assert perception_of(text) is None
    assert not PERFECT.on


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("latency", "write latency=NUMBER"),
        ("latency=0.25", "tenths of a second"),
        ("latency=nan", "allowed"),
        ("latency=1.1", "allowed: 0"),
        ("range=5", "allowed: 10"),
        ("dropout=0.6", "allowed: 0"),
        ("noise=-1", "allowed"),
        ("occlusion=1", "takes no number"),
        ("noise=0.1,noise=0.2", "twice"),
        ("delay=0.2", "Did you mean"),
    ],
)
def test_a_wrong_perception_is_refused_by_name(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        perception_of(text)


def test_an_odd_states_its_perception_only_where_there_is_one() -> None:
    odd = Odd(perception=Perception(latency=0.5, occlusion=True))
    assert "perception" not in Odd().stated()
    assert Odd.of_stated(odd.stated()) == odd
