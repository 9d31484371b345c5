"""Plain words for the names that files use: for people who see a crash for the first time."""

from __future__ import annotations

import re

from cornerforge.report.judged import CONDUCT_WORDS, PREVENTION_WORDS
from cornerforge.report.kinds import KINDS

__all__ = ["KINDS", "VALUES", "label_of"]


VALUES: dict[str, dict[str, str]] = {
    "source": {"natural": "natural traffic", "adversary": "made by the adversary", "scripted": "scripted"},
    "prevention": dict(PREVENTION_WORDS),
    "way_out": {
        "by leaving it out": "yes, of what the AV itself began",
        "after 1 s": "yes, even 1 s after it began",
        "with a faster reaction": "yes, within 1 s after it began",
        "with foresight": "only before it began",
        "none": "none",
        "undecided": "none found, not all tried",
        "not looked for": "not looked for",
    },
    "role": {
        "worth a look": "worth a look",
        "typical": "typical of its cluster",
        "rare": "rare",
        "none": "none of these",
    },
    "striker": {"av": "the AV", "bv": "the other", "mutual": "both"},
    "side": {"front": "front", "rear": "rear", "left": "left side", "right": "right side"},
    "mechanism": {name: short for name, (short, _) in KINDS.items()},
    "crash_type": {
        "rear-end by AV": "the AV runs into a rear",
        "rear-end by BV": "the AV's rear is struck",
        "sideswipe": "the sides touch",
        "angle": "at an angle",
        "head-on": "head-on",
    },
    "fault": {"av": "the AV", "bv": "the other", "both": "both", "none": "nobody"},
    "conduct": dict(CONDUCT_WORDS),
    "conduct_side": {"none": "ahead", "left": "left", "right": "right"},
    "bv_kind": {"car": "car", "truck": "truck", "motorcycle": "motorcycle"},
    "avoidability": {
        name: name for name in ("by braking", "by steering", "by both", "by combination", "unavoidable", "undecided")
    },
    "group": {"majority": "in dense company", "minority": "apart from the others"},
}
"""Words for each name of a column with names, in the order in which they are shown."""

_LABELS = {
    "source": "where it comes from",
    "prevention": "what would have prevented it",
    "way_out": "way out for the AV",
    "often": "how often on the road",
    "role": "why look at it",
    "striker": "who struck",
    "side": "where the AV was touched",
    "mechanism": "kind of crash",
    "crash_type": "faces that met",
    "fault": "who broke a rule of RSS",
    "fault_rule": "rule of RSS broken first",
    "conduct": "what the AV did wrong",
    "bv_kind": "class of the other",
    "pc1": "first component",
    "pc2": "second component",
    "group": "company",
    "latest_any_s": "last way out, before contact",
    "weight": "crashes per test",
    "av_injury_probability": "chance of serious injury in the AV",
}
_UNIT = re.compile(r"_(mps2|mps|rad|m|s|nats)$")
_SHORT = {"av": "AV", "bv": "BV", "ttc": "TTC", "bbd": "distance", "thw": "time headway", "drac": "braking needed",
          "rss": "RSS", "pet": "PET", "nde": "natural traffic"}  # fmt: skip


def label_of(name: str) -> str:
    """Give a column a short name for people, without its unit.

    >>> label_of("impact_speed_mps"), label_of("min_ttc_front_s"), label_of("striker")
    ('impact speed', 'min TTC front', 'who struck')
    """
    if name in _LABELS:
        return _LABELS[name]
    return " ".join(_SHORT.get(word, word) for word in _UNIT.sub("", name).split("_"))
