"""Results of `site fit` and `site validate`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Whole, meant
from cornerforge.results.html import Result

__all__ = ["LawFitted", "SiteBar", "SiteFact", "SiteFitted", "SiteValidated"]


class LawFitted(Result):
    """One number of the laws, and what it rests on."""

    name: Annotated[str, meant("Field of `Laws`.")]
    values: Annotated[tuple[float, ...], meant("The number; of `walks` seven.", "`unit`")]
    unit: Annotated[str, meant("Unit of the values.")]
    interval95: Annotated[
        tuple[float, float] | None,
        meant("95 % interval over groups (of `walks`: of its median); null: no data tell it.", "`unit`"),
    ]
    span: Annotated[
        tuple[float, float] | None, meant("What other published readings give; null where data tell it.", "`unit`")
    ]
    n: Annotated[Whole, meant("Rows of data behind it.")]
    groups: Annotated[Whole, meant("Drivers, signals or people that these rows are of.")]
    rests_on: Annotated[str, meant("data, read, recalled or judged.")]
    source: Annotated[str, meant("File, or publication, and how the number follows.")]
    leaves_out: Annotated[str, meant("What to doubt.")]


class SiteFact(Result):
    """Something counted in the data, beside what the laws and what others say of it."""

    fact: Annotated[str, meant("The quantity, in words.")]
    unit: Annotated[str, meant("Of the numbers.")]
    found: Annotated[float, meant("What was found.", "`unit`")]
    interval95: Annotated[tuple[float, float] | None, meant("95 % interval over groups; null: none.", "`unit`")]
    n: Annotated[Whole, meant("Rows behind it.")]
    laws: Annotated[float | None, meant("What the fitted laws give; null: they do not say.", "`unit`")]
    stated: Annotated[float | None, meant("What was stated of the whole file; null: nothing.", "`unit`")]
    source: Annotated[str, meant("File, and what to know.")]


class SiteFitted(Result):
    """The laws of drivers and people at a site, as `site fit` wrote them."""

    laws: Annotated[tuple[LawFitted, ...], meant("All of them, in the order of `Laws`.")]
    facts: Annotated[tuple[SiteFact, ...], meant("What the data have, and how well the laws fit to it.")]
    notes: Annotated[tuple[str, ...], meant("Missing files, and what the data cannot tell.")]
    files: Annotated[tuple[str, ...], meant("Files that were written.")]


class SiteBar(Result):
    """One measure of the simulation, beside the data."""

    measure: Annotated[str, meant("The quantity, in words.")]
    unit: Annotated[str, meant("Of the numbers.")]
    simulated: Annotated[float, meant("What the simulation has.", "`unit`")]
    interval95: Annotated[tuple[float, float], meant("95 % interval of it.", "`unit`")]
    n: Annotated[Whole, meant("How many it is of.")]
    data: Annotated[float | None, meant("What the data have; null: nothing.", "`unit`")]
    data_interval95: Annotated[tuple[float, float] | None, meant("95 % interval over groups; null: none.", "`unit`")]
    bar: Annotated[str, meant("What it should be.")]
    holds: Annotated[bool | None, meant("Whether it is; null: too few to say, or only shown.")]


class SiteValidated(Result):
    """Acts of drivers and people in tests at a site, beside what they rest on."""

    site: Annotated[str, meant("The site.")]
    bars: Annotated[tuple[SiteBar, ...], meant("The measures.")]
    passed: Annotated[bool, meant("No bar that could be judged is missed.")]
    notes: Annotated[tuple[str, ...], meant("What to know.")]
