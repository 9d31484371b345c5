"""Concrete OpenSCENARIO XML files (1.0 to 1.3) of straight multi-lane roads as moving cases.

The file's storyboard is played: init, acts, manoeuvres and events with their triggers, in steps of 0.01 s; the places
of all vehicles at every tenth of a second are the case. Its x begins where the AV starts; the fact `start_x_m` says
where that is: the s of the road along the travel, or the x of the world, if the road is laid along that. What is not
carried over is listed by name and line.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cornerforge.errors import DataError, FileFormatError, InputError, UnknownNameError
from cornerforge.ext.interchange.read_opendrive import read_opendrive
from cornerforge.ext.interchange.xml_input import Element, read_xml
from cornerforge.ext.interchange.xosc_actions import MOTIONS, SUPPORTED, leaf_of
from cornerforge.ext.interchange.xosc_case import make_case
from cornerforge.ext.interchange.xosc_motion import Body
from cornerforge.ext.interchange.xosc_parameters import ROOT, Catalogs, put_parameters, safe_path
from cornerforge.ext.interchange.xosc_places import Places, frame_of_start
from cornerforge.ext.interchange.xosc_storyboard import Storyboard
from cornerforge.library.out_case import MOST_VEHICLES, Fact, MovingCase, fact_of_text, safe_name
from cornerforge.types import CAR, MOTORCYCLE, TRUCK

__all__ = ["read_openscenario"]

_VERSIONS = (0, 1, 2, 3)
_AV_NAMES = frozenset({"ego", "hero", "host", "egovehicle", "ego_vehicle", "hostvehicle", "av", "sut"})
_MOST_FACTS = 100
_KINDS = {
    "car": CAR, "van": CAR, "truck": TRUCK, "semitrailer": TRUCK, "trailer": TRUCK, "bus": TRUCK, "tram": TRUCK,
    "train": TRUCK, "motorbike": MOTORCYCLE, "bicycle": MOTORCYCLE,
}  # fmt: skip
_ROAD_USERS = ("Vehicle", "Pedestrian", "MiscObject")


def read_openscenario(path: Path, *, ego: str | None = None) -> MovingCase:
    """Read a concrete OpenSCENARIO file with its OpenDRIVE road.

    The road and catalogs are read from the folder of the file, the one above it, and what lies in them. A vehicle with
    a controller and without commands has an unknown motion: if it is the AV, the case holds its first frame only, and
    triggers that look at it see it keep its speed and lane.

    Args:
        path: The file.
        ego: Name of the entity in the AV's seat; None: the one that is called Ego, hero or the like, or else the only
            one with a controller.

    Returns:
        The case; its `notes` list what is not carried over.

    Raises:
        InputError: The file is missing, it has no or more than one AV, or a road or a number of vehicles that the
            simulator does not have.
        UnknownNameError: No entity is called `ego`.
        FileFormatError: It is no concrete OpenSCENARIO file of a known version, or a damaged or unsafe one.
        DataError: Something in it cannot be, or nothing of what moves its vehicles can be carried over.
    """
    top = read_xml(path, root=ROOT, what="an OpenSCENARIO file")
    version = _version(top)
    put_parameters(top)
    catalogs = Catalogs(path, top)
    notes: dict[str, None] = {}
    bodies = _bodies(top.need("Entities"), catalogs, notes)
    storyboard = top.need("Storyboard")
    av = _find_av(bodies, ego)
    network = top.need("RoadNetwork")
    logic = network.child("LogicFile")
    if logic is None:
        network.fault("it names no LogicFile, so there is no road")
    road_file = safe_path(path, logic.string("filepath"), logic)
    roads = read_opendrive(road_file)
    starts = _starts(storyboard)
    if av.name not in starts:
        storyboard.need("Init").fault(f"the AV, {av.name}, is put nowhere in Init (TeleportAction)")
    frame = frame_of_start(starts[av.name], starts, roads)
    places = Places(roads, frame, bodies)
    play = Storyboard(storyboard, places, bodies, catalogs, _parameters(top))
    play.selections = _selections(top.need("Entities"))
    play.build()
    _note_others(top, network, notes)
    is_told = _init(storyboard, play, bodies) | {name for name, body in bodies.items() if play.told(body)}
    av.unknown = av.controlled and av.name not in is_told
    frames = play.play()
    if av.unknown:
        play.note(
            f"{av.element.place}: {av.name} is driven by a controller and told nothing; triggers saw it keep its speed "
            "and lane, and touch nobody"
        )
    for body in bodies.values():
        if body.controlled and not body.unknown:
            place = next(body.element.all("ObjectController"), body.element).place
            play.note(f"{place}: the controller of {body.name} is left out; it does what the storyboard says")
    _check_carried(storyboard, play)
    notes.update(dict.fromkeys(frame.notes))
    notes.update(play.notes)
    return make_case(
        safe_name(path.stem), frame, bodies, av, frames, notes,
        facts=_facts(path, top, version, road_file, av),
    )  # fmt: skip


def _version(top: Element) -> str:
    header = top.need("FileHeader")
    major, minor = (header.integer(name, low=0, high=10**6) for name in ("revMajor", "revMinor"))
    if major != 1 or minor not in _VERSIONS:
        raise FileFormatError(f"{header.place}: OpenSCENARIO {major}.{minor} is not read; 1.0 to 1.3 are.")
    if top.child("Storyboard") is None:
        kind = next((f"a {part.tag}" for part in top.all("Catalog", "ParameterValueDistribution")), "no scenario")
        raise FileFormatError(f"{top.place}: this is {kind}; give the file of a concrete scenario, with a Storyboard.")
    return f"1.{minor}"


def _parameters(top: Element) -> dict[str, str]:
    declared = top.child("ParameterDeclarations")
    parts = declared.all("ParameterDeclaration") if declared is not None else ()
    return {part.string("name"): part.string("value") for part in parts}


def _bodies(entities: Element, catalogs: Catalogs, notes: dict[str, None]) -> dict[str, Body]:
    """All entities of the file, nowhere yet."""
    objects = list(entities.all("ScenarioObject"))
    if len(objects) > MOST_VEHICLES:
        raise InputError(
            f"{entities.place}: there are {len(objects):,} entities; up to {MOST_VEHICLES} are read. Keep those near "
            "the AV."
        )
    bodies: dict[str, Body] = {}
    for element in objects:
        name = element.string("name")
        if name in bodies:
            element.fault(f'there are two entities "{name[:40]}"')
        road_user = next(element.all(*_ROAD_USERS, "CatalogReference", "ExternalObjectReference"), None)
        if road_user is None:
            element.fault(f'entity "{name[:40]}" is nothing')
        if road_user.tag == "CatalogReference":
            road_user = catalogs.entry(road_user)
        if road_user.tag not in _ROAD_USERS:
            road_user.fault(f"a {road_user.tag[:40]} is no entity that is read; {', '.join(_ROAD_USERS)} are")
        bodies[name] = _body(name, element, road_user, notes)
    if not bodies:
        entities.fault("there is no ScenarioObject")
    for part in entities.children:
        if part.tag not in ("ScenarioObject", "EntitySelection"):
            notes.setdefault(f"{part.place}: {part.tag} is left out")
    return bodies


def _body(name: str, element: Element, road_user: Element, notes: dict[str, None]) -> Body:
    box = road_user.need("BoundingBox")
    size, centre = box.need("Dimensions"), box.need("Center")
    kind = MOTORCYCLE if road_user.tag == "Pedestrian" else CAR
    if road_user.tag == "Vehicle":
        category = road_user.string("vehicleCategory")
        if category not in _KINDS:
            notes.setdefault(f"{road_user.place}: {name} is a {category[:40]}; it counts as a car of its size")
        kind = _KINDS.get(category, CAR)
        if category == "bicycle":
            notes.setdefault(f"{road_user.place}: {name} is a bicycle; it counts as a motorcycle of its size")
    else:
        counts = "a car" if kind == CAR else "a motorcycle"
        notes.setdefault(f"{road_user.place}: {name} is a {road_user.tag}; it counts as {counts} of its size")
    for part in road_user.all("TrailerHitch", "TrailerCoupler", "Trailer"):
        notes.setdefault(f"{part.place}: {part.tag} is left out")
    return Body(
        name, element, kind,
        size.number("length", low=0.2, high=40.0, unit="m"),
        size.number("width", low=0.2, high=6.0, unit="m"),
        centre.number("x", 0.0, low=-20.0, high=20.0, unit="m"),
        centre.number("y", 0.0, low=-3.0, high=3.0, unit="m"),
        controlled=any(part.children for part in element.all("ObjectController")),
    )  # fmt: skip


def _selections(entities: Element) -> dict[str, list[str]]:
    return {
        part.string("name"): [ref.string("entityRef") for ref in part.need("Members").all("EntityRef")]
        for part in entities.all("EntitySelection")
    }


def _find_av(bodies: Mapping[str, Body], ego: str | None) -> Body:
    if ego is not None:
        if ego not in bodies:
            raise UnknownNameError("entity", ego[:80], bodies)
        return bodies[ego]
    for tries in (
        [body for body in bodies.values() if body.name.lower() in _AV_NAMES],
        [body for body in bodies.values() if body.controlled],
        list(bodies.values()),
    ):
        if len(tries) == 1:
            return tries[0]
    names = ", ".join(list(bodies)[:8])
    raise InputError(f"Which entity is in the AV's seat? None is called Ego; name one of: {names}.")


def _private(storyboard: Element) -> list[tuple[Element, Element]]:
    """All private actions of Init, each with the Private it stands in."""
    actions = storyboard.need("Init").child("Actions")
    return [
        (private, leaf_of(part))
        for private in (actions.all("Private") if actions is not None else ())
        for part in private.all("PrivateAction")
    ]


def _starts(storyboard: Element) -> dict[str, Element]:
    """Where each entity is at the start: where it is put, or else where its trajectory begins."""
    starts: dict[str, Element] = {}
    for private, leaf in _private(storyboard):
        name = private.string("entityRef")
        if leaf.tag == "TeleportAction":
            starts[name] = leaf.need("Position")
        elif leaf.tag == "FollowTrajectoryAction" and name not in starts:
            for path in (("TrajectoryRef", "Trajectory"), ("Trajectory",)):
                position = leaf.child(*path, "Shape", "Polyline", "Vertex", "Position")
                if position is not None:
                    starts[name] = position
    return starts


def _init(storyboard: Element, play: Storyboard, bodies: Mapping[str, Body]) -> set[str]:
    """Execute Init: positions, then speeds, then the rest. Return the entities that received a private action."""
    told: set[str] = set()
    todo: dict[str, list[tuple[Element, Body]]] = {"TeleportAction": [], "SpeedAction": [], "": []}
    for private, leaf in _private(storyboard):
        name = private.string("entityRef")
        if name not in bodies:
            private.fault(f'there is no entity "{name[:40]}"')
        if leaf.tag in ("AssignControllerAction", "ActivateControllerAction"):
            bodies[name].controlled = True
        if leaf.tag in MOTIONS and leaf.tag != "TeleportAction" and not _at_once(leaf):
            told.add(name)
        todo[leaf.tag if leaf.tag in todo else ""].append((leaf, bodies[name]))
    for kind, reference in (("TeleportAction", "Position"), ("SpeedAction", "SpeedActionTarget")):
        _in_order(play, todo[kind], reference)
    for leaf, body in todo[""]:
        play.actions.start(leaf, body)
    actions = storyboard.need("Init").child("Actions")
    for part in actions.all("GlobalAction", "UserDefinedAction") if actions is not None else ():
        play.act_globally(part, leaf_of(part))
    play.actions.carried = 0
    return told


def _at_once(leaf: Element) -> bool:
    dynamics = leaf.child("SpeedActionDynamics")
    if dynamics is None:
        return False
    return dynamics.attributes.get("dynamicsShape") == "step" or dynamics.attributes.get("value") in ("0", "0.0")


def _in_order(play: Storyboard, todo: list[tuple[Element, Body]], part: str) -> None:
    """Start actions, those first to which others refer."""
    done: set[str] = set()
    waiting = {body.name for _, body in todo}
    while todo:
        ready = [(leaf, body) for leaf, body in todo if _referred(leaf, part).isdisjoint(waiting - {body.name})]
        for leaf, body in ready or todo:
            play.actions.start(leaf, body)
            done.add(body.name)
        waiting -= done
        todo = [entry for entry in todo if entry not in ready] if ready else []


def _referred(leaf: Element, part: str) -> set[str]:
    holder = leaf.child(part)
    return {
        child.attributes["entityRef"]
        for child in (holder.children if holder else ())
        if "entityRef" in child.attributes
    }


def _note_others(top: Element, network: Element, notes: dict[str, None]) -> None:
    for part in network.children:
        if part.tag not in ("LogicFile", "SceneGraphFile") and (part.children or part.attributes):
            notes.setdefault(f"{part.place}: {part.tag} is left out")
    for part in top.all("VariableDeclarations", "MonitorDeclarations"):
        if part.children:
            notes.setdefault(f"{part.place}: {part.tag} is left out")


def _check_carried(storyboard: Element, play: Storyboard) -> None:
    """Refuse a file if none of its moving actions was carried over."""
    left_out = {note.partition(" is left out")[0] for note in play.notes}
    moving = [
        leaf
        for story in storyboard.all("Story")
        for leaf in _leaves(story)
        if leaf.tag in MOTIONS and f"{leaf.place}: {leaf.tag}" in left_out
    ]
    if moving and play.actions.carried == 0 and not play.actions.paths_begun:
        names = ", ".join(sorted({f"{leaf.tag} (line {leaf.line})" for leaf in moving}))
        raise DataError(
            f"{storyboard.place}: nothing that moves its vehicles can be carried over: {names[:300]}. {SUPPORTED} are "
            "read."
        )


def _leaves(element: Element) -> list[Element]:
    if element.tag == "PrivateAction":
        return [leaf_of(element)]
    return [leaf for child in element.children for leaf in _leaves(child)]


def _facts(path: Path, top: Element, version: str, road_file: Path, av: Body) -> dict[str, Fact]:
    header = top.need("FileHeader")
    licence = header.child("License")
    facts: dict[str, Fact] = {
        "source": path.name,
        "format": f"OpenSCENARIO {version}",
        "road": road_file.name,
        "description": header.attributes.get("description"),
        "author": header.attributes.get("author"),
        "date": header.attributes.get("date"),
        "licence": None if licence is None else licence.attributes.get("name", licence.text or None),
    }
    for part in _properties(header, av):
        facts.setdefault(part.string("name"), fact_of_text(part.string("value")))
    return facts


def _properties(header: Element, av: Body) -> list[Element]:
    """Further facts that the file states of itself and of the AV; our own writer puts all there that is known."""
    holders = (header.child("Properties"), av.element.child("Vehicle", "Properties"))
    return [part for holder in holders if holder is not None for part in holder.all("Property")][:_MOST_FACTS]
