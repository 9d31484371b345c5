"""Result of `site fit`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Whole, meant
from cornerforge.results.html import Result

__all__ = ["LawFitted", "SiteFact", "SiteFitted"]


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
