"""Compilation of hot loops by Numba; what was compiled serves every copy of the same sources."""

import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

from numba import config, njit
from numba.core import caching

from pipeline.schema.files import cache_folder

OURS = f"{__name__.partition('.')[0]}."
"""First word of the names of modules whose source counts."""
KEPT_S = 90 * 24 * 3600.0
"""Age at which a compiled loop is thrown away [s]."""


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that allocates nothing.

    Its references to arrays need not be counted (counting them for each value took half of the
    time).
    """
    return compiled_with(nogil=True, _nrt=False)(function)


def compiled_with(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """``numba.njit`` whose results are kept in the user's cache by content.

    Numba's own cache stands beside a source and looks at that file alone.  A loop also changes with
    what it calls in other files, and another copy of the same sources (a clone, a worktree, the
    code in a bundle) need not compile anew.
    """

    def decorated(function: Callable[..., Any]) -> Callable[..., Any]:
        before = config.CACHE_LOCATOR_CLASSES
        config.CACHE_LOCATOR_CLASSES = f"{__name__}.{ByContent.__name__},InTreeCacheLocator"
        try:
            loop: Callable[..., Any] = njit(cache=True, **options)(function)
        finally:
            config.CACHE_LOCATOR_CLASSES = before
        return loop

    return decorated


class ByContent(caching._CacheLocator):
    """Place of a compiled function, named by the hash of what it is made of."""

    def __init__(self, function: FunctionType, file: str) -> None:
        self._key = content(function)
        self._py_file, self._lineno = file, function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, py_func: FunctionType, py_file: str) -> "ByContent | None":
        """Locator of a function; None where the user's cache cannot be written."""
        try:
            caching._CacheLocator.ensure_cache_path(place := cls(py_func, py_file))
        except OSError:
            return None
        return place

    def ensure_cache_path(self) -> None:
        """Make the folder before a loop is kept, and throw away those that are old."""
        super().ensure_cache_path()
        for old in Path(self.get_cache_path()).iterdir():
            if time.time() - old.stat().st_mtime > KEPT_S:
                old.unlink(missing_ok=True)

    def get_cache_path(self) -> str:
        """Folder of all loops."""
        return str(cache_folder() / "loops")

    def get_source_stamp(self) -> str:
        """Hash that the index of a function carries."""
        return self._key

    def get_disambiguator(self) -> str:
        """Hash in the name of its files, which tells functions of one name apart."""
        return self._key


@cache
def content(function: FunctionType) -> str:
    """Hash of a function's file and of what it names from other files, functions of theirs too."""
    digest = sha256(_source(function.__module__))
    for value in _named(function):
        inner = getattr(value, "py_func", value)
        if not str(getattr(inner, "__module__", OURS)).startswith(OURS):
            continue
        if isinstance(inner, FunctionType):
            digest.update(content(inner).encode())
        elif hasattr(inner, "__module__"):
            digest.update(_source(inner.__module__))
        else:
            digest.update(inner.tobytes() if hasattr(inner, "tobytes") else repr(inner).encode())
    return digest.hexdigest()[:16]


def _named(function: FunctionType) -> Iterator[Any]:
    """Values of the global names in a function, and of what it takes from modules of ours."""
    names = _names(function.__code__)
    for name in names:
        value = function.__globals__.get(name)
        if not isinstance(value, ModuleType):
            yield value
        elif value.__name__.startswith(OURS):
            yield from (vars(value)[one] for one in names if one in vars(value))


def _names(code: CodeType) -> list[str]:
    inside = [one for one in code.co_consts if isinstance(one, CodeType)]
    return [*code.co_names, *(name for one in inside for name in _names(one))]


@cache
def _source(module: str) -> bytes:
    file = getattr(sys.modules.get(module), "__file__", None)
    return Path(file).read_bytes() if file else module.encode()
