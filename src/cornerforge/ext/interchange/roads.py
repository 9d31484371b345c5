"""`road import`, `road check` and `road show`."""

from __future__ import annotations

from pathlib import Path

from cornerforge._options import verb
from cornerforge.errors import InputError
from cornerforge.experiment.output import check_new_file
from cornerforge.experiment.roads import read_road, road_named, write_road_file
from cornerforge.ext.interchange.options import RoadCheck, RoadImport, RoadShow
from cornerforge.ext.interchange.road_import import road_of_opendrive
from cornerforge.ext.interchange.sumo_import import road_of_sumo
from cornerforge.results.roads import LaneTold, RoadTold
from cornerforge.road.network import Road, faults_of

__all__ = ["is_faulty", "road_check", "road_import", "road_show", "road_text"]


@verb(RoadImport)
def road_import(options: RoadImport) -> RoadTold:
    """Take roads of an OpenDRIVE file or edges of a SUMO network, and write it as a road file.

    Returns:
        What `cornerforge road import --json` prints.

    Raises:
        DataError: The file holds what cannot be represented; the message names the line.
        CornerForgeError: It cannot be read, or the road not be written.
    """
    file, out = Path(options.file), Path(options.out)
    check_new_file(out)
    if not file.name.endswith((".xml", ".xml.gz")):
        road = road_of_opendrive(
            file, ident=options.road, begin=options.begin, end=options.end, against=options.against
        )
    elif options.against:
        raise InputError("Edges of a SUMO network lead one way: leave out --against, and name others with --road.")
    else:
        road = road_of_sumo(file, edges=options.road, begin=options.begin, end=options.end)
    write_road_file(road, out)
    return _told(road, (), (str(out),))


@verb(RoadCheck)
def road_check(options: RoadCheck) -> RoadTold:
    """Look whether a road can be driven.

    Returns:
        What `cornerforge road check --json` prints.

    Raises:
        CornerForgeError: There is no such road, or its file is damaged.
    """
    road = read_road(options.road)
    return _told(road, tuple(faults_of(road)), ())


@verb(RoadShow)
def road_show(options: RoadShow) -> RoadTold:
    """Say how a road lies, and draw it where a file is named.

    Returns:
        What `cornerforge road show --json` prints.

    Raises:
        MissingExtraError: A picture is wanted, and matplotlib is not installed.
        CornerForgeError: There is no such road, or the picture can be neither drawn nor written.
    """
    road = road_named(options.road)
    files: tuple[str, ...] = ()
    if options.out is not None:
        from cornerforge.ext.pictures.picture import check_picture, save_picture
        from cornerforge.ext.pictures.road import road_figure

        out = Path(options.out)
        check_picture(out)
        save_picture(road_figure(road), out)
        files = (str(out),)
    return _told(road, (), files)


def _told(road: Road, faults: tuple[str, ...], files: tuple[str, ...]) -> RoadTold:
    tightest = road.line.tightest
    return RoadTold(
        name=road.name, length_m=round(road.length, 3), slots=road.slots, lane_width_m=road.lane_width,
        tightest_m=None if tightest == float("inf") else round(tightest, 3),
        lanes=tuple(
            LaneTold(
                slot=lane.slot, kind=lane.kind, begin_m=round(lane.begin, 3), end_m=round(lane.end, 3),
                limit_mps=lane.limit,
            )
            for lane in road.lanes
        ),
        notes=road.notes, faults=faults, files=files,
    )  # fmt: skip


def is_faulty(result: RoadTold) -> str | None:
    """Say that the command fails, which its text has told already; None if the road can be driven."""
    return "" if result.faults else None


def road_text(result: RoadTold) -> str:
    """Tell a road in text."""
    curve = "straight" if result.tightest_m is None else f"radius of the tightest curve {result.tightest_m:,.0f} m"
    wide = f"lanes {result.lane_width_m:.2f} m wide; slot 0 is the rightmost"
    lines = [f"{result.name}: {result.length_m:,.0f} m, {curve}, {wide}"]
    for lane in result.lanes:
        limit = "" if lane.limit_mps is None else f", limit {lane.limit_mps:.1f} m/s"
        lines.append(f"  slot {lane.slot}, {lane.begin_m:,.0f} to {lane.end_m:,.0f} m: {lane.kind}{limit}")
    lines += [f"Note: {note}" for note in result.notes]
    lines += [f"Fault: {fault}" for fault in result.faults]
    return "\n".join([*lines, *(f"File: {name}" for name in result.files)])
