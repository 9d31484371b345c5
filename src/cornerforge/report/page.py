"""One self-contained HTML page about a run or a library: reads artefacts, never runs the simulator."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cornerforge.analysis.conduct import CONDUCTS, NO_CONDUCT
from cornerforge.analysis.flaw import headline
from cornerforge.analysis.mechanism import MECHANISMS
from cornerforge.errors import MissingExtraError
from cornerforge.report import figures, tables, text
from cornerforge.report.artefacts import (
    Artefacts,
    Emptiness,
    Rate,
    analyse_command,
    library_artefacts,
    read_artefacts,
    read_emptiness,
)
from cornerforge.report.cases import case_data, load_scenarios
from cornerforge.report.judged import (
    FAULT_WORDS,
    CaseJudgement,
    avoided_kinds,
    conducts_in_words,
    faults_in_words,
    kind_counts,
    prevented_kinds,
    read_case_judgements,
)
from cornerforge.report.rendering import content_policy, environment, template, write_page
from cornerforge.results import Analysed
from cornerforge.results.analysis import PARTS

__all__ = ["charts_of", "write_library_report", "write_report"]

CASE_BYTES = 2_800_000
"""Room for trajectories on the page; with plotly's library (4.8 MB) the page stays below 8 MB."""
SCRIPTS = ("scene.js", "charts.js", "player.js", "animation.js")


def write_report(out: Path) -> Path:
    """Write `report.html`, which opens from disk and asks nothing from the network.

    Args:
        out: Folder that `cornerforge run --out` filled.

    Returns:
        The path of the page.

    Raises:
        FileFormatError: An artefact is missing or damaged; the message names it and what writes it again.
        MissingExtraError: jinja2 or plotly is not installed.
        OutputError: The page cannot be written.
    """
    plotly = _plotly_script()
    nothing = read_emptiness(out)
    if nothing is not None:
        return write_page(_render_nothing(nothing), out / "report.html")
    return _write(read_artefacts(out), plotly)


def write_library_report(library: Path, out: Path) -> Path:
    """Write `report.html` about the cases of one library: the same page without what only a run knows.

    Args:
        library: The library.
        out: Folder of the page, which holds the library's analysis in `analysis/`.

    Returns, Raises:
        As `write_report`.
    """
    plotly = _plotly_script()
    return _write(library_artefacts(library, out), plotly)


def _write(artefacts: Artefacts, plotly: str) -> Path:
    cases, notes = _cases(artefacts)
    return write_page(_render(artefacts, cases, notes, plotly), artefacts.out / "report.html")


