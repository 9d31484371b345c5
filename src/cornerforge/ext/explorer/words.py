"""Plain words for the names that files use: for people who see a crash for the first time."""

from __future__ import annotations

from cornerforge.analysis.conduct import IN_SHORT
from cornerforge.report.judged import PREVENTION_WORDS
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
    "conduct": dict(IN_SHORT),
    "conduct_side": {"none": "ahead", "left": "left", "right": "right"},
    "bv_kind": {"car": "car", "truck": "truck", "motorcycle": "motorcycle"},
    "avoidability": {
        name: name for name in ("by braking", "by steering", "by both", "by combination", "unavoidable", "undecided")
    },
    "group": {"majority": "in dense company", "minority": "apart from the others"},
}
"""Words for each name of a column with names, in the order in which they are shown."""

_LABELS = {
    "source": "where it comes from", "case_id": "case", "seed": "seed", "test": "test", "policy": "policy",
    "history": "the last second", "critical_bv_action": "actions of the attacker",
    "trajectory_digest": "digest of the recording",
    "prevention": "what would have prevented it", "way_out": "way out for the AV", "often": "how often on the road",
    "role": "why look at it", "striker": "who struck", "side": "where the AV was touched",
    "mechanism": "kind of crash", "crash_type": "faces that met", "conduct": "what the AV did wrong",
    "conduct_s": "when it did so, before contact", "conduct_side": "side of the other then",
    "manoeuvre": "what led to it", "manoeuvre_begin_s": "when that began, before contact",
    "at_start": "soon after the start", "crash_time_s": "time of contact", "duration_s": "length of the test",
    "n_decisions": "decisions", "n_vehicles": "vehicles",
    "fault": "who broke a rule of RSS", "fault_rule": "rule of RSS broken first",
    "fault_s": "when it was broken, before contact",
    "av_rule": "rule of RSS broken by the AV", "av_fault_s": "when the AV broke it, before contact",
    "bv_rule": "rule of RSS broken by the other", "bv_fault_s": "when the other broke it, before contact",
    "blame_axis": "direction of the danger", "blame_s": "how long the danger lasted",
    "blame_from_start": "in danger from the start",
    "pc1": "first component", "pc2": "second component", "group": "company", "cluster": "cluster",
    "impact_speed_mps": "impact speed", "impact_speed_difference_mps": "difference of speeds at contact",
    "impact_angle_rad": "angle between the two at contact", "relative_heading_rad": "heading of the other",
    "relative_lane": "lane of the other", "relative_lat_m": "the other to the left of the AV",
    "relative_lon_m": "the other ahead of the AV",
    "av_speed_mps": "speed of the AV", "bv_speed_mps": "speed of the other", "av_lane": "lane of the AV",
    "av_delta_v_mps": "delta-v of the AV", "bv_delta_v_mps": "delta-v of the other",
    "av_force_direction_rad": "direction of the force on the AV",
    "bv_force_direction_rad": "direction of the force on the other",
    "av_injury_probability": "chance of serious injury in the AV",
    "bv_injury_probability": "chance of serious injury in the other",
    "av_max_acceleration_mps2": "hardest acceleration of the AV", "av_max_braking_mps2": "hardest braking of the AV",
    "av_max_lateral_acceleration_mps2": "hardest sideways acceleration of the AV",
    "bv_max_acceleration_mps2": "hardest acceleration of the other",
    "bv_max_braking_mps2": "hardest braking of the other",
    "bv_max_lateral_acceleration_mps2": "hardest sideways acceleration of the other",
    "bv_kind": "class of the other", "bv_length_m": "length of the other", "bv_width_m": "width of the other",
    "bv_slot": "number of the other",
    "avoidability": "ways out", "avoidability_exhaustive": "all ways out tried",
    "avoidability_problem": "why no way out was looked for",
    "latest_any_s": "last way out, before contact", "latest_braking_s": "last way out by braking, before contact",
    "latest_steering_s": "last way out by steering, before contact", "time_to_react_s": "time to react",
    "prevented_by": "reference drivers that prevent it", "held_speed_prevents": "prevented by holding the speed",
    "min_ttc_s": "least TTC", "min_ttc_front_s": "least TTC ahead", "min_ttc_rear_s": "least TTC behind",
    "min_thw_front_s": "least time headway ahead", "min_thw_rear_s": "least time headway behind",
    "min_bbd_front_m": "least distance ahead", "min_bbd_rear_m": "least distance behind",
    "max_drac_front_mps2": "most braking needed ahead", "max_drac_rear_mps2": "most braking needed behind",
    "min_rss_margin_m": "least RSS margin", "min_rss_margin_front_m": "least RSS margin ahead",
    "min_rss_margin_rear_m": "least RSS margin behind",
    "rss_margin_1s_m": "RSS margin 1 s before contact", "bbd_1s_m": "distance 1 s before contact",
    "ttc_1s_s": "TTC 1 s before contact", "pet_s": "post-encroachment time",
    "weight": "crashes per test", "log_prob_nde": "ln probability in natural traffic",
    "log_prob_policy": "ln probability under the policy",
    "shortfall_nats": "less likely than the likeliest", "possible_shortfall_nats": "the same of possible actions",
    "excess_nats": "less likely than expected", "n_impossible": "impossible actions",
    "n_implausible": "actions of no driver", "physically_plausible": "physically plausible",
    "value": "value", "value_own_doing": "value: own doing", "value_avoidability": "value: time to react",
    "value_severity": "value: severity", "value_novelty": "value: novelty",
}  # fmt: skip
_OF_DRIVERS = {"least_ttc": "least TTC of", "braking": "hardest braking of"}
"""Columns for each reference driver."""


def label_of(name: str) -> str:
    """Give a column a short name for people, without its unit.

    >>> label_of("min_ttc_front_s"), label_of("least_ttc_cc_human_s"), label_of("striker")
    ('least TTC ahead', 'least TTC of cc-human', 'who struck')
    """
    if name in _LABELS:
        return _LABELS[name]
    for kind, words in _OF_DRIVERS.items():
        if name.startswith(f"{kind}_"):
            return f"{words} {name.removeprefix(f'{kind}_').rpartition('_')[0].replace('_', '-')}"
    return name.replace("_", " ")
