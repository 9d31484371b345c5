"""Run the notebooks of docs/notebooks anew, in their order, and write them with their outputs: `make notebooks`.

python supply/notebooks.py [NOTEBOOK...]
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "notebooks"
LONGEST_S = 300
"""Time that a cell may take: a first start compiles."""
SHOWN = ("text/html", "image/png", "text/plain")
"""Forms of an output, the best first; only the best is kept."""


def executed(path: Path, folder: Path) -> Any:
    """A notebook, run in a kernel of its own that stands in an empty folder; a cell that fails raises."""
    notebook = nbformat.read(path, as_version=4)
    told = os.environ | {"IPYTHONDIR": str(folder / ".ipython")}
    NotebookClient(notebook, timeout=LONGEST_S, resources={"metadata": {"path": str(folder)}}).execute(env=told)
    return tidied(notebook)


def tidied(notebook: Any) -> Any:
    """What stays when the same notebook is run again: no times, no messages of work in progress, no second forms."""
    notebook.metadata = nbformat.from_dict(
        {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        }
    )
    for number, cell in enumerate(notebook.cells, start=1):
        cell.metadata = nbformat.from_dict({})
        cell.id = f"cell-{number}"
        if cell.cell_type == "code":
            cell.outputs = joined([kept(one) for one in cell.outputs if one.get("name") != "stderr"])
    return notebook


def joined(outputs: list[Any]) -> list[Any]:
    """Outputs with printed lines together that came apart by the clock."""
    made: list[Any] = []
    for one in outputs:
        if made and one.output_type == made[-1].output_type == "stream":
            made[-1].text += one.text
        else:
            made.append(one)
    return made


def kept(output: Any) -> Any:
    """An output in its best form."""
    if "data" in output:
        best = next(form for form in SHOWN if form in output.data)
        output.data = nbformat.from_dict({best: output.data[best]})
        output.metadata = nbformat.from_dict({})
    return output


def texts(notebook: Any) -> list[str]:
    """What the cells print and show, but for pictures and the pages within frames."""
    found = []
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            shown = output.get("text") or "".join(
                output.get("data", {}).get(form, "") for form in SHOWN if form[0] == "t"
            )
            found.append(re.sub(r' srcdoc="[^"]*"', "", shown))
    return found


def main(names: list[str]) -> None:
    """Run these notebooks, or all, each in a folder of its own."""
    for path in sorted(map(Path, names) if names else FOLDER.glob("*.ipynb")):
        with tempfile.TemporaryDirectory() as folder:
            nbformat.write(executed(path, Path(folder)), path)
        print(path.name)


if __name__ == "__main__":
    main(sys.argv[1:])
