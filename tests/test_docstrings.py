"""The examples in the docstrings run."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROMPT = ">>> "


def modules() -> list[str]:
    """Modules of every room, however deep, in whose text an example stands."""
    found = sorted((ROOT / "pipeline").rglob("*.py"))
    return [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in found
        if PROMPT in path.read_text() and path.stem != "__main__"
    ]


@pytest.mark.parametrize("name", modules())
def test_examples_in_docstrings_run(name: str) -> None:
    done = doctest.testmod(importlib.import_module(name))
    assert done.failed == 0
    assert done.attempted > 0, f"{name} has a {PROMPT}that no docstring holds"


def test_there_are_examples() -> None:
    assert len(modules()) >= 4
