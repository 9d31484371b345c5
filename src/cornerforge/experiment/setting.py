"""Building what the simulator takes (model, AV, ODD, adversary) from names and files."""

from __future__ import annotations

import shlex
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cornerforge._checks import check_in, check_number
from cornerforge._schema import read
from cornerforge.drivers.avs import SITE_AVS, AvModel, numbers_of_av
from cornerforge.drivers.naturalistic import tables_of
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.experiment.av_file import RECORDED_AV, av_of
from cornerforge.experiment.experiments import Experiment, with_outside_av
from cornerforge.experiment.policy_file import Policy, check_budget, load_policy, policy_numbers
from cornerforge.experiment.roads import odd_on, road_in_words, road_named
from cornerforge.experiment.sites import demand_of, laws_named, odd_at, site_in_words, site_named
from cornerforge.foreign.driver import ForeignAv
from cornerforge.foreign.spec import AvSpec, spec_of
from cornerforge.ndd.model import NddModel, default_model_path, load_model, model_hash
from cornerforge.perception import Perception, perception_of
from cornerforge.road.straight import road_numbers
from cornerforge.sim import Setting, controllers, n_slots, observe
from cornerforge.types import Odd, odd_named
from cornerforge.work import is_spread
from cornerforge.world_options import BUDGETS, STEER_FROM, WorldOptions

__all__ = [
    "AV_LOG",
    "RECORDED_AV",
    "TEMPERATURE",
    "experiment",
    "road_of",
    "temperature_of",
]

AV_LOG = "av.log"
"""File in an output folder that keeps what a foreign AV prints."""
TEMPERATURE = 0.05
"""Temperature of `softmax` without a number [units of Q]: actions with nearly equal Q are taken nearly as often."""


def temperature_of(acting: str, policies: Sequence[Policy] = ()) -> float:
    """Return the temperature of policies [units of Q or of logits].

    0 for "greedy", T for "softmax:T", `TEMPERATURE` for "softmax", AS_LEARNED for "learned", or 0 if all are greedy.

    Raises:
        UnknownNameError: The name is none of these.
        InputError: T is not a number in [0.0001, 100].

    >>> temperature_of("greedy"), temperature_of("softmax:0.2")
    (0.0, 0.2)
    """
    draws = any(policy.head != "greedy" for policy in policies)
    without_number = {"learned": controllers.AS_LEARNED if draws else 0.0, "greedy": 0.0}
    if acting in without_number:
        return without_number[acting]
    name, colon, number = acting.partition(":")
    if name != "softmax":
        raise UnknownNameError("way to act", acting, (*without_number, "softmax", "softmax:T"))
    if not colon:
        return TEMPERATURE
    try:
        temperature = float(number)
    except ValueError as error:
        raise InputError(f"acting = {acting!r}: {number!r} is no number; write for example softmax:0.1.") from error
    return check_number("temperature", temperature, low=1e-4, high=100.0)


def _load_policies(bv: Sequence[str], known: Sequence[str]) -> tuple[Policy, ...]:
    """Load policies from files.

    Raises:
        UnknownNameError, InputError: A name is no file of a policy.
        FileFormatError: A file is missing, damaged or of another version.
    """
    policies = []
    for name in bv:
        if name in known:
            raise InputError(f"A mixture is of policy files; {name} is none. Leave it out, or give it alone.")
        if not (name.endswith(".safetensors") or Path(name).exists()):
            raise UnknownNameError("driver of background vehicles", name, (*known, "FILE.safetensors"))
        policies.append(load_policy(Path(name)))
    return tuple(policies)


