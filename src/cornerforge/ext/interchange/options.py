"""Options of cases out to other people's tools, and in from them: `export`, `import`, `cases from-data`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, Resumable, Seeded, Watched
from cornerforge._schema import meant
from cornerforge.verbs.options.cases import CASES, LIBRARY
from cornerforge.world_options import AvAloneOptions

__all__ = ["COMMANDS", "Export", "FromData", "ImportCases"]

_FORMATS = ("openscenario", "commonroad", "osi", "mcap", "csv", "parquet", "rerun", "json")
_CASES_OUT = meant("Folder for case files and library, new or empty.")
_IN_SEAT = meant(
    "The AV in the seat: recorded (whatever was in it), a built-in AV, or your own as for run.",
    metavar="AV", near=("recorded",),
)  # fmt: skip


class Export(Resumable, Watched):
    """Write cases for other tools: OpenSCENARIO with OpenDRIVE, CommonRoad, OSI traces, tables, rerun."""

    library: Annotated[Path | str, LIBRARY] = field(kw_only=False)
    cases: Annotated[Sequence[str] | str, CASES] = field(kw_only=False)
    to: Annotated[str, meant(f"One of {', '.join(_FORMATS)}.", metavar="FORMAT", near=_FORMATS)]
    out: Annotated[Path | str, meant("Folder for the files, new or empty.")]
    version: Annotated[str, meant("Of OpenSCENARIO: 1.0 to 1.3.", near=("1.0", "1.1", "1.2", "1.3"))] = "1.2"
    mode: Annotated[
        str,
        meant(
            "recorded: all move as recorded; controller: yours drives the AV (in CommonRoad a planning problem), the "
            "others as recorded; relative (OpenSCENARIO): the partner's manoeuvre begins at the recorded time gap.",
            metavar="recorded|controller|relative", near=("recorded", "controller", "relative"),
        ),
    ] = "recorded"  # fmt: skip


class ImportCases(AvAloneOptions, Seeded, Watched):
    """Read scenarios of other tools as cases, and drive an AV through them."""

    files: Annotated[
        Sequence[Path | str] | Path | str,
        meant(
            "OSI traces (.osi, .mcap), CommonRoad (.xml), tables (.csv, .parquet); OpenSCENARIO (.xosc), which esmini "
            "plays if it is installed.",
            metavar="FILE...",
        ),
    ] = field(kw_only=False)
    out: Annotated[Path | str, _CASES_OUT]
    av: Annotated[str, _IN_SEAT] = "recorded"
    ego: Annotated[
        str | None,
        meant(
            "Vehicle in the AV's seat: its name or number. By default the trace's host vehicle or Ego, in CommonRoad "
            "the planning problem's."
        ),
    ] = None
    road: Annotated[
        Path | str | None,
        meant("OpenDRIVE road (.xodr) of OSI traces; by default the one that lies beside, or where traffic drives."),
    ] = None
    play_seconds: Annotated[
        float, meant("How long esmini may take to play a scenario.", low=0.1, high=86_400.0, unit="s")
    ] = 60.0


class FromData(AvAloneOptions, Seeded, Watched):
    """Make cases of the most critical moments of recorded traffic, and drive an AV through them."""

    files: Annotated[
        Sequence[Path | str] | Path | str,
        meant("Trajectories of all vehicles: highD, NGSIM, TGSIM, or tracks with lanes.", metavar="FILE..."),
    ] = field(kw_only=False)
    out: Annotated[Path | str, _CASES_OUT]
    av: Annotated[str, _IN_SEAT] = "recorded"
    cases: Annotated[int, meant("How many cases at most.")] = 50
    measure: Annotated[
        str,
        meant(
            "What is critical: deceleration needed, time to collision, time headway, time to a contact.",
            metavar="drac|ttc|thw|contact", near=("drac", "ttc", "thw", "contact"),
        ),
    ] = "drac"  # fmt: skip
    before: Annotated[float, meant("Seconds before the moment.")] = 5.0
    after: Annotated[float, meant("Seconds after it.")] = 3.0
    data_format: Annotated[
        str | None, meant("Format of the files; by default their columns tell.", name="--format")
    ] = None


_ROAD = meant("on-ramp and the like, or a file of `road import`.", metavar="NAME|FILE")


class RoadImport(Watched):
    """Take roads in a row of an OpenDRIVE file or a SUMO network: curves, lanes that begin and end, speed limits."""

    file: Annotated[
        Path | str, meant("OpenDRIVE 1.4 to 1.8, or a SUMO network (.net.xml, .net.xml.gz).", metavar="FILE")
    ] = field(kw_only=False)
    out: Annotated[Path | str, meant("New road file, .json.")]
    road: Annotated[
        str | None, meant("Ids of roads or edges that follow each other, with commas. By default the longest chain.")
    ] = None
    begin: Annotated[float, meant("From which s of it.", name="--from", low=0.0, high=1e6, unit="m")] = 0.0
    end: Annotated[float | None, meant("To which s of it; by default to its end.", name="--to", low=0.0, high=1e6)] = (
        None
    )
    against: Annotated[
        bool, meant("OpenDRIVE: against the reference line of the road, or of the longest one of the chain.")
    ] = False


class RoadCheck(Watched):
    """Look whether a road can be driven; exit status 1 if not."""

    road: Annotated[Path | str, _ROAD] = field(kw_only=False)


class RoadShow(Watched):
    """Say how a road lies, lane by lane; draw it with --out."""

    road: Annotated[Path | str, _ROAD] = field(kw_only=False)
    out: Annotated[Path | str | None, meant("New picture, .png or .svg.")] = None


_SITE = meant(
    "mcity-signal, mcity-crossing, mcity-two-lanes, mcity-roundabout, or a file of `site import`.", metavar="NAME|FILE"
)


class SiteImport(Watched):
    """Take junctions of a SUMO network as one site: routes, right of way, signals, crosswalks."""

    file: Annotated[Path | str, meant("SUMO network (.net.xml, .net.xml.gz).", metavar="FILE")] = field(kw_only=False)
    junction: Annotated[
        str, meant("Id of the junction; with commas of several, as of a roundabout, which are one site.")
    ]
    out: Annotated[Path | str, meant("New site file, .json.")]
    reach: Annotated[float, meant("Routes lead so far before and behind it, where lanes do.", "m", 10, 300)] = 100.0
    approach: Annotated[
        float | None, meant("Lead lanes straight back to begin so far before their stop lines.", "m", 10, 300)
    ] = None
    limit: Annotated[
        float | None, meant("One speed limit for all routes, in place of those of the file.", "km/h", 5, 130)
    ] = None
    over: Annotated[
        bool, meant("Lead them back over other junctions too, by the only way or straight on; the notes name those.")
    ] = False
    mend_amber: Annotated[
        bool, meant("Give a green that ends without amber one, where others have theirs; the site's notes name it.")
    ] = False
    mend_entries: Annotated[
        bool, meant("Where two routes meet and neither yields, let the one that has just entered; the notes name it.")
    ] = False


class SiteCheck(Watched):
    """Look whether a site is sound: smooth routes, a zone for each crossing, priorities, signals; status 1 if not."""

    site: Annotated[Path | str, _SITE] = field(kw_only=False)


class SiteShow(Watched):
    """Say what a site has, route by route; draw it with --out."""

    site: Annotated[Path | str, _SITE] = field(kw_only=False)
    out: Annotated[Path | str | None, meant("New picture, .png or .svg.")] = None


COMMANDS = (
    Command(
        Export, "ext.interchange.export:export", "ext.interchange.export:export_text",
        (
            "cornerforge export out/demo/library 0:0 --to openscenario --out out/xosc",
            "cornerforge export out/demo/library all --to commonroad --out out/commonroad",
        ),
    ),
    Command(
        ImportCases, "ext.interchange.import_cases:import_cases", "ext.interchange.import_cases:import_text",
        (
            "cornerforge import cut_in.osi --road motorway.xodr --out out/imported",
            "cornerforge import USA_US101-*.xml --av my_av.py:MyAv --out out/us101",
        ),
        name="import",
    ),
    Command(
        FromData, "ext.interchange.from_data:cases_from_data", "ext.interchange.from_data:from_data_text",
        ("cornerforge cases from-data trajectories.csv --out out/moments",), name="cases from-data",
    ),
    Command(
        RoadImport, "ext.interchange.roads:road_import", "ext.interchange.roads:road_text",
        (
            "cornerforge road import m.xodr --road 12,13 --to 1400 --out m.json",
            "cornerforge road import city.net.xml.gz --road on,over,off --out ring.json",
        ),
        name="road import",
    ),
    Command(
        RoadCheck, "ext.interchange.roads:road_check", "ext.interchange.roads:road_text",
        ("cornerforge road check motorway.json",), name="road check", fails="ext.interchange.roads:is_faulty",
    ),
    Command(
        RoadShow, "ext.interchange.roads:road_show", "ext.interchange.roads:road_text",
        ("cornerforge road show on-ramp --out on-ramp.png",), name="road show",
    ),
    Command(
        SiteImport, "ext.interchange.sites:site_import", "ext.interchange.sites:site_text",
        (
            "cornerforge site import city.net.xml.gz --junction NODE_18 --out site.json",
            "cornerforge site import city.net.xml --junction J1,J2 --over --out ring.json",
        ),
        name="site import",
    ),
    Command(
        SiteCheck, "ext.interchange.sites:site_check", "ext.interchange.sites:site_text",
        ("cornerforge site check mcity-signal",), name="site check", fails="ext.interchange.sites:is_faulty",
    ),
    Command(
        SiteShow, "ext.interchange.sites:site_show", "ext.interchange.sites:site_text",
        ("cornerforge site show mcity-signal --out site.png",), name="site show",
    ),
)  # fmt: skip
