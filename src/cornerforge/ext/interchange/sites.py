"""`site import`, `site check` and `site show`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from cornerforge._options import verb
from cornerforge.errors import InputError
from cornerforge.experiment.output import check_new_file
from cornerforge.experiment.sites import read_site
from cornerforge.ext.interchange.options import SiteCheck, SiteImport, SiteShow
from cornerforge.ext.interchange.sumo_site import site_of_sumo
from cornerforge.results.sites import RouteTold, SiteTold
from cornerforge.results.stating import as_json
from cornerforge.site.faults import faults_of
from cornerforge.site.mending import with_approaches, with_limit
from cornerforge.site.network import Site, with_amber
from cornerforge.site.zones import Zone, with_entries_that_yield, zones_of
from cornerforge.work.files import write_json

__all__ = ["is_faulty", "site_check", "site_import", "site_show", "site_text"]


@verb(SiteImport)
def site_import(options: SiteImport) -> SiteTold:
    """Take junctions of a SUMO network, and write them as a site file.

    Returns:
        What `cornerforge site import --json` prints.

    Raises:
        DataError: The file holds what cannot be represented; the message names the line.
        CornerForgeError: It cannot be read, or the site not be written.
    """
    file, out = Path(options.file), Path(options.out)
    check_new_file(out)
    if not file.name.endswith((".xml", ".xml.gz")):
        how = f"netconvert --opendrive {file} -o city.net.xml"
        raise InputError(f"{file} is no SUMO network; make one (pip install eclipse-sumo) with: {how}")
    site = site_of_sumo(file, options.junction, reach=options.reach, over=options.over)
    site = with_amber(site) if options.mend_amber else site
    site = with_entries_that_yield(site) if options.mend_entries else site
    site = with_approaches(site, options.approach) if options.approach is not None else site
    site = with_limit(site, options.limit / 3.6) if options.limit is not None else site
    told = _told(site, zones_of(site), (str(out),))
    write_json(out, as_json(site))
    return told


@verb(SiteCheck)
def site_check(options: SiteCheck) -> SiteTold:
    """Look whether a site can be driven.

    Returns:
        What `cornerforge site check --json` prints.

    Raises:
        CornerForgeError: There is no such site, or its file is damaged.
    """
    site = read_site(options.site)
    return _told(site, zones_of(site), ())


@verb(SiteShow)
def site_show(options: SiteShow) -> SiteTold:
    """Say what a site has, and draw it where a file is named.

    Returns:
        What `cornerforge site show --json` prints.

    Raises:
        MissingExtraError: A picture is wanted, and matplotlib is not installed.
        CornerForgeError: There is no such site, or the picture can be neither drawn nor written.
    """
    site = read_site(options.site)
    zones = zones_of(site)
    files: tuple[str, ...] = ()
    if options.out is not None:
        from cornerforge.ext.pictures.picture import check_picture, save_picture
        from cornerforge.ext.pictures.site import site_figure

        out = Path(options.out)
        check_picture(out)
        save_picture(site_figure(site, zones), out)
        files = (str(out),)
    return _told(site, zones, files)


def _told(site: Site, zones: tuple[Zone, ...], files: tuple[str, ...]) -> SiteTold:
    of_route = Counter(k for zone in zones for k in (zone.first, zone.second))
    return SiteTold(
        name=site.name,
        routes=tuple(
            RouteTold(
                name=route.name, turn=route.turn, length_m=round(route.length, 3), stop_m=route.stop,
                signal=route.signal, zones=of_route[k], yields_to=len(set(route.yields_to)),
            )
            for k, route in enumerate(site.routes)
        ),
        zones=dict(sorted(Counter(zone.kind for zone in zones).items())),
        programme_s=round(sum(phase.seconds for phase in site.programme), 3), phases=len(site.programme),
        notes=site.notes, faults=tuple(faults_of(site, zones)), files=files,
    )  # fmt: skip


def is_faulty(result: SiteTold) -> str | None:
    """Say that the command fails, which its text has told already; None if the site can be driven."""
    return "" if result.faults else None


def site_text(result: SiteTold) -> str:
    """Tell a site in text."""
    kinds = ", ".join(f"{count} {kind}" for kind, count in result.zones.items()) or "none"
    signals = f"{result.phases} phases in {result.programme_s:g} s" if result.phases else "none"
    lines = [f"{result.name}: {len(result.routes)} routes; zones: {kinds}; signals: {signals}"]
    for route in result.routes:
        signal = "" if route.signal < 0 else f", signal {route.signal}"
        lines.append(
            f"  {route.name}: {route.turn}, {route.length_m:.0f} m, stop line at {route.stop_m:.0f} m{signal}; "
            f"{route.zones} zones, yields to {route.yields_to}"
        )
    lines += [f"Note: {note}" for note in result.notes]
    lines += [f"Fault: {fault}" for fault in result.faults]
    return "\n".join([*lines, *(f"File: {name}" for name in result.files)])
