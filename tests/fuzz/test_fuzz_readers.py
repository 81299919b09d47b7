"""Whatever bytes come, a reader accounts for them or refuses the file with a reason."""

import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.fuzz_readers import COMPILED, READERS, check, reader
from tests.fuzz.seeds import WORDS

PROGRAM = Path(__file__).with_name("fuzz_readers.py")
BYTES = st.one_of(
    st.sampled_from([w.encode("utf-8", "surrogatepass") for w in WORDS]),
    st.binary(max_size=8),
    st.sampled_from([b"\n", b"\r\n", b" ", b"|", b"<", b">", b"/", b'"', b"&", b"\0", b"\xff"]),
)


@st.composite
def mutations(draw: st.DrawFn, corpus: tuple[bytes, ...]) -> bytes:
    """A file of the corpus, cut, mixed with others and with words put in or over it."""
    data = draw(st.sampled_from(corpus))
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, len(data)))
        upto = min(len(data), at + draw(st.sampled_from([0, 0, 1, 3, 20, 200])))
        match draw(st.integers(0, 4)):
            case 0:
                data = data[:at]
            case 1:
                data = data[:at] + draw(st.sampled_from(corpus))[: draw(st.integers(0, 500))]
            case 2:
                data = data[:upto] + data[at:]  # said twice
            case _:
                data = data[:at] + draw(BYTES) + data[upto:]
    return data


@pytest.fixture(params=READERS)
def way(request: pytest.FixtureRequest) -> Iterator[str]:
    yield request.param


@pytest.mark.parametrize("examples", [40, pytest.param(1000, marks=pytest.mark.proof)])
def test_every_input_is_accounted_for(examples: int, way: str, tmp_path: Path) -> None:
    path = tmp_path / "input"

    @settings(max_examples=examples, deadline=None)
    @given(mutations(READERS[way]))
    def accounted(data: bytes) -> None:
        path.write_bytes(data)
        check(reader(way), path, way)

    accounted()


def test_the_corpus_is_read(way: str, tmp_path: Path) -> None:
    """Who starts from files that are all refused finds nothing."""
    for number, data in enumerate(READERS[way]):
        (tmp_path / str(number)).write_bytes(data)
        assert check(reader(way), tmp_path / str(number), way), number


def test_compiled_modules_are_known_to_the_program() -> None:
    for room, modules in COMPILED.items():
        for module in modules:
            assert importlib.import_module(f"{room}.{module}")


def fuzzed(tmp_path: Path, *options: str) -> list[str]:
    """Lines that the program says of 200 inputs for a reader, an hour at most for each."""
    pytest.importorskip("atheris", reason="atheris has no build for this machine")
    done = subprocess.run(
        [sys.executable, PROGRAM, "--runs", "200", "--limit", "3600", "--crashes",
         tmp_path / "crashes", *options],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.splitlines()


def test_the_program_fuzzes_a_reader(tmp_path: Path) -> None:
    (line,) = fuzzed(tmp_path, "--reader", "shdr")
    assert_some_read(line, tmp_path)


@pytest.mark.proof
def test_the_program_fuzzes_every_reader(tmp_path: Path) -> None:
    lines = fuzzed(tmp_path)
    assert [line.partition(":")[0] for line in lines] == list(READERS)
    for line in lines:
        assert_some_read(line, tmp_path)


def assert_some_read(line: str, tmp_path: Path) -> None:
    accepted = int(line.split("inputs, ")[1].split()[0])
    assert 20 < accepted < 200, line  # some are read, some refused
    assert not list((tmp_path / "crashes").glob("*"))
