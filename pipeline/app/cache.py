"""Folder of what kerf works out once and may be deleted at any time."""

from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

from pipeline.schema.files import cache_folder
from pipeline.schema.store import write_text

KEPT = 64
"""Entries that stay in a folder, the latest used."""


def content_key(files: Iterable[Path], *words: str) -> str:
    """Hash of the names and bytes of files, and of further words."""
    digest = sha256()
    for part in words:
        digest.update(part.encode() + b"\0")
    for path in files:
        content = path.read_bytes()
        digest.update(f"{path.as_posix()}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def kept(folder: str, key: str) -> str | None:
    """Text that was kept under a key, None where there is none."""
    path = cache_folder() / folder / key
    try:
        text = path.read_text(encoding="utf-8")
        path.touch()
    except (OSError, UnicodeDecodeError):
        return None
    return text


def keep(folder: str, key: str, text: str) -> None:
    """Keep a text under a key, where the cache can be written."""
    place = cache_folder() / folder
    try:
        write_text(text, place / key)
        entries = sorted(place.iterdir(), key=lambda path: path.stat().st_mtime)
        for old in entries[:-KEPT]:
            old.unlink(missing_ok=True)
    except OSError:
        return
