"""The examples in the docstrings run."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = (
    "cutting",
    "gcode",
    "machine",
    "optimisation",
    "search",
    "thermal",
    "twin",
    "identification",
    "validation",
    "signals/windows",
    "parameters",
)


def modules() -> list[str]:
    found = [p for room in ROOMS for p in (ROOT / "pipeline").glob(f"{room}*/**/*.py")]
    found += [ROOT / f"pipeline/{room}.py" for room in ROOMS]
    return sorted(
        ".".join(p.relative_to(ROOT).with_suffix("").parts)
        for p in found
        if p.exists() and p.stem != "__init__"
    )


@pytest.mark.parametrize("name", modules())
def test_examples_in_docstrings_run(name: str) -> None:
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_there_are_examples() -> None:
    found = [doctest.DocTestFinder().find(importlib.import_module(name)) for name in modules()]
    assert sum(bool(test.examples) for tests in found for test in tests) >= 4