def _warn_of_another_world(policy: Policy, name: str, road: Odd, ndd: NddModel) -> None:
    """Warn if a policy was trained with another model or on another highway; it drives here all the same.

    Another AV causes no warning: policies are made to be tried on other AVs. A policy without a record of its world,
    for example one of Stable-Baselines3, causes none either.
    """
    odd = policy.about.get("odd")
    theirs = dict(odd) if isinstance(odd, dict) else {}
    if not _is_of_this_family(policy, road):
        return  # it is refused
    ours = {"name": road.name, "n_lanes": road.n_lanes, "model": model_hash(ndd), "road": _name_of(road.road)}
    ours["traffic"] = road.traffic
    ours["perception"] = "perfect" if road.perception is None else road.perception.in_words()
    if theirs:
        theirs["road"] = _name_of(theirs.get("road"))
        theirs.setdefault("traffic", "free")
        told = theirs.get("perception")
        theirs["perception"] = "perfect" if told is None else read(Perception, told, f"Policy {name}").in_words()
    theirs["model"] = policy.about.get("model_hash", ours["model"])
    words = {"name": "ODD", "n_lanes": "lanes", "model": "naturalistic model", "road": "road", "traffic": "traffic"}
    words["perception"] = "perception"
    other = [f"{words[key]} {theirs[key]}, here {here}" for key, here in ours.items() if theirs.get(key, here) != here]
    if other:
        warnings.warn(
            f"The policy {name} learned in another world ({'; '.join(other)}) and may be worse in this one; to learn "
            "here: cornerforge train.",
            stacklevel=3,
        )


def _is_of_this_family(policy: Policy, road: Odd) -> bool:
    """Did a policy learn at a site if the tests are at one, and on a road if not, as far as its file says?"""
    odd = policy.about.get("odd")
    return not isinstance(odd, dict) or not odd or (odd.get("site") is None) == (road.site is None)


def _name_of(road: Any) -> str:
    """Name a road, or what a file states of one; None is the straight one."""
    if road is None:
        return "straight"
    return str(road["name"]) if isinstance(road, dict) else str(road.name)


def road_of(world: WorldOptions) -> Odd:
    """Return the ODD that a user names.

    Raises:
        UnknownNameError, InputError: There is no ODD or road of that name, or it cannot have that many lanes.
    """
    odd = odd_named(world.odd)
    if world.site is not None:
        return _at_site(odd, world)
    for name in ("site_traffic", "site_laws"):
        if getattr(world, name) is not None:
            raise InputError(f"{name} is for sites; give site too, such as mcity-signal.")
    if world.traffic != odd.traffic:
        odd = replace(odd, traffic=world.traffic)
    if world.road is not None:
        if world.lanes is not None:
            raise InputError(f"The road {world.road} has lanes of its own; leave out lanes = {world.lanes}.")
        odd = odd_on(odd, road_named(world.road), world.task)
    elif world.task != "through":
        raise InputError(f"task = {world.task!r} needs a road with a ramp or an exit; give road, such as on-ramp.")
    elif world.lanes is not None:
        odd = replace(odd, n_lanes=world.lanes)
    if world.perception is not None:
        odd = replace(odd, perception=perception_of(world.perception))
    if road_numbers(odd).stops:
        warnings.warn(road_in_words(odd), stacklevel=3)
    return odd


def _at_site(odd: Odd, world: WorldOptions) -> Odd:
    """Return the ODD of a test at a site.

    Raises:
        UnknownNameError, FileFormatError: There are no laws or no site of that name.
        InputError: Options of roads are given too, or the site cannot be driven.
    """
    usual = WorldOptions()
    for name in ("odd", "lanes", "road", "task", "traffic"):
        if getattr(world, name) != getattr(usual, name):
            raise InputError(f"{name} is for roads; leave it out, or site = {world.site}.")
    found = odd_at(odd, site_named(str(world.site)), laws_named(world.site_laws), demand_of(world.site_traffic))
    if world.perception is not None:
        found = replace(found, perception=perception_of(world.perception))
    warnings.warn(site_in_words(found), stacklevel=4)
    return found


