from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from cornerforge.drivers.avs import AV_KINDS, AVS, AvLaw, av_hash, av_named
from cornerforge.drivers.idm import IdmParams
from cornerforge.drivers.sight import Sight
from cornerforge.errors import InputError, UnknownNameError


@pytest.mark.parametrize("name", sorted(AVS))
def test_avs_are_named_and_described(name: str) -> None:
    av = av_named(name)
    assert av.name == name
    assert len(av.about) > 10
    assert "\n" not in av.about


def test_an_unknown_av_names_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r'No AV "idm-mobill"\. Did you mean "idm-mobil"\?'):
        av_named("idm-mobill")


def test_the_hash_is_of_the_behaviour_not_of_the_name() -> None:
    av = av_named("idm-mobil")
    assert av_hash(dataclasses.replace(av, name="other", about="another")) == av_hash(av)
    changed = [
        dataclasses.replace(av, idm=IdmParams(time_gap=1.4)),
        dataclasses.replace(av, mobil=dataclasses.replace(av.mobil, politeness=0.1)),
        *(dataclasses.replace(av, sight=Sight(by)) for by in ("decision", "centre")),
        dataclasses.replace(av, sight=Sight(offset=0.5)),
        dataclasses.replace(av, sight=Sight(perception_time=0.1)),
    ]
    assert len({av_hash(model) for model in [av, *changed]}) == 7
    assert len({av_hash(model) for model in AVS.values()}) == len(AVS)


@pytest.mark.parametrize(
    "wrong",
    [{"by": "telepathy"}, {"offset": -0.1}, {"offset": 3.1}, {"perception_time": -0.1}, {"perception_time": 2.1}],
)
def test_a_sight_that_makes_no_sense_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=rf"av\.sight\.{next(iter(wrong))}"):
        Sight(**wrong)


def test_parameters_that_a_law_does_not_drive_by_are_refused() -> None:
    """Else they could change how an AV drives and not its hash."""
    cautious, plain = av_named("rss-cautious"), av_named("idm-mobil")
    careful = dataclasses.replace(cautious.rss, response_time=0.6)
    assert av_hash(dataclasses.replace(cautious, rss=careful)) != av_hash(cautious)
    with pytest.raises(InputError, match=r"av\.rss is given, but an AV of kind plain does not drive by it"):
        dataclasses.replace(plain, rss=careful)


def test_a_law_without_its_facts_cannot_be_declared() -> None:
    """A forgotten limit of braking, or a forgotten look around, would give wrong contacts in silence."""
    for name in AvLaw._fields:
        facts: dict[str, Any] = AV_KINDS["learned"]._asdict()
        facts.pop(name)
        with pytest.raises(TypeError, match=name):
            AvLaw(**facts)
    assert sorted(law.code for law in AV_KINDS.values()) == list(range(len(AV_KINDS)))