def _plotly_script() -> str:
    """plotly.js as one text; its Python package ships a single bundle, with maps and 3-D."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise MissingExtraError("plotly", "report") from None
    return str(get_plotlyjs())


NATURAL = "natural/"
"""Begins the names of natural cases on the page, so that they are not taken for those of the adversary."""


@dataclass(frozen=True)
class _Shelf:
    """Cases to show from one library: why each is shown, by its name there, in reading order."""

    library: Path
    analysis: Path
    roles: dict[str, dict[str, Any]]
    crash_type: dict[str, str]
    command: str
    prefix: str = ""


def _shelves(artefacts: Artefacts) -> list[_Shelf]:
    """The libraries that cases are shown from, natural crashes first."""
    points = artefacts.points
    attack = _Shelf(
        artefacts.library,
        artefacts.analysed_in,
        _roles(artefacts),
        dict(zip(points.case_id, points.crash_type, strict=True)),
        analyse_command(artefacts.out) if artefacts.exposure is not None else artefacts.command,
    )
    found, place = artefacts.summary.natural_cases, artefacts.natural_library
    if found is None or place is None or place == artefacts.library:
        return [attack]
    kinds = {top.case_id: top.crash_type for top in found.value.top}
    command = f"cornerforge run --out {artefacts.out}"
    return [_Shelf(place, place.parent / "analysis", _natural_roles(found), kinds, command, NATURAL), attack]


def _cases(artefacts: Artefacts) -> tuple[list[dict[str, Any]], list[str]]:
    """The natural, top, typical and rare cases that fit on the page, in reading order, and notes on those that do not.

    The most telling come first, should room run out: natural ones, the top, the best typical case of each cluster, the
    rare, the others.
    """
    kept: dict[str, dict[str, Any]] = {}
    lost, left, size, shown = [], [], 0, []
    for shelf in _shelves(artefacts):
        judged = read_case_judgements(shelf.analysis, shelf.roles, shelf.command)
        ranked = sorted(shelf.roles, key=lambda case: shelf.roles[case]["rank"])
        for case_id, scenario in load_scenarios(shelf.library, ranked):
            name = shelf.prefix + case_id
            if scenario is None:
                lost.append(name)
                continue
            known = judged.get(case_id)
            data = case_data(name, scenario, known.way_out if known else None)
            role, kind = shelf.roles[case_id], shelf.crash_type.get(case_id, "")
            data |= role | {"type": kind, "verdict": _verdict(known) if known else ""}
            data["title"] = f"Case {name}: {role['role']}" + (f"; {kind}" if kind else "")
            size += len(json.dumps(data, separators=(",", ":")))
            if size > CASE_BYTES and kept:
                left.append(name)
            else:
                kept[name] = data
        shown += [kept[shelf.prefix + case] for case in shelf.roles if shelf.prefix + case in kept]
    notes = []
    if lost:
        notes.append(f"Not in the library, so not shown: {', '.join(lost)}.")
    if left:
        notes.append(f"Left out to keep the page small: {', '.join(left)}. Play them with cornerforge replay.")
    return [case | {"order": i} for i, case in enumerate(shown)], notes


def _natural_roles(found: Analysed) -> dict[str, dict[str, Any]]:
    """Say why each natural case is shown: typical of what happens most."""
    of = {case: str(cluster.id) for cluster in found.clusters for case in cluster.typical}
    shares = {} if found.natural is None else {name: kind.share for name, kind in found.natural.clusters.items()}
    roles = {}
    for top in found.value.top:
        name = of.get(top.case_id, "")
        role = f"natural, typical of {text.share(shares[name])} of them" if name in shares else "natural"
        roles[top.case_id] = {
            "group": "Natural crashes, typical of what happens most", "role": role, "rank": -2, "rare": False, "top": 0,
        }  # fmt: skip
    return roles


def _verdict(known: CaseJudgement) -> str:
    """Say whose fault a case was, and whether the AV could have avoided it."""
    if known.fault == "none":
        fault = "No rule of RSS was broken"
    else:
        who = {"av": "The AV", "bv": "The BV"}.get(known.fault, "Both")
        when = "" if known.fault_s is None else f", {known.fault_s:.1f} s before contact"
        fault = f"{who} broke a rule of RSS ({known.rule}{when})"
    fault += f".{_conduct_in_words(known)}{_prevented_in_words(known)}"
    if known.avoidability is None:
        return fault
    begun = "" if known.manoeuvre_s is None else f" The manoeuvre began {known.manoeuvre_s:.1f} s before contact."
    return f"{fault}{begun} {_way_in_words(known)}"


def _conduct_in_words(known: CaseJudgement) -> str:
    """Say what the AV did wrong in a case; "" where it did nothing wrong."""
    if known.conduct == NO_CONDUCT:
        return ""
    return f" The AV's own doing, from {known.conduct_s:.1f} s before contact: {CONDUCTS[known.conduct]}."


def _prevented_in_words(known: CaseJudgement) -> str:
    """Say which reference drivers would have prevented a case; "" where it was not judged."""
    if known.prevented_by is None:
        return ""
    if known.held_speed_prevents:
        return " To hold the speed would have been enough to prevent it."
    if known.prevented_by == "nobody":
        return " No reference driver would have prevented it."
    return f" In the AV's place it would have been prevented, by braking, by {known.prevented_by}."


_HOW = {"by both": "by braking or by steering", "by combination": "by braking and steering together"}


def _way_in_words(known: CaseJudgement) -> str:
    """Say until when the AV could have avoided a case that was searched for a way out."""
    last = "" if known.latest_s is None else f"{known.latest_s:.1f} s before contact"
    if known.avoidability == "undecided":
        return "No way out of the AV was found, but not all could be tried."
    if known.avoidability == "unavoidable":
        if known.latest_s is None:
            return "Unavoidable: the AV had no way out in the time looked at."
        foreseen = known.manoeuvre_s is not None and known.latest_s > known.manoeuvre_s
        when = "before the manoeuvre, so that it had to foresee it" if foreseen else "within its reaction time"
        return f"Unavoidable: the AV's last way out began {last}, {when}."
    how = _HOW.get(str(known.avoidability), known.avoidability)
    return f"The AV could have avoided the crash {how}" + (f"; its last way out began {last}." if last else ".")


def _roles(artefacts: Artefacts) -> dict[str, dict[str, Any]]:
    """Say why each case is shown, in reading order: typical cases by cluster, rare cases, other top cases.

    A lower rank matters more.
    """
    roles: dict[str, dict[str, Any]] = {}
    for cluster in artefacts.analysis.clusters:
        group = f"Typical of cluster {cluster.id} ({cluster.group}, {text.count(cluster.size)} cases)"
        for place, case in enumerate(cluster.typical):
            role = f"typical of cluster {cluster.id} ({cluster.group})"
            roles.setdefault(case, {"group": group, "role": role, "rank": 0 if place == 0 else 2, "rare": False})
    for case in artefacts.analysis.rare:
        if case in roles:
            role = roles[case]["role"] + " and rare"
            roles[case] |= {"role": role, "rank": min(1, roles[case]["rank"]), "rare": True}
        else:
            roles[case] = {"group": "Rare: farthest from the others first", "role": "rare", "rank": 1, "rare": True}
    for place, top in enumerate(artefacts.analysis.value.top, start=1):
        role = f"worth a look, number {place}"
        if top.case_id in roles:
            roles[top.case_id] |= {"role": f"{role}; {roles[top.case_id]['role']}", "rank": -1, "top": place}
        else:
            group = "Worth a look, neither typical nor rare"
            roles[top.case_id] = {"group": group, "role": role, "rank": -1, "rare": False, "top": place}
    return {case: {"top": 0} | role for case, role in roles.items()}


def _groups(cases: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """The shown cases by heading, in reading order."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for case in cases:
        groups.setdefault(case["group"], []).append(case)
    return groups


