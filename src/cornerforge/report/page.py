"""One self-contained HTML page about a run or a library: reads artefacts, never runs the simulator."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cornerforge.analysis.conduct import CONDUCTS
from cornerforge.analysis.in_words import what_happened
from cornerforge.analysis.site_case import case_of
from cornerforge.errors import MissingExtraError
from cornerforge.experiment.roads import road_in_words
from cornerforge.experiment.sites import site_in_words
from cornerforge.library import CaseLibrary
from cornerforge.report import figures, tables, text
from cornerforge.report.artefacts import (
    Artefacts,
    Emptiness,
    analyse_command,
    library_artefacts,
    read_artefacts,
    read_emptiness,
)
from cornerforge.report.cases import BEFORE_S, case_data, load_scenarios, unseen_s
from cornerforge.report.front import Front, Known, Look, front_of, how_often
from cornerforge.report.judged import (
    FAULT_WORDS,
    PREVENTION_WORDS,
    avoided_kinds,
    conducts_in_words,
    faults_in_words,
    kind_counts,
    prevented_kinds,
    read_case_judgements,
    verdict,
)
from cornerforge.report.kinds import kind_in_words
from cornerforge.report.natural_cases import read_natural_cases
from cornerforge.report.rendering import PLAYER, content_policy, environment, template, write_page
from cornerforge.report.road import on_road, road_rate
from cornerforge.results import Analysed
from cornerforge.results.analysis import PARTS, Natural
from cornerforge.results.rates import Counted
from cornerforge.sim import NO_VEHICLE
from cornerforge.types import Scenario

__all__ = ["charts_of", "known_of", "write_library_report", "write_report"]

_LOOKED_AT = 300
"""Cases of which the first screen says what the AV saw, at most."""
CASE_BYTES = 2_800_000
"""Room for trajectories on the page; with plotly's library (4.8 MB) and the map of cases the page stays below 10 MB."""


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
    known = known_of(artefacts)
    front = front_of(known)
    cases, notes = _cases(artefacts, front.look)
    return write_page(_render(artefacts, known, front, cases, notes, plotly), artefacts.out / "report.html")


def known_of(artefacts: Artefacts) -> Known:
    """Gather what the first screen is made of."""
    natural, place, road = artefacts.summary.natural_cases, artefacts.natural_library, road_rate(artefacts.summary)
    kinds: Natural | None = None
    cases = None
    if natural is not None and place is not None:
        mine = place == artefacts.library
        folder = artefacts.analysed_in if mine else place.parent / "analysis"
        command = artefacts.command if mine else f"cornerforge run --out {artefacts.out}"
        cases = read_natural_cases(place, folder, command)
        if natural.natural is not None and road is not None:
            kinds = on_road(natural.natural, road)
    unseen = _unseen(artefacts.library if place is None else place, natural=place is not None)
    at_site = CaseLibrary.open(artefacts.library).odd.site is not None
    made = artefacts.summary.generate is not None
    return Known(artefacts.analysis, natural, kinds, cases, road, made, unseen, at_site)


def _unseen(library: Path, *, natural: bool) -> str:
    """Say in how many crashes the AV had lost sight of the other shortly before, at a site behind what; "" in none."""
    store = CaseLibrary.open(library)
    if store.odd.perception is None and store.odd.site is None:
        return ""
    ids = store.scalars(["case_id"])["case_id"].to_pylist()[:_LOOKED_AT]
    looked = [one for _, one in load_scenarios(library, ids) if one is not None]
    of = f" of n = {text.count(len(looked))} {'natural crashes' if natural else 'crashes'} that were looked at"
    if store.odd.site is not None:
        out = [case for case in map(case_of, looked) if case.came_out[0] != NO_VEHICLE]
        if not out:
            return ""
        n, stood = text.count(len(out)), text.count(sum(case.hider_stood for case in out))
        return f" In {n}{of} the other came out from behind a vehicle shortly before, in {stood} behind one that stood."
    lost = sum(unseen_s(one) > 0.0 for one in looked)
    if not lost:
        return ""
    return f" In {text.count(lost)}{of} it did not see the other vehicle for some of the last {BEFORE_S:g} s."


def _plotly_script() -> str:
    """plotly.js as one text; its Python package ships a single bundle, with maps and 3-D."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise MissingExtraError("plotly", "report") from None
    return str(get_plotlyjs())


NATURAL = "natural/"
"""Beginning of the names of natural cases on the page; the adversary's cases have none."""


@dataclass(frozen=True)
class _Shelf:
    """Cases to show from one library: why each is shown, by its name there, in reading order."""

    library: Path
    analysis: Path
    roles: dict[str, dict[str, Any]]
    crash_type: dict[str, str]
    command: str
    is_natural: bool
    prefix: str = ""


