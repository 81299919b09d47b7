"""Words of pages: each that the code names is there with its fields, and none is left over."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.charts.words import PageWords, page_words
from tests.test_architecture import PACKAGE

FILES = sorted((PACKAGE / "submodels").rglob("*.toml"))
EACH = pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(PACKAGE)))


def words_of(file: Path) -> PageWords:
    return page_words(str(file.with_suffix(".py")))


def pattern(key: ast.expr) -> str:
    """Regular expression of the keys that an argument may be."""
    if isinstance(key, ast.Constant):
        return re.escape(str(key.value))
    if isinstance(key, ast.IfExp):
        return f"(?:{pattern(key.body)}|{pattern(key.orelse)})"
    assert isinstance(key, ast.JoinedStr), ast.dump(key)
    return "".join(
        pattern(part.value) if isinstance(part, ast.FormattedValue)
        and isinstance(part.value, ast.IfExp) else
        ".+" if isinstance(part, ast.FormattedValue) else pattern(part) for part in key.values
    )  # fmt: skip


def calls(file: Path) -> Iterator[tuple[str, set[str] | None]]:
    """Patterns of the keys that the page names, with the fields it gives; None where any."""
    for node in ast.walk(ast.parse(file.with_suffix(".py").read_text())):
        if not isinstance(node, ast.Call):
            continue
        of = node.func
        given = {k.arg for k in node.keywords if k.arg is not None}
        several = len(given) < len(node.keywords)
        if isinstance(of, ast.Name) and of.id == "WORDS":
            yield pattern(node.args[0]), None if several else given
        elif (
            isinstance(of, ast.Attribute) and of.attr == "table"
            and isinstance(of.value, ast.Name) and of.value.id == "WORDS"
        ):  # fmt: skip
            yield f"{pattern(node.args[0])}[.].+", None if several else given


def fields(text: str) -> set[str]:
    return set(re.findall(r"(?<!{){(\w+)", text))


@EACH
def test_each_text_is_named_and_gets_its_fields(file: Path) -> None:
    words, named = words_of(file), list(calls(file))
    assert named
    for key, _ in named:
        assert any(re.fullmatch(key, one) for one in words.words), f"no text {key}"
    for name, entry in words.words.items():
        matching = [(key, given) for key, given in named if re.fullmatch(key, name)]
        literal = [(key, given) for key, given in matching if ".+" not in key]
        givers = [given for _, given in literal or matching]
        assert givers, f"{name} is named nowhere"
        wanted = set().union(*map(fields, [entry] if isinstance(entry, str) else entry.values()))
        for given in givers:
            assert given is None or wanted <= given, f"{name} wants {wanted - (given or set())}"


def test_every_page_has_its_words() -> None:
    pages = {f.parent.name for f in (PACKAGE / "submodels").glob("*/page.py")}
    assert pages == {f.parent.name for f in (PACKAGE / "submodels").glob("*/page.toml")}
