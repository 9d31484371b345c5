"""CSV tables of cases as earlier versions wrote them."""

from __future__ import annotations

import json
from pathlib import Path

__all__ = ["with_comments"]


def with_comments(path: Path) -> Path:
    """Move what stands beside a CSV file to comments at its begin."""
    beside = path.with_name(f"{path.stem}.facts.json")
    about = json.loads(beside.read_text(encoding="utf-8"))
    head = [f"# cornerforge case: {about['version']}", f"# name: {json.dumps(about['name'])}"]
    head.append(f"# road: {json.dumps(about['road'])}")
    head += [f"# fact {json.dumps(name)}: {json.dumps(value)}" for name, value in about["facts"].items()]
    path.write_text("\n".join([*head, path.read_text(encoding="utf-8")]), encoding="utf-8")
    beside.unlink()
    return path