def _shelves(artefacts: Artefacts, look: Look | None) -> list[_Shelf]:
    """The libraries that cases are shown from, natural crashes first; one of them holds the case to watch first."""
    points = artefacts.points
    attack = _Shelf(
        artefacts.library,
        artefacts.analysed_in,
        _roles(artefacts),
        dict(zip(points.case_id, points.crash_type, strict=True)),
        analyse_command(artefacts.out) if artefacts.exposure is not None else artefacts.command,
        artefacts.analysis.natural is not None,
    )
    found, place = artefacts.summary.natural_cases, artefacts.natural_library
    if found is None or place is None or place == artefacts.library:
        _watch_first(attack, look)
        return [attack]
    kinds = {top.case_id: top.crash_type for top in found.value.top}
    command = f"cornerforge run --out {artefacts.out}"
    shelf = _Shelf(place, place.parent / "analysis", _natural_roles(found), kinds, command, True, NATURAL)
    _watch_first(shelf if look is not None and look.is_natural else attack, look)
    return [shelf, attack]


def _watch_first(shelf: _Shelf, look: Look | None) -> None:
    """Give the case to watch first a place on the page before all others."""
    if look is None:
        return
    role = {"role": "to watch first", "rare": False, "top": 0} | shelf.roles.pop(look.case_id, {})
    role |= {"group": "To watch first", "rank": -3, "watchFirst": True}
    others = dict(shelf.roles)
    shelf.roles.clear()
    shelf.roles.update({look.case_id: role, **others})


def _cases(artefacts: Artefacts, look: Look | None) -> tuple[list[dict[str, Any]], list[str]]:
    """The natural, top, typical and rare cases that fit on the page, in reading order, and notes on those that do not.

    The most important come first, in case room runs out: natural ones, the top, the best typical case of each cluster,
    the rare, the others.
    """
    kept: dict[str, dict[str, Any]] = {}
    lost, left, size, shown = [], [], 0, []
    for shelf in _shelves(artefacts, look):
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
            data |= {"watchFirst": False} | role | {"type": text.plain(kind), "title": _title(scenario, kind)}
            unseen = unseen_s(scenario)
            blind = f" For {unseen:g} s of the last {BEFORE_S:g} s the AV did not see the other." if unseen else ""
            data["verdict"] = text.plain(verdict(known) + blind) if known else blind
            if shelf.is_natural:  # no vehicle is controlled
                data |= {"critical": [], "action": [], "p_nde": []}
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


def _title(scenario: Scenario, kind: str) -> str:
    """Say what happens in a case."""
    happened = kind or "Crash" if scenario.crash is None else what_happened(scenario)
    return text.capital(text.plain(text.sentence(happened)))


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


def _roles(artefacts: Artefacts) -> dict[str, dict[str, Any]]:
    """Say why each case is shown, in reading order: typical cases by cluster, rare cases, other top cases.

    A lower rank matters more.
    """
    roles: dict[str, dict[str, Any]] = {}
    of = f"{text.count(artefacts.analysis.cases)} that the adversary caused"
    if artefacts.summary.generate is None:
        of = f"{text.count(artefacts.analysis.cases)} cases"
    for cluster in artefacts.analysis.clusters:
        most = max(cluster.crash_types, key=lambda name: cluster.crash_types[name], default="crash")
        group = f"Cluster {cluster.id}: mostly {text.plain(most)} ({text.count(cluster.size)} of {of})"
        for place, case in enumerate(cluster.typical):
            role = f"typical of cluster {cluster.id}"
            roles.setdefault(case, {"group": group, "role": role, "rank": 0 if place == 0 else 2, "rare": False})
    for case in artefacts.analysis.rare:
        if case in roles:
            role = roles[case]["role"] + " and rare"
            roles[case] |= {"role": role, "rank": min(1, roles[case]["rank"]), "rare": True}
        else:
            roles[case] = {"group": "Rare: farthest from the others first", "role": "rare", "rank": 1, "rare": True}
    road = artefacts.analysis.purpose == "road"
    for place, top in enumerate(artefacts.analysis.value.top, start=1):
        role = f"number {place} to look at" if road else f"number {place} by value"
        if top.case_id in roles:
            roles[top.case_id] |= {"role": f"{role}; {roles[top.case_id]['role']}", "rank": -1, "top": place}
        else:
            roles[top.case_id] = {
                "group": "Others to look at" if road else "Others of high value",
                "role": role,
                "rank": -1,
                "rare": False,
                "top": place,
            }
    return {case: {"top": 0} | role for case, role in roles.items()}


def _looked_at(look: Look | None, cases: list[dict[str, Any]]) -> dict[str, Any] | None:
    """The case to watch first, as the page plays it; None if its recording is not there."""
    return None if look is None else next((case for case in cases if case["watchFirst"]), None)


