"""Files to write: none of them may replace what is read, or another of them."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.app.fleet import CONF


def check_outputs(
    program: Path, *outputs: Path | None, inputs: Sequence[Path] = ()
) -> None:  # fmt: skip
    """Refuse files that cannot be written, or would replace what is read or each other.

    Parameters
    ----------
    program : Path
        Part program.
    *outputs : Path or None
        Files to write.
    inputs : sequence of Path
        Other files that are read.

    Raises
    ------
    ValueError
        With the file's name.
    """
    for path in outputs:
        if path is None:
            continue
        if _same(path, program):
            raise ValueError(f"{path} is the program itself: name another file to write")
        if path.is_dir():
            raise ValueError(f"{path} is a folder: name a file in it")
        if not path.parent.is_dir():
            raise ValueError(f"{path.parent} does not exist: make that folder first")
        if any(_same(path, read) for read in inputs):
            raise ValueError(f"{path} is read for the cut: name another file to write")
        if CONF.resolve() in path.resolve().parents:
            raise ValueError(f"{path} is in {CONF}, which is read: name a file elsewhere")
    written = [path for path in outputs if path is not None]
    for i, path in enumerate(written):
        ordinary = path.is_file() or not path.exists()  # not /dev/null
        if ordinary and any(_same(path, other) for other in written[:i]):
            raise ValueError(f"{path} is named for two outputs: name a file for each")
    for path in written:
        _check_writable(path)


def _same(path: Path, other: Path) -> bool:
    if path.exists() and other.exists():
        return path.samefile(other)
    return path.resolve() == other.resolve()


def _check_writable(path: Path) -> None:
    """Open the file to write, as nothing else says it of every file system; leave it as it is."""
    if path.exists() and not path.is_file():
        return
    try:
        if path.exists():
            path.open("ab").close()
        else:
            path.open("xb").close()
            path.unlink()
    except OSError as error:
        raise ValueError(
            f"{path} cannot be written ({error.strerror}): name a file in a folder that you may "
            "write to"
        ) from error
