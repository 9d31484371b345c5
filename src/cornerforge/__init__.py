"""cornerforge: how an automated vehicle's decision-making crashes, which crashes matter, and how often they happen.

This package has the verbs of the command line as functions of the same names. Each returns what `--json` prints, most
of them as a dataclass of `cornerforge.results`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.paper import reproduce
    from cornerforge.pipeline import (
        analyse,
        avs,
        check_av,
        generate,
        ndd_fit,
        ndd_import,
        ndd_show,
        ndd_validate,
        plausibility,
        query,
        rate,
        replay,
        run,
        shrink,
        simulate,
        train,
        train_av,
        variety,
    )

__all__ = [
    "__version__",
    "analyse",
    "avs",
    "check_av",
    "generate",
    "ndd_fit",
    "ndd_import",
    "ndd_show",
    "ndd_validate",
    "plausibility",
    "query",
    "rate",
    "replay",
    "reproduce",
    "run",
    "shrink",
    "simulate",
    "train",
    "train_av",
    "variety",
]

__version__ = "0.1.0"


__getattr__ = door("cornerforge", dict.fromkeys(set(__all__) - {"__version__"}, "pipeline") | {"reproduce": "paper"})