def _check_at_site(av: AvModel, spec: AvSpec, driver: str, policies: Sequence[Policy], road: Odd) -> None:
    """Check that AV and BVs, or the policies that steer them, can drive where the tests are.

    Raises:
        InputError: One of them cannot.
    """
    here = controllers.ROAD_ADVERSARIES if road.site is None else controllers.SITE_ADVERSARIES
    for policy in policies:
        if not _is_of_this_family(policy, road):
            learned_at, here_is = ("on a road", "at a site") if road.site is not None else ("at a site", "on a road")
            raise InputError(
                f"A policy that learned {learned_at} sees other things {here_is}; train one for this world."
            )
    if road.site is None:
        if av.kind == "junction" and not spec.is_outside:
            raise InputError(f"The AV {av.name} drives at sites only; give site, such as mcity-signal.")
        if driver not in ("nde", "idm", "policy", *here):
            raise InputError(f"bv = {driver!r} drives at sites only; give site, or take one of {', '.join(here)}.")
        return
    if av.kind != "junction" and not spec.is_outside:
        raise InputError(
            f"The AV {av.name} drives on roads only; at a site take one of {', '.join(SITE_AVS)}, or your own."
        )
    if driver not in ("nde", "policy", *here):
        raise InputError(f"bv = {driver!r} drives on roads only; at a site take nde, {', '.join(here)} or a policy.")


def _check_av(spec: AvSpec, *, takes_foreign: bool, takes_recorded: bool) -> None:
    """Check that the AV may be used here, and as it is asked.

    Raises:
        InputError: It may not.
    """
    if spec.is_outside and not takes_foreign:
        raise InputError(
            f"The AV {spec.name} is not built in, and built-in ones only are taken here. To train an adversary against "
            f"it: cornerforge train --av {shlex.quote(spec.name)} --out P.safetensors"
        )
    if spec.name == RECORDED_AV and not takes_recorded:
        raise InputError(
            f"{RECORDED_AV} is no AV that could drive on its own: it is what was in the AV's seat of a case."
        )
    said = {"python": spec.confines.python, "memory": spec.confines.memory}
    said |= {"actions": spec.reading.actions, "statistics": spec.reading.statistics}
    for name, value in said.items():
        if value is not None and not spec.is_outside:
            raise InputError(f"av_{name} is for AVs that are not built in; {spec.name} is. Leave it out.")
    if spec.is_outside and is_spread():
        raise InputError(
            f"The AV {spec.name} is not built in, so it drives on this machine alone; leave out --engine ray."
        )


def _check_model(ndd: NddModel, model: object, road: Odd, *, bounded: bool) -> None:
    """Check that a model knows what it is asked for; `model` is how the user named it.

    Raises:
        InputError: It knows no traffic that stops, or calls nothing impossible.
    """
    if road.traffic != "free" and ndd.slow is None:
        raise InputError(
            f"The model {model_hash(ndd)} knows no traffic that stops, so traffic = {road.traffic!r} cannot be driven; "
            "fit one with: cornerforge ndd fit, or leave out --traffic."
        )
    if bounded and (ndd.following > 0.0).all() and (ndd.free > 0.0).all():
        named = model_hash(ndd) if model is ndd else model
        raise InputError(
            f"The model {named} calls no acceleration impossible anywhere, so bounded would exclude nothing; fit one "
            "with: cornerforge ndd fit (it cuts what lies beyond its spread to 0), or leave out --bounded."
        )