def _headline(artefacts: Artefacts) -> str:
    """Say what the AV does wrong; "" where the analysis is of an earlier version, which did not look."""
    natural, found = artefacts.summary.natural_cases, artefacts.analysis
    if natural is None or artefacts.natural_library == artefacts.library:
        return "" if found.own_doing is None else found.own_doing.text
    if natural.own_doing is None or found.own_doing is None:
        return ""
    return headline(natural.own_doing, found.own_doing)


def _often(found: Analysed) -> str:
    """Say how often a natural crash of the flaw happens, from what the AV did wrong; "" if none shows a flaw."""
    if found.natural is None or found.own_doing is None or not found.own_doing.flaws:
        return ""
    between = found.natural.all.miles_between / found.own_doing.flaws[0].share
    return f"Such a crash happens once in {text.miles(between)} of natural traffic."


def _ratio(adversary: Rate | None, natural: Rate | None) -> str:
    """Say how many times more often the AV crashes in a test with the adversary, and how sure that is."""
    if adversary is None or natural is None:
        return ""
    if adversary.is_bound:
        return "The adversary caused no crash, so there is no ratio."
    unit = "times as many crashes per test as natural traffic"
    if natural.is_bound:
        return (
            f"More than {text.times(adversary.interval95[0] / natural.bound)} {unit} (lower end of the yield over 3/n)."
        )
    (low, high), (natural_low, natural_high) = adversary.interval95, natural.interval95
    ends = f"from {text.times(low / natural_high)}"
    ends += f" to {text.times(high / natural_low)}" if natural_low > 0 else " upwards"
    factor = text.times(adversary.crashes_per_test / natural.crashes_per_test)
    return f"{factor} {unit} ({ends}, opposite ends of the two intervals)."


def charts_of(artefacts: Artefacts, animated: set[str]) -> dict[str, figures.Figure]:
    """Make all charts of the page by name; `animated`: ids of cases that are marked on the map if they are special."""
    analysis, summary = artefacts.analysis, artefacts.summary
    cases = sum(analysis.fault.values())
    made = {
        "fault": figures.share_figure(faults_in_words(analysis), cases, "share of all cases"),
        "rules": figures.share_figure(analysis.fault_rules, cases, "share of all cases"),
        "discovery": figures.discovery_figure(analysis.coverage),
        "types": figures.crash_type_figure(analysis),
        "map": figures.map_figure(artefacts.points, analysis, [case.case_id for case in analysis.value.top], animated),
    }
    natural = summary.natural_rate
    if summary.generate is not None:
        made["rates"] = figures.rate_figure([summary.generate, *summary.baselines], natural)
    if artefacts.training is not None and natural is not None:
        made["training"] = figures.training_figure(artefacts.training, natural)
    if analysis.own_doing is not None:
        made["own"] = figures.share_figure(conducts_in_words(analysis.own_doing), cases, "share of all cases")
    if analysis.prevented is not None:
        kinds, n = prevented_kinds(analysis.prevented), analysis.prevented.cases
        made["prevented"] = figures.share_figure(kinds, n, "share of the judged cases")
    if analysis.avoidability is not None:
        kinds, n = avoided_kinds(analysis.avoidability), analysis.avoidability.cases
        made["avoidability"] = figures.share_figure(kinds, n, "share of the cases looked at")
    exposed = {} if artefacts.exposure is None else artefacts.exposure.quantities
    return made | {f"exposure-{key}": figures.exposure_figure(h) for key, h in exposed.items()}


