"""The layouts of trajectory files that can be read, by their columns.

| format | layouts read |
| --- | --- |
| `pairs` | follower/leader pairs: vehicle and leader speeds and their gap in every row (speeds taken as they are) |
| `tracks` | one row per vehicle and time, with the leader's name, or with the lane (leader = next ahead in the lane) |
| `ngsim` | any of the above, and the official NGSIM CSV (feet, `Vehicle_ID`, `Global_Time`, `Local_Y`, ...) |
| `tgsim` | FHWA's Third Generation Simulation CSVs (`xloc-kf`, `yloc-kf`, `lane-kf`, ...), also with underscores |
| `highd` | highD's `XX_tracks.csv`; a `XX_recordingMeta.csv` beside it gives the frame rate (25 a second without) |

Column names are compared in small letters, with `_` for hyphens and blanks. Text may be UTF-8 or UTF-16, with commas,
semicolons or tabs between fields, and commas in numbers (`dialects`). `FOREIGN` lists the layouts that are recognised
and refused.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

from cornerforge.types import CAR, MOTORCYCLE, TRUCK

__all__ = [
    "CREDITS", "DATA_FORMATS", "FCD_XML", "FOREIGN", "LAYOUTS", "ForeignLayout", "Layout", "Scene", "matching_layouts",
    "required_columns",
]  # fmt: skip

DATA_FORMATS = ("highd", "ngsim", "pairs", "tgsim", "tracks")
CREDITS = {
    "ngsim": "NGSIM, US DOT FHWA: open data of the US government",
    "tgsim": "TGSIM, US DOT FHWA: open data of the US government",
    "highd": "highD, RWTH Aachen (Krajewski et al. 2018): read its licence before passing on what is made of it",
}
"""Format -> publisher of the data, and what to check before passing on results made of them; unknown for others."""
_FEET = 0.3048


@dataclass(frozen=True)
class Scene:
    """Further columns of a layout, for readers that want all vehicles and not only decisions (`read_rows`).

    Attributes:
        left: 1 where the coordinate across the road grows to the left of a vehicle that drives towards growing
            positions, -1 where it grows to its right.
        window: Smoothing window of positions [s].
        across: Column of the position across the road, and its factor to SI; None: `across` of the layout's numbers.
        width: Column of a vehicle's width, and its factor; None: not given.
        kind: Column of a vehicle's class; None: not given.
        kinds: Value of that column -> class (`types.CLASSES`); all other values are cars.
        one_road: All recordings of a file are of one road, in the same coordinates.
    """

    left: int
    window: float = field(metadata={"unit": "s"})
    across: tuple[str, float] | None = None
    width: tuple[str, float] | None = None
    kind: str | None = None
    kinds: Mapping[str, int] = field(default_factory=dict)
    one_road: bool = True


@dataclass(frozen=True)
class Layout:
    """How one kind of file names its columns.

    Attributes:
        name: For messages.
        formats: The `--format` names under which it is read.
        kind: `pairs` (leader's state in the row), `leaders` (leader's name), `lanes` (leader = next in the lane).
        numbers: Our name -> (column, factor to SI).
        texts: Our name -> column; names of vehicles and recordings.
        optional: Our names that may be missing.
        window: Smoothing window [s].
        held_out_from: Vehicles first seen after this share of the recording are held out (no split column).
        front: Positions are of the front bumper; else of the centre.
        corner: Positions are of the box's corner with the smallest coordinate, for any direction of travel.
        ordered: Rows of a vehicle usually stand in time's order, so that a file where they do not is worth a note.
        scene: What it says of all vehicles on the road; None: the file does not give the places.
    """

    name: str
    formats: tuple[str, ...]
    kind: Literal["pairs", "leaders", "lanes"]
    numbers: Mapping[str, tuple[str, float]]
    texts: Mapping[str, str]
    optional: tuple[str, ...] = ()
    window: float = field(default=0.0, metadata={"unit": "s"})
    held_out_from: float = 0.8
    front: bool = False
    corner: bool = False
    ordered: bool = True
    scene: Scene | None = None


LAYOUTS = (
    Layout(
        name="car-following pairs",
        formats=("pairs", "ngsim"),
        kind="pairs",
        numbers={"time": ("t_s", 1.0), "speed": ("v_mps", 1.0), "lead_speed": ("vl_mps", 1.0), "gap": ("gap_m", 1.0)},
        texts={"recording": "period", "vehicle": "follower", "leader": "leader", "split": "split"},
        optional=("recording", "split"),
    ),
    Layout(
        name="tracks with leaders",
        formats=("tracks", "ngsim"),
        kind="leaders",
        numbers={"time": ("t_s", 1.0), "position": ("y_m", 1.0), "spacing": ("spacing_m", 1.0)},
        texts={"vehicle": "track", "leader": "leader_track"},
        window=5.1,  # sets the spread: accelerations' sd is 0.70 m/s2 with 3.1 s, 0.50 with 5.1 s, 0.42 with 7.1 s
        held_out_from=0.5,
        front=True,
    ),
    Layout(
        name="tracks with lanes",
        formats=("tracks", "ngsim"),
        kind="lanes",
        numbers={"time": ("t_s", 1.0), "position": ("s_m", 1.0), "lane": ("lane", 1.0), "length": ("length_m", 1.0)},
        texts={"recording": "scenario", "vehicle": "veh_id"},
        optional=("recording", "length"),
        window=4.1,  # 2.1 s leaves so much noise that held-out I-80 and HOV decisions become less likely
        held_out_from=1.0,
        scene=Scene(left=1, window=2.1, across=("d_m", 1.0), width=("width_m", 1.0)),
    ),
    Layout(
        name="official NGSIM",
        formats=("ngsim",),
        kind="lanes",
        numbers={
            "time": ("global_time", 1e-3),
            "position": ("local_y", _FEET),
            "lane": ("lane_id", 1.0),
            "length": ("v_length", _FEET),
        },
        texts={"recording": "location", "vehicle": "vehicle_id"},
        optional=("recording",),
        window=2.1,
        front=True,
        ordered=False,
        scene=Scene(
            left=-1,
            window=2.1,
            across=("local_x", _FEET),
            width=("v_width", _FEET),
            kind="v_class",
            kinds={"1": MOTORCYCLE, "2": CAR, "3": TRUCK},
            one_road=False,
        ),
    ),
    Layout(
        name="TGSIM",
        formats=("tgsim",),
        kind="lanes",
        numbers={
            "time": ("time", 1.0),
            "position": ("xloc_kf", 1.0),
            "across": ("yloc_kf", 1.0),
            "lane": ("lane_kf", 1.0),
            "length": ("length_smoothed", 1.0),
        },
        texts={"recording": "run_index", "vehicle": "id"},
        optional=("recording", "length"),
        window=1.1,
        ordered=False,
        scene=Scene(
            left=-1,  # the origin is the upper left corner of a picture
            window=1.1,
            width=("width_smoothed", 1.0),
            kind="type_most_common",
            kinds={
                "large-vehicle": TRUCK,
                "large_vehicle": TRUCK,
                "truck": TRUCK,
                "bus": TRUCK,
                "motorcycle": MOTORCYCLE,
            },
        ),
    ),
    Layout(
        name="highD tracks",
        formats=("highd",),
        kind="lanes",
        numbers={
            "time": ("frame", 1.0 / 25.0),
            "position": ("x", 1.0),
            "lane": ("laneid", 1.0),
            "length": ("width", 1.0),
        },
        texts={"vehicle": "id"},
        window=1.1,
        corner=True,
        scene=Scene(
            left=-1,  # the origin is the upper left corner of a picture
            window=1.1,
            across=("y", 1.0),
            width=("height", 1.0),
            kinds={"car": CAR, "truck": TRUCK},  # from XX_tracksMeta.csv
        ),
    ),
)
"""Every layout that can be read; the first with all its columns present is taken."""


class ForeignLayout(NamedTuple):
    """A layout that is refused: its name, its units, what it lacks, and columns by which it is recognised."""

    name: str
    units: str
    lacks: str
    columns: frozenset[str]

    def refusal(self, path: Path) -> str:
        """Say what the file is, what it lacks, and what to write instead."""
        return (
            f"Trajectory file {path} looks like {self.name} ({self.units}), which is not read: {self.lacks}. Write its "
            "vehicles as tracks with lanes: columns veh_id, t_s [s], lane (numbered side by side), s_m (of the centre, "
            "along the road) [m], length_m [m]; for cases also d_m (across, to the left) [m] and width_m [m]."
        )


_LANELETS = "positions are in a plane, and lanes are lanelets that end along the road"
_NO_LANES = "it names no lane and no leader"
FCD_XML = ForeignLayout(
    "SUMO's FCD output", "m, m/s, s, degrees", "positions begin anew on each edge",
    frozenset(("timestep_time", "vehicle_id", "vehicle_lane", "vehicle_pos")),
)  # fmt: skip
FOREIGN = (
    ForeignLayout("exiD", "m, m/s, degrees, frames", _LANELETS, frozenset(("trackid", "xcenter", "laneletid"))),
    ForeignLayout(
        "inD, rounD or uniD", "m, m/s, degrees, frames", _NO_LANES, frozenset(("trackid", "xcenter", "heading"))
    ),
    ForeignLayout("INTERACTION", "m, m/s, rad, ms", _NO_LANES, frozenset(("track_id", "timestamp_ms", "x", "y"))),
    ForeignLayout(
        "pNEUMA", "degrees of latitude and longitude, km/h, s; a row for each vehicle", _NO_LANES,
        frozenset(("track_id", "traveled_d", "avg_speed", "lat")),
    ),
    FCD_XML,
)  # fmt: skip
"""Layouts that are recognised and refused; the first whose columns are all there is named."""


def required_columns(layout: Layout) -> list[str]:
    """Columns that a file of this layout must have, as `read_header` spells them."""
    numbers = [column for name, (column, _) in layout.numbers.items() if name not in layout.optional]
    return [*numbers, *(column for name, column in layout.texts.items() if name not in layout.optional)]


def matching_layouts(header: Collection[str], data_format: str | None = None) -> list[Layout]:
    """Layouts (of one format, or of all) with all required columns in `header`, in the order of `LAYOUTS`."""
    known = [layout for layout in LAYOUTS if data_format is None or data_format in layout.formats]
    return [layout for layout in known if all(column in header for column in required_columns(layout))]
