"""`ndd show` prints a naturalistic model's key numbers and draws figures of its tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from cornerforge._options import verb
from cornerforge.experiment.output import open_output, write_json
from cornerforge.ext.calibrate.options import NddShow
from cornerforge.ndd.model import default_model_path, load_model, model_hash
from cornerforge.results import NddShown, from_json
from cornerforge.results.naturalistic import (
    ShownCounts,
    ShownFollowing,
    ShownFreeFlow,
    ShownInitial,
    ShownLaneChanges,
    ShownOrigin,
    ShownSupport,
)

__all__ = ["ndd_show", "show_text"]


@verb(NddShow)
def ndd_show(options: NddShow) -> NddShown:
    """Key numbers of a model and, where a folder is named, figures of its tables.

    Returns:
        What `cornerforge ndd show --json` prints.

    Raises:
        MissingExtraError: Figures are wanted, and matplotlib is not installed.
        CornerForgeError: The model cannot be read, or the folder not be written.
    """
    from cornerforge.ext.calibrate.shown import key_numbers

    path = default_model_path() if options.model is None else Path(options.model)
    loaded = load_model(path)
    numbers = {"model": str(path), "model_hash": model_hash(loaded), **key_numbers(loaded)}
    shown = from_json(NddShown, {**numbers, "figures": []})
    if options.out is not None:
        from cornerforge.ext.calibrate.show_figures import check_matplotlib, draw_figures

        check_matplotlib()  # fails before anything is written
        folder = Path(options.out)
        identity = {"command": "ndd show", "model": shown.model_hash}
        open_output(folder, identity, resume=True)
        options.progress("show: drawing", 0, 1)
        figures = tuple(str(figure) for figure in draw_figures(loaded, folder))
        write_json(folder / "numbers.json", numbers)
        shown = replace(shown, figures=figures)
    return shown


def show_text(result: NddShown) -> str:
    """Tell the result of `ndd_show` in text."""
    return "\n".join(
        [
            f"Model {result.model_hash} ({result.model})",
            *_origin_lines(result.provenance, result.counted),
            *_following_lines(result.following),
            *_support_lines(result.support),
            *_free_lines(result.free_flow),
            *_lane_change_lines(result.lane_change),
            "Memory of followers: "
            + ", ".join(f"{name} {value:g}" for name, value in result.memory.items())
            + f"; free drivers are pulled to their desired speed by {result.free_flow.pull_per_s:g} m/s2 per m/s",
            *_initial_lines(result.initial),
            *(f"Figure: {name}" for name in result.figures),
        ]
    )


def _origin_lines(origin: ShownOrigin, counted: ShownCounts | None) -> list[str]:
    lines = [f"From: {origin.attribution or 'not stated'}; {', '.join(map(str, origin.files)) or 'no files named'}"]
    lines += [f"Licence: {origin.licence or 'not stated'}"]
    if counted is None:
        return [*lines, "Counted decisions: not stated."]
    share = counted.data_share_of_states
    weight = "" if share is None else f"; {share:.3%} of the table is data, the rest prior"
    lines.append(
        f"Counted: {counted.following_decisions:,} decisions in {counted.following_states:,} of "
        f"{counted.following_states_total:,} following states{weight}"
    )
    return lines


def _following_lines(following: ShownFollowing) -> list[str]:
    lines = ["Following: mean (sd) of acceleration [m/s2]; across: range rate [m/s], negative closing; down: gap [m]"]
    for i, speed in enumerate(following.speed_mps):
        lines.append(f"{speed:>4g} m/s" + "".join(f"{rate:>14g}" for rate in following.range_rate_mps))
        for j, gap in enumerate(following.gap_m):
            means, sds = following.mean_mps2[i][j], following.sd_mps2[i][j]
            cells = (f"{mean:.2f} ({sd:.2f})" for mean, sd in zip(means, sds, strict=True))
            lines.append(f"{gap:>8g}" + "".join(f"{cell:>14}" for cell in cells))
    return lines


def _support_lines(support: ShownSupport) -> list[str]:
    return [
        f"Possible accelerations, of 31: following {support.following_possible_min} to "
        f"{support.following_possible_max} (mean {support.following_possible_mean:.1f}; one only in "
        f"{support.following_states_with_one:,} states), free {support.free_possible_min} to "
        f"{support.free_possible_max}; hardest braking in "
        f"{support.following_states_that_allow_hardest_braking:.1%} of following states"
    ]


def _free_lines(free: ShownFreeFlow) -> list[str]:
    lines = ["Free flow, model (published): mean, sd [m/s2], share at or below -1 m/s2"]
    for fact in free.published:
        i = free.speed_mps.index(fact.speed_mps)
        low, high = fact.mean_mps2
        lines.append(
            f"{fact.speed_mps:>4g} m/s  {free.mean_mps2[i]:.3f} ({low:g} to {high:g})  "
            f"{free.sd_mps2[i]:.2f} ({fact.sd_mps2:g})  "
            f"{free.share_braking_1_mps2[i]:.2%} ({fact.share_braking_1_mps2:.1%})"
        )
    return lines


def _lane_change_lines(change: ShownLaneChanges) -> list[str]:
    low, high = change.base_per_decision_and_side

    def row(name: str, values: Iterable[float | None], without: str = "none") -> str:
        return f"{name:<34}" + "".join(f"{without if value is None else format(value, 'g'):>8}" for value in values)

    nearest = change.gap_m.index(30.0)
    median = change.duration_median_s
    lasting = "as long as the ODD says" if median is None else f"{median:g} s in the median"
    return [
        f"Lane changes: base chance {low:.4g} to {high:.4g} per decision and side, without a leader times "
        f"{change.desire_free:g}; overlooked: {change.overlook:g}, conflict {change.overlook_conflict:g}",
        row("range rate [m/s]", change.range_rate_mps),
        row("desire, leader at 30 m", [round(value, 2) for value in change.desire[nearest]]),
        row("gap ahead accepted by half [m]", change.gap_accepted_half_lead_m, ">115"),
        row("gap behind accepted by half [m]", change.gap_accepted_half_rear_m, ">115"),
        row("turns back at gaps up to [m]", change.gap_turned_back_for_m),
        f"They take {lasting}; {change.signal_share:.0%} of drivers announce them. Looking away: "
        f"{change.away_per_second:g} a second, again {change.away_again:g}",
    ]


def _initial_lines(initial: ShownInitial) -> list[str]:
    speed = initial.speed_mps
    lines = [
        f"Start: speed {speed.mean:.2f} m/s (sd {speed.sd:.2f}), {initial.follow_share:.3f} follow, "
        f"range rate sd {initial.range_rate_sd_mps:.2f} m/s; 5 25 50 75 95 %, model (published):"
    ]
    for name, unit, of in (("speed", "m/s", speed), ("gap", "m", initial.gap_m), ("time_gap", "s", initial.time_gap_s)):
        pairs = (f"{value:.3g} ({of.published[key]:g})" for key, value in of.quantiles.items())
        lines.append(f"  {name:<9}[{unit}]: " + "  ".join(pairs))
    return lines
