"""Compiled loops are kept beside their files, or in the user's cache."""

from pathlib import Path

import pytest

from pipeline import kernels


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "loop.py").write_text("x = 1\n")
    return tmp_path


def test_the_place_changes_with_any_file_of_the_folder(folder: Path) -> None:
    first = kernels._place.__wrapped__(folder)
    assert first.parent == folder / "__pycache__"
    (folder / "other.py").write_text("y = 2\n")
    assert kernels._place.__wrapped__(folder) != first


def test_a_folder_that_cannot_be_written_is_not_needed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KERF_CACHE", "/cache/of/the/user")
    monkeypatch.setattr(kernels.os, "access", lambda path, mode: False)
    place = kernels._place.__wrapped__(folder)
    assert place.parent == Path("/cache/of/the/user/loops") / folder.name
    assert place.name == kernels._sources(folder)
