"""Compilation of hot loops by Numba; what was compiled is kept from run to run."""

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import config, njit

from pipeline.schema.files import cache_folder


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that allocates nothing.

    Its references to arrays need not be counted (counting them for each value took half of the
    time).  Numba keeps what it compiled as long as the function's own file does not change; what it
    calls in other files counts too, so that the place of what is kept is named by a hash of all
    files of its folder.  It is kept beside the files, or in the user's cache where Kerf is
    installed in a folder that the user cannot write to.
    """
    before = config.CACHE_DIR
    config.CACHE_DIR = str(_place(Path(function.__code__.co_filename).parent))
    try:
        kept: Callable[..., Any] = njit(cache=True, nogil=True, _nrt=False)(function)
    finally:
        config.CACHE_DIR = before
    return kept


@cache
def _place(folder: Path) -> Path:
    own = folder / "__pycache__"
    writable = os.access(own if own.exists() else folder, os.W_OK)
    return (own if writable else cache_folder() / "loops" / folder.name) / _sources(folder)


def _sources(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
