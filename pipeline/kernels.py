"""Compilation of hot loops by Numba, cached for every copy of the same sources."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, cached_property
from hashlib import sha256
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

from numba import njit
from numba.core import caching

from pipeline.schema.files import cache_folder

OURS = f"{__name__.partition('.')[0]}."
"""First word of the names of modules whose source counts."""
KEPT_S = 90 * 24 * 3600.0
"""Age at which a compiled loop is thrown away [s]."""


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that allocates nothing, without counting references to arrays."""
    return compiled_with(nogil=True, _nrt=False)(function)


def compiled_with(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """``numba.njit`` whose results are kept in the user's cache by content.

    Numba's own cache looks at one file alone; a loop also changes with what it calls in other
    files, and another copy of the same sources need not compile anew.
    """

    def decorated(function: Callable[..., Any]) -> Callable[..., Any]:
        loop: Callable[..., Any] = njit(**options)(function)
        loop._cache = _Kept(function)  # type: ignore[attr-defined]
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
            with suppress(FileNotFoundError):  # another process may be done with a file of its own
                if time.time() - old.stat().st_mtime > KEPT_S:
                    old.unlink()

    def get_cache_path(self) -> str:
        """Folder of all loops."""
        return str(cache_folder() / "loops")

    def get_source_stamp(self) -> str:
        """Hash that the index of a function carries."""
        return self._key

    def get_disambiguator(self) -> str:
        """Hash in the name of its files, which distinguishes functions of one name."""
        return self._key


class _Impl(caching.CompileResultCacheImpl):
    _locator_classes = (ByContent,)


class _Cache(caching.FunctionCache):
    _impl_class = _Impl


class _Kept(caching.NullCache):
    """Cache of a loop, opened when it is compiled: by then all that it names is bound."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @cached_property
    def _opened(self) -> caching._Cache:
        try:
            return _Cache(self._function)
        except RuntimeError:  # no place for it: the user's cache cannot be written
            return caching.NullCache()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        return self._opened.load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        self._opened.save_overload(sig, data)


def kept_signatures(loop: Any) -> list[tuple[float, tuple[Any, ...]]]:
    """Time and types of arguments of each compilation of a loop that the user's cache keeps."""
    index = _Cache(loop.py_func)._cache_file
    file = Path(index._cache_path, index._index_name)
    return [(file.stat().st_mtime, key[0]) for key in index._load_index()]


@cache
def content(function: Callable[..., Any]) -> str:
    """Hash of the files of a function and of all that it calls, and of the values they name."""
    parts: set[bytes] = set()
    seen: set[Callable[..., Any]] = set()
    todo = [function]
    while todo:
        one = todo.pop()
        if one in seen:
            continue
        seen.add(one)
        parts.add(_source(one.__module__))
        for name, value in _named(one):
            inner = getattr(value, "py_func", value)
            if not str(getattr(inner, "__module__", OURS)).startswith(OURS):
                continue
            if isinstance(inner, FunctionType):
                todo.append(inner)
            elif hasattr(inner, "__module__"):
                parts.add(_source(inner.__module__))
            else:
                held = inner.tobytes() if hasattr(inner, "tobytes") else repr(inner).encode()
                parts.add(name.encode() + sha256(held).digest())
    return sha256(b"".join(sorted(parts))).hexdigest()[:16]


def _named(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Global names in a function with their values, and what it takes from modules of ours."""
    names = _names(function.__code__)
    for name in names:
        value = function.__globals__.get(name)
        if not isinstance(value, ModuleType):
            yield name, value
        elif value.__name__.startswith(OURS):
            yield from ((one, vars(value)[one]) for one in names if one in vars(value))


def _names(code: CodeType) -> list[str]:
    inside = [one for one in code.co_consts if isinstance(one, CodeType)]
    return [*code.co_names, *(name for one in inside for name in _names(one))]


@cache
def _source(module: str) -> bytes:
    file = getattr(sys.modules.get(module), "__file__", None)
    return sha256(Path(file).read_bytes() if file else module.encode()).digest()