def experiment(
    world: WorldOptions | None = None,
    *,
    bv: str | Path | Sequence[str | Path] = "nde",
    policy: Policy | Sequence[Policy] | None = None,
    acting: str = "learned",
    takes_foreign: bool = False,
    takes_recorded: bool = False,
    seed: int = 0,
    road: Odd | None = None,
    **keywords: Any,
) -> Experiment:
    """Build the experiment of a run; an AV from outside is not started before something is asked of it.

    Args:
        world: The world; None for the default one.
        bv: "nde", "idm", a plain adversary ("uniform", "lane-changer", "swerve"), or the path of a policy file; several
            paths: each test is driven by one of these policies, drawn at random.
        policy: One or more policies in memory instead of paths in `bv`.
        acting: How a policy acts: "learned", as its head says, "greedy", "softmax" or "softmax:T" (see
            `temperature_of`).
        takes_foreign: A foreign AV is allowed.
        takes_recorded: The AV may be RECORDED_AV: whatever was in its seat, as it was recorded; for cases on rails.
        seed: Seed that a foreign AV is told.
        road: ODD instead of the one that `world` names; a library has one of its own.
        keywords: Values that replace fields of `world`.

    Raises:
        UnknownNameError, InputError: A name or number is not known or out of range.
        FileFormatError: A file is missing, damaged or of another version.
    """
    world = replace(world or WorldOptions(), **keywords)
    model, bounded, budget = world.model, world.bounded, world.budget
    check_in("budget_of", world.budget_of, BUDGETS)
    road = road or road_of(world)
    spec, av_model = spec_of(world), av_of(world.av)
    _check_av(spec, takes_foreign=takes_foreign, takes_recorded=takes_recorded)
    ndd = model if isinstance(model, NddModel) else load_model(default_model_path() if model is None else Path(model))
    bounded = bounded or budget is not None
    budget = check_budget(budget, bounded=bounded)
    if budget is None and world.budget_of != BUDGETS[0]:
        raise InputError(f"budget_of = {world.budget_of!r} says what a budget limits; give the budget too.")
    known = ("nde", "idm", *(name for name in controllers.ADVERSARIES if name not in ("nobody", "policy")))
    names = [str(name) for name in ([bv] if isinstance(bv, (str, Path)) else bv)]
    if not names:
        raise InputError("bv names nothing; give an adversary, a policy file, or a list of policy files.")
    policies: tuple[Policy, ...] = ()
    if policy is not None:
        policies = (policy,) if isinstance(policy, Policy) else tuple(policy)
    elif len(names) != 1 or names[0] not in known:
        policies = _load_policies(names, known)
        for file, loaded in zip(names, policies, strict=True):
            _warn_of_another_world(loaded, file, road, ndd)
    driver = "policy" if policies else names[0]
    _check_at_site(av_model, spec, driver, policies, road)
    if policies:
        told = {} if budget is None else {"bounded": True, "budget": budget, "budget_of": world.budget_of}
        told |= {} if world.steer_from is None else {"steers_from": world.steer_from}
        policies = tuple(replace(p, **told) for p in policies)  # type: ignore[arg-type]
        bounded = all(p.bounded for p in policies)
        budget = policies[0].budget if len({p.budget for p in policies}) == 1 else None
    elif driver in ("nde", "idm") and (bounded or world.steer_from):
        what = "bounded" if bounded else "steer_from"
        raise InputError(f"{what} needs an adversary; {driver} has none. Train one with: cornerforge train --bounded")
    _check_model(ndd, model, road, bounded=bounded)
    temperature = temperature_of(acting, policies)
    if temperature > 0.0 and not policies:
        raise InputError(f"acting = {acting!r} needs a policy; {driver} has its own way. Give a policy file.")
    numbers = [policy_numbers(p) for p in policies]
    steers_from = (STEER_FROM if bounded else 0) if world.steer_from is None else world.steer_from
    excess = int(world.budget_of == "excess")
    own = controllers.Mask(0, 0, excess, 0 if driver in ("nde", "idm") else steers_from)
    mask = (policies[0].mask if policies else own)._replace(bounded=int(bounded), budget=observe.budget_units(budget))
    numbers_of_road = road_numbers(road)
    setting = Setting(
        road=numbers_of_road,
        av=numbers_of_av(av_model),
        tables=tables_of(ndd, stops=numbers_of_road.stops, traffic=road.traffic),
        who=controllers.Controllers(
            av=controllers.RECORDED
            if world.av == RECORDED_AV
            else controllers.OUTSIDE
            if spec.is_outside
            else controllers.BUILT_IN,
            critical=controllers.ADVERSARIES["nobody" if driver in ("nde", "idm") else driver],
            others=controllers.IDM_BVS if driver == "idm" else controllers.NATURALISTIC,
            **mask._asdict(),
            policy=max(numbers, key=lambda p: p.width) if numbers else NO_POLICY,
            temperature=temperature,
            cast=controllers.NO_CAST if len(policies) < 2 else controllers.cast_of(numbers, [p.mask for p in policies]),
        ),
    )
    spoken = {0.0: "greedy", controllers.AS_LEARNED: "learned"}.get(temperature, f"softmax:{temperature:g}")
    run = Experiment(road, av_model, ndd, driver, bounded, policies, budget, spoken, setting, n_slots(road))
    return with_outside_av(run, ForeignAv(spec, road, seed=seed)) if spec.is_outside else run
