"""cornerforge: how an automated vehicle's decision-making crashes, which crashes matter, and how often they happen.

This package has the verbs of the command line as functions of the same names. Each returns what `--json` prints, most
of them as a dataclass of `cornerforge.results`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
        reproduce,
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


def __getattr__(name: str) -> Any:
    """Load a verb on first use, so that `import cornerforge` stays light."""
    if name in __all__:
        return getattr(importlib.import_module("cornerforge.pipeline"), name)
    raise AttributeError(f"module 'cornerforge' has no attribute {name!r}")