def _tables(artefacts: Artefacts) -> dict[str, tables.Table]:
    analysis, summary = artefacts.analysis, artefacts.summary
    cases = sum(analysis.fault.values())
    made = {
        "fault": tables.share_table("Cases by fault", "at fault", faults_in_words(analysis), cases),
        "rules": tables.share_table("Cases by the rule that was broken first", "rule", analysis.fault_rules, cases),
        "severity": tables.severity_table(analysis),
        "discovery": tables.discovery_table(analysis.coverage),
        "types": tables.crash_type_table(analysis),
        "clusters": tables.cluster_table(analysis),
        "loadings": tables.loading_table(analysis),
        "provenance": tables.provenance_table(artefacts.provenance),
    }
    rates = [summary.generate, *summary.baselines, summary.natural_rate]
    made["rates"] = tables.rate_table([rate for rate in rates if rate is not None])
    if artefacts.training is not None:
        made["training"] = tables.training_table(artefacts.training)
    if summary.natural_cases is not None and summary.natural_cases.natural is not None:
        made["natural"] = tables.natural_table(summary.natural_cases.natural)
    if analysis.own_doing is not None:
        kinds = conducts_in_words(analysis.own_doing, CONDUCTS)
        made["own"] = tables.share_table("Cases by what the AV did wrong", "what the AV did", kinds, cases)
    if analysis.prevented is not None:
        kinds, n = prevented_kinds(analysis.prevented), analysis.prevented.cases
        made["prevented"] = tables.share_table("Cases that a reference driver would have prevented", "driver", kinds, n)
    if analysis.judges is not None:
        made["reactions"] = tables.reaction_table(analysis.judges)
        made["agreement"] = tables.agreement_table(analysis.judges)
    if analysis.avoidability is not None:
        kinds, n = avoided_kinds(analysis.avoidability), analysis.avoidability.cases
        made["avoidability"] = tables.share_table("Cases looked at", "avoidability", kinds, n)
    exposed = {} if artefacts.exposure is None else artefacts.exposure.quantities
    return made | {f"exposure-{key}": tables.exposure_table(h) for key, h in exposed.items()}


def _render_nothing(nothing: Emptiness) -> str:
    """Render the page of a run that found no case: what was tried, and what that says."""
    pages = environment()
    from markupsafe import Markup

    return str(
        pages.get_template("nothing.html.j2").render(
            run=nothing.summary,
            provenance=tables.provenance_table(nothing.provenance),
            style=Markup(template("report.css")),
            policy=content_policy([]),
        )
    )


def _render(artefacts: Artefacts, cases: list[dict[str, Any]], notes: list[str], plotly: str) -> str:
    pages = environment()
    from markupsafe import Markup

    kinds = kind_counts(artefacts.analysis.coverage)
    scripts = [plotly, *(template(name) for name in SCRIPTS)]
    page: str = pages.get_template("report.html.j2").render(
        run=artefacts.summary,
        analysis=artefacts.analysis,
        exposure=artefacts.exposure,
        preset="" if artefacts.training is None else artefacts.training.preset,
        natural=None if artefacts.summary.natural_cases is None else artefacts.summary.natural_cases.natural,
        natural_library=artefacts.natural_library,
        folder=artefacts.out,
        library=artefacts.library,
        prefix="" if artefacts.natural_library == artefacts.library else NATURAL,
        mechanisms=MECHANISMS,
        fault_words=FAULT_WORDS,
        parts=PARTS,
        played={case["id"] for case in cases},
        kinds=kinds,
        coverage=tables.coverage_rows(artefacts.analysis.coverage.axes, kinds),
        headline=_headline(artefacts),
        often=_often(artefacts.summary.natural_cases or artefacts.analysis),
        ratio=_ratio(artefacts.summary.generate, artefacts.summary.natural_rate),
        figures=charts_of(artefacts, {case["id"] for case in cases}),
        tables=_tables(artefacts),
        cases=cases,
        groups=_groups(cases),
        notes=notes,
        # Marked as safe are our own files and plotly's, nothing else.
        style=Markup(template("report.css")),
        scripts=[Markup(script) for script in scripts],
        policy=content_policy(scripts),
    )
    return page
