"""Kinds of crash (`analysis.mechanism`) in plain words, for the pages and the explorer."""

from __future__ import annotations

from cornerforge.report import text

__all__ = ["KINDS", "kind_in_words"]

KINDS: dict[str, tuple[str, str]] = {
    "follow-up": (
        "caught in a crash of two others", "The AV is caught in a crash of two other vehicles close by."
    ),
    "same-lane-same-side": (
        "both into one lane, from one side", "The AV and another vehicle move into the same lane from the same side."
    ),
    "same-lane-opposite-sides": (
        "both into one lane, from both sides",
        "The AV and another vehicle move into the same lane from opposite sides.",
    ),
    "swap": (
        "they swap lanes", "The AV and the vehicle beside it move into each other's lane at the same time."
    ),
    "bv-rear-av-cut-in": (
        "struck from behind after its lane change",
        "The AV changes lanes, and the vehicle behind it there runs into its rear.",
    ),
    "bv-rear-bv-change": (
        "struck from behind by one that changes lanes", "A vehicle changes lanes and runs into the AV's rear."
    ),
    "bv-rear-av-braking": (
        "struck from behind while it brakes hard", "The AV brakes hard, and the vehicle behind runs into its rear."
    ),
    "bv-rear": (
        "struck from behind", "The vehicle behind runs into the AV's rear, although the AV did not brake hard."
    ),
    "av-rear-bv-cut-in": (
        "runs into one that cut in", "A vehicle changes into the AV's lane close ahead, and the AV runs into its rear."
    ),
    "av-rear-av-change": (
        "runs into a rear as it changes lanes", "The AV changes lanes and runs into the rear of the vehicle there."
    ),
    "av-rear-bv-braking": (
        "runs into one that brakes hard", "The vehicle ahead brakes hard, and the AV runs into its rear."
    ),
    "av-rear": (
        "runs into the one ahead", "The AV runs into the rear of the vehicle ahead, which did not brake hard."
    ),
    "bv-side": (
        "one beside it comes over", "A vehicle beside the AV changes into its lane and touches its side."
    ),
    "av-side": (
        "comes over into one beside it", "The AV changes lanes into the side of the vehicle beside it."
    ),
    "av-merges": (
        "merges into another's path", "The AV leaves a lane that ends and comes into the path of another vehicle."
    ),
    "bv-merges": (
        "one merges into its path", "A vehicle leaves a lane that ends and comes into the path of the AV."
    ),
    "leaving": (
        "where an exit leaves", "The AV or another vehicle comes into the path of the other in the lane of an exit."
    ),
    "lane-end": (
        "where its lane ends", "The AV is where its lane ends, and neither came into the path of the other."
    ),
    "person-right-turn": (
        "a person, as it turns right", "The AV, on a way to the right, and a person on a crosswalk touch."
    ),
    "person-left-turn": (
        "a person, as it turns left", "The AV, on a way to the left, or back, and a person on a crosswalk touch."
    ),
    "person-straight": (
        "a person, straight on", "The AV, on a way straight on, and a person on a crosswalk touch."
    ),
    "rear-end-by-av": ("runs into the one ahead", "The AV runs into the rear of a vehicle ahead on its way."),
    "rear-end-by-bv": ("struck from behind", "A vehicle behind on its way runs into the AV's rear."),
    "left-across-by-av": (
        "turns left across another's way", "The AV turns left across the way of an oncoming vehicle."
    ),
    "left-across-by-bv": ("one turns left across its way", "An oncoming vehicle turns left across the AV's way."),
    "angle": ("ways cross", "The ways of the AV and of another vehicle cross, from one side, and they touch there."),
    "sideswipe": (
        "side by side", "The ways of the AV and of another lead into one lane, or part, and they touch side by side."
    ),
    "other-at-site": ("another way, at a site", "The AV and another touch at a site in a way that has no name here."),
    "other": ("another way", "The AV and another vehicle touch in a way that has no name here."),
}  # fmt: skip
"""Mechanism (`analysis.mechanism`) -> a few words about the AV, and a sentence."""


def kind_in_words(kind: str) -> str:
    """Say what happens in crashes of a kind: a mechanism or, where that is not known, a crash type.

    >>> kind_in_words("av-side"), kind_in_words("rear-end by BV")
    ('The AV changes lanes into the side of the vehicle beside it', 'Rear-end by another vehicle')
    """
    return KINDS[kind][1].removesuffix(".") if kind in KINDS else text.capital(text.plain(kind))