def _groups(cases: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """The shown cases by heading, in reading order."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for case in cases:
        groups.setdefault(case["group"], []).append(case)
    return groups


def _ratio(adversary: Counted | None, natural: Counted | None) -> str:
    """Say how many times more often the AV crashes in a test with the adversary, and how sure that is."""
    if adversary is None or natural is None:
        return ""
    if adversary.is_bound:
        return "The adversary caused no crash, so there is no ratio."
    unit = "times as many crashes per drive as natural traffic"
    if natural.is_bound:
        least = text.rounded_down(adversary.interval95[0] / natural.bound)
        return f"At least {text.times(least)} {unit} (lower end of the one interval over the upper end of the other)."
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
        "fault": figures.share_figure(faults_in_words(analysis), cases, "share of cases"),
        "rules": figures.share_figure(analysis.fault_rules, cases, "share of cases"),
        "discovery": figures.discovery_figure(analysis.coverage),
        "types": figures.share_figure(_types(analysis), sum(analysis.crash_types.values()), "share of cases"),
        "map": figures.map_figure(artefacts.points, analysis, [case.case_id for case in analysis.value.top], animated),
    }
    natural = summary.natural_rate
    if summary.generate is not None:
        made["rates"] = figures.rate_figure(summary.rates)
    if artefacts.training is not None and natural is not None:
        made["training"] = figures.training_figure(artefacts.training, natural)
    if analysis.own_doing is not None:
        made["own"] = figures.share_figure(conducts_in_words(analysis.own_doing), cases, "share of cases")
    if analysis.prevented is not None:
        kinds, n = prevented_kinds(analysis.prevented), analysis.prevented.cases
        made["prevented"] = figures.share_figure(kinds, n, "share of cases")
    if analysis.avoidability is not None:
        kinds, n = avoided_kinds(analysis.avoidability), analysis.avoidability.cases
        made["avoidability"] = figures.share_figure(kinds, n, "share of cases")
    exposed = {} if artefacts.exposure is None else artefacts.exposure.quantities
    return made | {f"exposure-{key}": figures.exposure_figure(h) for key, h in exposed.items()}


def _types(analysis: Analysed) -> dict[str, int]:
    """Cases by crash type in plain words, most first."""
    ordered = sorted(analysis.crash_types.items(), key=lambda item: -item[1])
    return {text.plain(name): n for name, n in ordered}


def _tables(artefacts: Artefacts, natural: Natural | None) -> dict[str, tables.Table]:
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
    made["rates"] = tables.rate_table(summary.rates)
    if artefacts.training is not None:
        made["training"] = tables.training_table(artefacts.training)
    if natural is not None:
        made["natural"] = tables.natural_table(natural)
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
    road = road_rate(nothing.summary)
    from markupsafe import Markup

    return str(
        pages.get_template("nothing.html.j2").render(
            run=nothing.summary,
            road=road,
            often=how_often(road, None, adversary=True),
            provenance=tables.provenance_table(nothing.provenance),
            style=Markup(template("report.css")),
            policy=content_policy([]),
        )
    )


def _render(
    artefacts: Artefacts, known: Known, front: Front, cases: list[dict[str, Any]], notes: list[str], plotly: str
) -> str:
    pages = environment()
    from markupsafe import Markup

    kinds, odd = kind_counts(artefacts.analysis.coverage), CaseLibrary.open(artefacts.library).odd
    scripts = [plotly, template(PLAYER)]
    page: str = pages.get_template("report.html.j2").render(
        run=artefacts.summary,
        analysis=artefacts.analysis,
        exposure=artefacts.exposure,
        preset="" if artefacts.training is None else artefacts.training.preset,
        natural=known.kinds,
        road=known.road,
        place=site_in_words(odd) or road_in_words(odd),
        at_site=odd.site is not None,
        perceives=odd.perception is not None,
        front=front,
        look=_looked_at(front.look, cases),
        natural_library=artefacts.natural_library,
        folder=artefacts.out,
        library=artefacts.library,
        prefix="" if artefacts.natural_library == artefacts.library else NATURAL,
        kind_in_words=kind_in_words,
        fault_words=FAULT_WORDS,
        prevention_words=PREVENTION_WORDS,
        parts=PARTS,
        played={case["id"] for case in cases},
        kinds=kinds,
        coverage=tables.coverage_rows(artefacts.analysis.coverage.axes, kinds),
        ratio=_ratio(artefacts.summary.generate, artefacts.summary.natural_rate),
        figures=charts_of(artefacts, {case["id"] for case in cases}),
        tables=_tables(artefacts, known.kinds),
        cases=cases,
        groups=_groups(cases),
        notes=notes,
        # Marked as safe are our own files and plotly's, nothing else.
        style=Markup(template("report.css")),
        scripts=[Markup(script) for script in scripts],
        policy=content_policy(scripts),
    )
    return page
