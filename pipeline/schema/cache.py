"""Folder of what kerf works out once and may be deleted at any time."""

import ast
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

from pipeline.schema.files import cache_folder
from pipeline.schema.store import write_bytes

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


def code_hash(source: ast.Module) -> str:
    """Hash of a module's syntax tree, without docstrings and texts below constants.

    >>> plain, explained = ast.parse("x = 1"), ast.parse("x = 1; 'Radius of a circle [m].'")
    >>> code_hash(plain) == code_hash(explained)
    True
    """
    for node in ast.walk(source):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [one for one in node.body if not _is_text(one)]
    return sha256(ast.dump(source).encode()).hexdigest()


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def kept(folder: str, key: str) -> bytes | None:
    """Content that was kept under a key, None where there is none."""
    path = cache_folder() / folder / key
    try:
        content = path.read_bytes()
        path.touch()
    except OSError:
        return None
    return content


def keep(folder: str, key: str, content: bytes) -> None:
    """Keep bytes under a key, where the cache can be written."""
    place = cache_folder() / folder
    try:
        write_bytes(content, place / key)
        entries = sorted(place.iterdir(), key=lambda path: path.stat().st_mtime)
        for old in entries[:-KEPT]:
            old.unlink(missing_ok=True)
    except OSError:
        return
