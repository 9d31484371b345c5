"""Sites by their names, site files, and the ODD of a test at a site."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

from cornerforge._checks import check_number
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.results.stating import from_file
from cornerforge.site.faults import faults_of
from cornerforge.site.laws import LAWS_FILE, Demand, Laws
from cornerforge.site.network import SITE_FILES, Site
from cornerforge.site.zones import zones_of
from cornerforge.types import Odd

__all__ = ["demand_of", "laws_named", "odd_at", "read_site", "site_in_words", "site_named"]

_TIME_LIMIT = 120.0
"""A drive over a site ends after this time [s]: some cycles of its signals."""


def read_site(name: str | Path) -> Site:
    """Give a site by its name, or read it from a file that `site import` has written, whatever is wrong with it.

    Raises:
        UnknownNameError: No site and no file has this name.
        FileFormatError: The file is damaged, or holds no site.
    """
    file = SITE_FILES.get(str(name), Path(name))
    if not file.is_file():
        raise UnknownNameError("site", str(name), [*SITE_FILES, "FILE.json"])
    return from_file(Site, file, "cornerforge site import")


def site_named(name: str | Path) -> Site:
    """Give a site that can be driven, as `read_site`.

    Raises:
        UnknownNameError, FileFormatError: As there.
        InputError: The site cannot be driven.
    """
    site = read_site(name)
    if faults := tuple(faults_of(site, zones_of(site))):
        raise InputError(f"{name}: {'; '.join(faults)}.")
    return site


def laws_named(name: str | Path | None) -> Laws:
    """Read laws from a file of `site fit`; None: those that come with cornerforge.

    Raises:
        FileFormatError: The file is missing, damaged, or holds no laws.
    """
    file = LAWS_FILE if name is None else Path(name)
    if name is None and not file.is_file():
        return Laws()
    return from_file(Laws, file, "cornerforge site fit")


def demand_of(text: str | None) -> Demand:
    """Read how many come as options have it: "vehicles=300,people=60,trucks=0.1,left=0.3,right=0.3".

    Raises:
        UnknownNameError: A name is none of these.
        InputError: A part has no number, is there twice, or is out of range.
    """
    known = tuple(one.name for one in fields(Demand))
    given: dict[str, float] = {}
    for part in filter(None, (one.strip() for one in (text or "").split(","))):
        name, _, number = (one.strip() for one in part.partition("="))
        if name not in known:
            raise UnknownNameError("part of the traffic of a site", name, known)
        if name in given:
            raise InputError(f"site_traffic = {text!r}: {name} is there twice.")
        try:
            given[name] = check_number(f"site_traffic.{name}", float(number), low=0.0, high=1800.0)
        except ValueError as error:
            raise InputError(f"site_traffic = {text!r}: write {name}=NUMBER, such as {name}=0.1.") from error
    return Demand(**given)


def odd_at(odd: Odd, site: Site, laws: Laws, demand: Demand) -> Odd:
    """Put an ODD's tests at a site: an AV drives along one of its routes, drawn as those of others are."""
    return replace(odd, name=site.name, site=site, laws=laws, demand=demand, time_limit=_TIME_LIMIT)


def site_in_words(odd: Odd) -> str:
    """Say at which site and in which traffic an ODD's AV drives, and what is not known of it; "" on a road.

    >>> site_in_words(Odd())
    ''
    """
    if odd.site is None or odd.demand is None:
        return ""
    d = odd.demand
    told = [
        f"Site: {odd.site.name}; {d.vehicles:g} vehicles an hour by each lane, {d.people:g} people an hour to each end "
        f"of a crosswalk, {100.0 * d.trucks:g} % trucks.",
        "Drivers and people follow stated laws (docs/sites.md); how often the AV crashes is less certain than its "
        "interval says.",
    ]
    if odd.perception is not None:
        told.append(f"The AV perceives imperfectly: {odd.perception.in_words()} (docs/perception.md).")
    return " ".join(told)
