"""Folder of what kerf works out once and may be deleted at any time."""

import json
import os
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path
from typing import Any

from pipeline.schema.store import write_text

KEPT = 64
"""Entries that stay in a folder, the latest used."""


def cache_folder() -> Path:
    """``KERF_CACHE``, or ``kerf`` in the user's cache (``XDG_CACHE_HOME``, ``~/.cache``)."""
    own = os.environ.get("KERF_CACHE")
    if own:
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "kerf"


def content_key(files: Iterable[Path], *words: str) -> str:
    """Hash of the names and bytes of files, and of further words."""
    digest = sha256()
    for part in words:
        digest.update(part.encode() + b"\0")
    for path in files:
        content = path.read_bytes()
        digest.update(f"{path.as_posix()}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def kept(folder: str, key: str) -> Any:
    """Plain value that was kept under a key, None where there is none."""
    path = cache_folder() / folder / key
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
        path.touch()
    except (OSError, ValueError):
        return None
    return value


def keep(folder: str, key: str, value: Any) -> None:
    """Keep a plain value that JSON gives back as it is, where the cache can be written."""
    place = cache_folder() / folder
    try:
        text = json.dumps(value)
        if json.loads(text) != value:
            return
        write_text(text, place / key)
        entries = sorted(place.iterdir(), key=lambda path: path.stat().st_mtime)
        for old in entries[:-KEPT]:
            old.unlink(missing_ok=True)
    except (OSError, TypeError, ValueError):
        return
