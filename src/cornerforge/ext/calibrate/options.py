"""Options of the naturalistic driving model, `ndd fit`, `validate`, `show`, `import`; of `site fit` and `validate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, LongWork, Watched
from cornerforge._schema import meant

__all__ = ["COMMANDS", "DATA_FORMAT", "NddFit", "NddImport", "NddShow", "NddValidate", "SiteFit", "SiteValidate"]

DATA_FORMAT = meant(
    "ngsim, pairs, tracks, tgsim or highd; told from the columns by default.",
    name="--format", near=("ngsim", "pairs", "tracks", "tgsim", "highd"),
)  # fmt: skip


class NddFit(LongWork):
    """Fit a naturalistic model from trajectories; its report is written beside it.

    On one machine the same files give the same bytes; on another processor a law's fourth digit may differ.
    """

    files: Annotated[Sequence[Path | str], meant("Trajectory files.", metavar="FILE...")] = field(kw_only=False)
    out: Annotated[Path | str, meant("Model file to write, .npz.")]
    data_format: Annotated[str | None, DATA_FORMAT] = None
    prior_strength: Annotated[float, meant("Pseudo-counts per state with which the prior enters.")] = 200.0
    lane_changes: Annotated[
        str, meant("Lane changes: `fit` to these files, if they tell enough, or the shipped `prior`.")
    ] = "fit"
    study: Annotated[bool, meant("Report what other choices of the fit change, crash rates too (6 fits).")] = False
    study_tests: Annotated[int, meant("Tests that the study drives for each choice; 0: none.", low=0, high=10**12)] = (
        1_000_000
    )


class NddValidate(LongWork):
    """Compare a model with held-out trajectories and published facts; exit status 1 if it does not pass."""

    model: Annotated[Path | str, meant("The model.", metavar="M.npz")] = field(kw_only=False)
    against: Annotated[
        Sequence[Path | str], meant("Trajectory files, such as held-out ones.", metavar="FILE...", many=True)
    ]
    data_format: Annotated[str | None, DATA_FORMAT] = None
    miles: Annotated[float, meant("Vehicle-miles of traffic; 2e5 for a quick look.", low=100.0, high=1e9)] = 4e6
    out: Annotated[Path | str | None, meant("Folder for validation.json, the page and its figures.")] = None


class NddShow(Watched):
    """Show a naturalistic model: its key numbers beside published facts; figures with --out."""

    model: Annotated[
        Path | str | None, meant("The model; the shipped one by default.", metavar="M.npz")
    ] = field(kw_only=False, default=None)  # fmt: skip
    out: Annotated[Path | str | None, meant("Folder for figures (PNG).")] = None


class NddImport(Watched):
    """Make a model of the published IVBSS arrays; what is missing is filled from ours and named."""

    folder: Annotated[Path | str, meant("Folder with the arrays.", metavar="DIR")] = field(kw_only=False)
    out: Annotated[Path | str, meant("Model file to write, .npz.")]
    model: Annotated[Path | str | None, meant("Fills what is missing; the shipped model by default.")] = None


class SiteFit(Watched):
    """Fit how drivers and people behave at a junction; what data cannot tell is taken from publications, by name."""

    data: Annotated[Path | str, meant("Folder with the data; its files may be missing.", metavar="DIR")]
    out: Annotated[Path | str, meant("New file of the laws, .json.")]
    report: Annotated[Path | str | None, meant("New page of what each law rests on, .html.")] = None


class SiteValidate(LongWork):
    """Compare drivers and people at a junction with data; exit status 1 if a bar is missed."""

    site: Annotated[str, meant("The site.", metavar="SITE")] = field(kw_only=False)
    data: Annotated[Path | str, meant("Folder with the data; its files may be missing.", metavar="DIR")]
    site_laws: Annotated[str | None, meant("A file of `site fit`; the shipped one by default.")] = None
    recordings: Annotated[int, meant("Tests that are recorded and measured.", low=1, high=10**6)] = 2000
    tests: Annotated[int, meant("Tests without errors that are counted.", low=1, high=10**12)] = 1_000_000


COMMANDS = (
    Command(
        NddFit, "ext.calibrate.naturalistic:ndd_fit", "ext.calibrate.naturalistic:fit_text",
        ("cornerforge ndd fit mine/*_tracks.csv --out mine.npz",), name="ndd fit",
    ),
    Command(
        NddValidate, "ext.calibrate.validating:ndd_validate", "ext.calibrate.validating:validation_text",
        ("cornerforge ndd validate mine.npz --against unseen/*_tracks.csv --out checked",), name="ndd validate",
        fails="ext.calibrate.validating:did_not_pass",
    ),
    Command(
        NddShow, "ext.calibrate.show:ndd_show", "ext.calibrate.show:show_text",
        ("cornerforge ndd show --out out/model",), name="ndd show",
    ),
    Command(
        NddImport, "ext.calibrate.naturalistic:ndd_import", "ext.calibrate.naturalistic:import_text",
        ("cornerforge ndd import NDD_DATA --out ivbss.npz",), name="ndd import",
    ),
    Command(
        SiteFit, "ext.calibrate.site_fit:site_fit", "ext.calibrate.site_fit:site_fit_text",
        ("cornerforge site fit --data urban --out laws.json --report fit.html",), name="site fit",
    ),
    Command(
        SiteValidate, "ext.calibrate.site_validating:site_validate",
        "ext.calibrate.site_validating:site_validation_text",
        ("cornerforge site validate mcity-signal --data urban",), name="site validate",
        fails="ext.calibrate.site_validating:site_did_not_pass",
    ),
)  # fmt: skip
