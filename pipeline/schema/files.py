"""Files that are written whole: beside their place, and moved into it when nothing went wrong.

A full disk, a signal or a second run at the same time leaves the old file or the new one, never a
part of either.  The cache holds what is worked out once and may be deleted at any time.
"""

import atexit
import ctypes
import os
import shutil
import signal
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from errno import ELOOP
from hashlib import sha256
from itertools import count
from pathlib import Path
from stat import S_IMODE
from types import FrameType

PART = ".part"
"""End of the name of a file that is not whole yet."""
LONGEST = 200
"""Bytes of a file's name that go into the name beside it; file systems allow 255."""
AT_CWD, RENAME_EXCHANGE = -100, 2
"""Paths below the working folder, and swap of two names: linux/fcntl.h and linux/fs.h."""
_numbers = count()
_held: ContextVar[list[tuple[Path, Path]] | None] = ContextVar("_held", default=None)
"""Files of :func:`together` that wait beside their places."""
_begun: set[Path] = set()
"""Files of this run that are not in their places yet."""
_ended: list[int] = []
"""Signal that ends this run."""


class NotWrittenError(OSError):
    """A file that could not be written; what was there before is left as it was."""


def cache_folder() -> Path:
    """Folder of what may be deleted: ``KERF_CACHE``, or ``kerf`` in the user's cache."""
    own = os.environ.get("KERF_CACHE")
    if own:
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "kerf"


@contextmanager
def replacing(path: Path, *, follow: bool = True) -> Iterator[Path]:
    """Name to write to; the file is moved to ``path`` when all went well, else removed.

    Inside :func:`together` it is moved at its end.  A missing folder is made, permissions are kept,
    and a pipe is written to directly.  With ``follow`` a symbolic link stays and its target is
    replaced. Raises NotWrittenError for a refusal of the system.
    """
    target, part = path, path
    try:
        target = Path(os.path.realpath(path)) if follow else path
        target.parent.mkdir(parents=True, exist_ok=True)
        if follow and target.is_symlink():  # what it leads to leads back to it
            raise OSError(ELOOP, os.strerror(ELOOP))
        if follow and target.exists() and not target.is_file():
            yield path
            return
        part = beside(target)
        _begun.add(part)
        waiting = _held.get()
        moved = False
        try:
            yield part
            _finish(part, target)
            if waiting is None:
                part.replace(target)
            else:
                waiting.append((part, target))
            moved = True
        finally:
            if not moved:
                _remove(part)
            elif waiting is None:
                _begun.discard(part)
    except OSError as error:
        if isinstance(error, NotWrittenError) or not _is_of(error, target, part):
            raise
        raise NotWrittenError(_sentence(path, error)) from error


@contextmanager
def together() -> Iterator[None]:
    """Files that are written inside are moved to their places at its end, or none of them."""
    if _held.get() is not None:
        yield
        return
    waiting: list[tuple[Path, Path]] = []
    token = _held.set(waiting)
    try:
        yield
        while waiting:
            part, target = waiting[0]
            try:
                part.replace(target)
            except OSError as error:
                raise NotWrittenError(_sentence(target, error)) from error
            _begun.discard(part)
            del waiting[0]
    finally:
        _held.reset(token)
        for part, _ in waiting:
            _remove(part)


def written(path: Path) -> Path:
    """Place of a written file: beside its own until :func:`together` ends."""
    target = Path(os.path.realpath(path))
    found = [part for part, place in _held.get() or () if place == target]
    return found[-1] if found else path


def beside(path: Path) -> Path:
    """A name in the folder of a file that no other run and no other file writes to."""
    name = path.name.encode()[:LONGEST].decode(errors="ignore")
    return path.with_name(f".{name}.{os.getpid()}-{next(_numbers)}{PART}")


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the context with exit status 128 + number, as an error would.

    Files that are not whole are removed, at the latest when Python ends.  A signal in a callback,
    where Python raises nothing, ends the run there, as does an interrupt from the keyboard.  An
    ignored signal stays ignored.
    """
    atexit.register(_remove_begun)
    sys.unraisablehook = _end_there
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _end)
    try:
        yield
    except BaseException:
        if _ended:
            raise SystemExit(128 + _ended[0]) from None
        raise


def _end(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)  # a second one finds the way out under way
    _ended.append(number)
    raise SystemExit(128 + number)


def _end_there(unraisable: "sys.UnraisableHookArgs") -> None:
    if _ended and unraisable.exc_type is SystemExit:
        number = _ended[0]
    elif unraisable.exc_type is KeyboardInterrupt:
        number = signal.SIGINT
    else:
        sys.__unraisablehook__(unraisable)
        return
    _remove_begun()
    os._exit(128 + number)


def _remove_begun() -> None:
    for part in list(_begun):
        _remove(part)


def _remove(part: Path) -> None:
    """Remove a file that is not whole, where the system lets go of it: a disk may be read-only."""
    with suppress(OSError):
        part.unlink(missing_ok=True)
    _begun.discard(part)


def remove_folder(folder: Path) -> int:
    """Remove a folder with all in it, if it is there; its bytes."""
    size = sum(one.lstat().st_size for one in folder.rglob("*") if not one.is_dir())
    shutil.rmtree(folder, ignore_errors=True)
    return size


def exchange(one: Path, other: Path) -> None:
    """Swap two files or folders of one file system, so that neither name is ever without one.

    Where the system cannot do both at once (renameat2 of Linux), they are moved one by one.
    """
    swap = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    names = (AT_CWD, os.fsencode(one), AT_CWD, os.fsencode(other))
    if swap is not None and swap(*names, RENAME_EXCHANGE) == 0:
        return
    aside = beside(other)
    other.replace(aside)
    one.replace(other)
    aside.replace(one)


def _finish(part: Path, target: Path) -> None:
    """Bring a file to the disk, with permissions and owner of the one that it replaces."""
    handle = os.open(part, os.O_RDONLY)
    try:
        if target.is_file() and not target.is_symlink():
            before = target.stat()
            with suppress(PermissionError):  # only root gives files away
                os.fchown(handle, before.st_uid, before.st_gid)
            os.fchmod(handle, S_IMODE(before.st_mode))
        os.fsync(handle)
    finally:
        os.close(handle)


def _is_of(error: OSError, target: Path, part: Path) -> bool:
    """Whether an error is one of writing: of these files, or of a file that is open already."""
    names = {str(path) for path in (target, target.parent, part)}
    return error.filename is None or os.fspath(error.filename) in names


def _sentence(path: Path, error: OSError) -> str:
    said = os.strerror(error.errno) if error.errno else str(error)  # Arrow has its own words
    return (
        f"{path} cannot be written ({said}) and is left as it was: make room for it, or name a "
        "file in another folder"
    )


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
        with replacing(place / key) as part:
            part.write_bytes(content)
        entries = sorted(place.iterdir(), key=lambda path: path.stat().st_mtime)
        for old in entries[:-KEPT]:
            old.unlink(missing_ok=True)
    except OSError:
        return
