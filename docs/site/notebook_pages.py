"""Notebooks as pages: their text, their code and what it gives when it runs here."""

import base64
import os
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

NOT_RUN = "!!! note\n    Not run when this page was made: run `make repro`, then `make docs`.\n"
LONGEST_S = 300


def question(path: Path) -> str:
    """The question that a notebook answers."""
    return _read(path).cells[0].source.splitlines()[0].lstrip("# ")


def rendered(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown with its pictures by name; run where there is something to run on.

    `KERF_NOTEBOOKS=no` leaves them as they are.
    """
    notebook = _read(path)
    ran = os.environ.get("KERF_NOTEBOOKS") != "no" and _executed(notebook, path)
    return _page(notebook, path.stem, ran=ran)


def _read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)


def _executed(notebook: Any, path: Path) -> bool:
    place = {"metadata": {"path": str(path.parent)}}
    try:
        NotebookClient(notebook, timeout=LONGEST_S, resources=place).execute()
    except CellExecutionError as error:
        if "FileNotFoundError" in str(error) or "IndexError" in str(error):
            return False
        raise
    return True


def _page(notebook: Any, stem: str, *, ran: bool) -> tuple[str, dict[str, bytes]]:
    parts, pictures = [], {}
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            if len(parts) == 1 and not ran:
                parts.append(NOT_RUN)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.get("outputs", ()) if ran else ():
            data = output.get("data", {})
            if "image/png" in data:
                name = f"{stem}-{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode(data["image/png"])
                parts.append(f"![Figure {len(pictures)}]({name})")
            elif "text/html" in data:
                parts.append(data["text/html"])
            elif text := output.get("text") or data.get("text/plain"):
                parts.append(f"```text\n{text.rstrip()}\n```")
    return "\n\n".join(parts) + "\n", pictures
