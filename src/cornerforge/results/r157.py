"""The result of `r157` and of `suite run`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Share, Whole, meant
from cornerforge.results.html import Result

__all__ = ["Regulated", "RegulatedFamily", "RegulatedPair", "RegulatedRoads", "RegulatedTest"]

_NO_INTERVAL = "A grid is no sample, so there is no interval."


class _Verdicts(Result):
    """Outcomes of an AV and of the reference drivers in some scenarios."""

    scenarios: Annotated[Whole, meant("Scenarios that the AV drove.")]
    failed: Annotated[Whole, meant("Those in which it touches another vehicle, or another vehicle touches it.")]
    failed_but_prevented_by: Annotated[
        dict[str, Whole], meant("Those of them that a reference driver drives through without contact, by its name.")
    ]
    failed_but_prevented_by_all: Annotated[
        Whole, meant("Those of them that each reference driver prevents; reg157 is not asked in aeb's braking.")
    ]
    failed_but_held_speed_passes: Annotated[
        Whole, meant("Those of them in which a driver that only holds its speed touches nobody: no care was needed.")
    ]
    reference_crashes: Annotated[dict[str, Whole], meant("Crashes of each reference driver in all the scenarios.")]


class RegulatedRoads(Result):
    """How cut-ins of one closing speed lie on real roads, and what becomes of them; by a fit to recorded ones."""

    at_least: Annotated[
        Share,
        meant(
            "Share, from 0 to 1, of closing cut-ins at such speeds of the other vehicle that close at least so fast."
        ),
    ]
    failed: Annotated[Share, meant("Share, from 0 to 1, of cut-ins that close so fast in which the AV fails.")]
    failed_but_prevented_by: Annotated[
        dict[str, float], meant("Share in which the AV fails and a reference driver does not, by its name.")
    ]


_FAMILY = "Its name; of r157 cut-in, cut-out, deceleration, of aeb stationary, moving, braking."


class RegulatedPair(_Verdicts):
    """One family and one pair of speeds."""

    family: Annotated[str, meant(_FAMILY)]
    av_kmh: Annotated[Whole, meant("Speed of the AV at the start.", "km/h")]
    other_kmh: Annotated[
        Whole, meant("Speed of the vehicle that cuts in, is uncovered, or is ahead, at the start.", "km/h")
    ]
    on_roads: Annotated[
        RegulatedRoads | None, meant("Of a cut-in; null: another family, or a speed at which none were recorded.")
    ]


class RegulatedFamily(_Verdicts):
    """One family of scenarios."""

    family: Annotated[str, meant(_FAMILY)]
    share_failed: Annotated[Share, meant(f"Of its scenarios, from 0 to 1. {_NO_INTERVAL}")]


class RegulatedTest(Result):
    """One test that a protocol demands."""

    scenario: Annotated[Whole, meant("Its number in scenarios.csv.")]
    family: Annotated[str, meant(_FAMILY)]
    av_kmh: Annotated[Whole, meant("Speed of the AV at the start.", "km/h")]
    other_kmh: Annotated[Whole, meant("Speed of the vehicle ahead at the start.", "km/h")]
    point: Annotated[dict[str, float], meant("What else it is made of, by column of scenarios.csv.")]
    verdict: Annotated[str, meant('"avoided", "touched", "left its lane", or "no answer".')]
    touch_kmh: Annotated[float | None, meant("Relative speed along the road at the touch; null without one.", "km/h")]
    allowed_kmh: Annotated[float | None, meant("Largest that UN R152 allows an AEB; null: none is stated.", "km/h")]
    reference_touched: Annotated[tuple[str, ...], meant("Reference drivers that touch in it.")]


class Regulated(_Verdicts):
    """An AV in the scenarios of a regulation or a test protocol."""

    suite: Annotated[str, meant('"r157" or "aeb".')]
    av: Annotated[str, meant("The AV.")]
    odd: Annotated[str, meant("The ODD.")]
    share_failed: Annotated[Share, meant(f"Of the scenarios, from 0 to 1. {_NO_INTERVAL}")]
    share_failed_but_prevented_by_all: Annotated[
        Share, meant(f"Scenarios in which the AV fails and no reference driver does, from 0 to 1. {_NO_INTERVAL}")
    ]
    beyond_allowed: Annotated[
        Whole, meant("Tests of a protocol in which it touches at a higher speed than UN R152 allows an AEB.")
    ]
    tests: Annotated[tuple[RegulatedTest, ...], meant("Tests that the protocols demand; of r157 none is one alone.")]
    av_faults: Annotated[
        Whole, meant("Further scenarios, in which an AV from outside raised, hung or gave no usable answer.")
    ]
    too_fast_kmh: Annotated[
        tuple[Whole, ...], meant("Speeds of the AV that are left out, because the ODD does not allow them.", "km/h")
    ]
    roads_failed: Annotated[
        float | None,
        meant(
            "Share of cut-ins in which the AV fails when each counts as often as a fit to recorded ones has it; null: "
            "no cut-ins were driven.",
        ),
    ]
    roads_failed_but_prevented_by: Annotated[
        dict[str, float] | None,
        meant("The same, of cut-ins that a reference driver prevents, by its name; null with it."),
    ]
    families: Annotated[tuple[RegulatedFamily, ...], meant("Family by family.")]
    pairs: Annotated[tuple[RegulatedPair, ...], meant("Pair of speeds by pair of speeds.")]
    library: Annotated[str | None, meant("Library of the scenarios in which the AV fails; null without --out.")]
    page: Annotated[str | None, meant("Page with the pictures; null without --out.")]
    seconds: Annotated[float, meant("Wall-clock.", "s")]
