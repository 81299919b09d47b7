"""Files are written whole: a failure, a full disk or a signal leaves what was there."""

import errno
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pytest

from pipeline.schema import files
from pipeline.schema.files import NotWrittenError, replacing, together, written
from pipeline.schema.store import write_bytes, write_table, write_text


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """A disk on which no file grows beyond ``size`` bytes: write() refuses, as on a full one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    found = tmp_path / "x.nc"
    found.write_text("old")
    return found


def alone(path: Path, text: str) -> bool:
    """Whether the folder holds the file with that text and nothing else."""
    return [p.name for p in path.parent.iterdir()] == [path.name] and path.read_text() == text


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, pa.ArrowInvalid])
def test_what_breaks_while_writing_leaves_the_old_file(path: Path, error: type) -> None:
    with pytest.raises(error), replacing(path) as part:
        part.write_text("half")
        raise error("broken")
    assert alone(path, "old")


def test_a_full_disk_leaves_the_old_file_and_names_it(path: Path) -> None:
    table = pa.table({"x": pa.array(range(100_000))})
    for write in (
        lambda: write_bytes(b"1" * 9000, path),
        lambda: write_text("1" * 9000, path),
        lambda: write_table(table, path),
    ):
        with largest_file(4096), pytest.raises(NotWrittenError) as error:
            write()
        said = str(error.value)
        assert said.startswith(f"{path} cannot be written (") and "\n" not in said
        assert "(File too large)" in said
        assert alone(path, "old")


def test_a_disk_that_becomes_read_only_is_one_sentence_and_nothing_at_the_exit(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(part: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(part))

    with monkeypatch.context() as patched, pytest.raises(NotWrittenError, match="Read-only"):
        patched.setattr(Path, "replace", refuses)
        patched.setattr(Path, "unlink", refuses)
        with replacing(path) as part:
            part.write_text("new")
    assert not files._begun  # or Python's exit would print a traceback for it
    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", refuses)
        files._begun.add(path)
        files._remove_begun()


def test_an_error_of_another_file_is_not_said_to_be_of_this_one(path: Path) -> None:
    with pytest.raises(FileNotFoundError), replacing(path):
        (path.parent / "none").read_text()


def test_permissions_stay_and_a_link_stays_a_link(path: Path) -> None:
    path.chmod(0o604)
    write_text("new", path)
    assert alone(path, "new") and path.stat().st_mode & 0o777 == 0o604
    link = path.parent / "links/here.nc"
    link.parent.mkdir()
    link.symlink_to("../x.nc")
    write_text("newer", link)
    assert link.is_symlink() and path.read_text() == "newer"
    assert [p.name for p in link.parent.iterdir()] == ["here.nc"]
    dangling = path.parent / "links/there.nc"
    dangling.symlink_to("../y.nc")
    write_text("made", dangling)
    assert dangling.is_symlink() and (path.parent / "y.nc").read_text() == "made"
    with replacing(link, follow=False) as part:
        part.write_text("plain")
    assert not link.is_symlink() and path.read_text() == "newer"


def test_a_new_file_has_the_permissions_of_any_other(tmp_path: Path) -> None:
    write_text("1", tmp_path / "a")
    (tmp_path / "b").write_text("1")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode


def test_a_link_that_leads_nowhere_is_one_sentence(tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to("loop")
    for path in (loop, tmp_path / "loop/x"):
        with pytest.raises(NotWrittenError, match="cannot be written"):
            write_text("1", path)


def test_the_longest_name_that_a_file_may_have(tmp_path: Path) -> None:
    write_text("1", tmp_path / ("ü" * 127))
    assert [p.name for p in tmp_path.iterdir()] == ["ü" * 127]


def test_a_pipe_is_written_to(tmp_path: Path) -> None:
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
    reader.start()
    write_text("through", pipe)
    reader.join()
    assert got == ["through"] and pipe.is_fifo()
    write_text("gone", Path("/dev/null"))


def test_files_written_together_appear_together_or_not_at_all(path: Path) -> None:
    other = path.with_name("y.json")
    with together():
        write_text("new", path)
        write_text("other", other)
        assert path.read_text() == "old" and not other.exists()
        assert written(path).read_text() == "new" and written(other).read_text() == "other"
    assert path.read_text() == "new" and other.read_text() == "other" and written(path) == path
    with largest_file(4096), pytest.raises(NotWrittenError, match=r"y\.json"), together():
        write_text("newer", path)
        write_text("1" * 9000, other)
    assert path.read_text() == "new" and other.read_text() == "other"
    assert len(list(path.parent.iterdir())) == 2


def test_many_at_once_leave_one_of_their_files(path: Path) -> None:
    texts = [str(k) * 100_000 for k in range(8)]
    writers = [threading.Thread(target=write_text, args=(text, path)) for text in texts]
    for one in writers:
        one.start()
    while any(one.is_alive() for one in writers):
        assert path.read_text() in ("old", *texts)
    assert path.read_text() in texts and alone(path, path.read_text())


def heeded() -> None:
    """Signals end a process again, whatever who runs the tests ignores (``nohup``, ``&``)."""
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)


WRITER = """
import sys, time
from pathlib import Path
from pipeline.schema.files import ended_by_signals, replacing
with ended_by_signals(), replacing(Path(sys.argv[1])) as part, part.open("w") as file:
    file.write("half")
    file.flush()
    print("here", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGINT, -2)]
)
def test_a_signal_leaves_the_old_file_and_nothing_beside_it(
    path: Path, number: int, status: int
) -> None:
    done = subprocess.Popen(
        [sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        preexec_fn=heeded,
    )  # fmt: skip
    assert done.stdout is not None and done.stdout.readline() == b"here\n"
    assert len(list(path.parent.iterdir())) == 2
    begin = time.monotonic()
    done.send_signal(number)
    assert done.wait(timeout=30) == status and time.monotonic() - begin < 30
    assert alone(path, "old")
