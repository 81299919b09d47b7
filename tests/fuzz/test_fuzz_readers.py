"""Whatever bytes come, a reader accounts for them or refuses the file with a reason."""

import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.signals.mtconnect import xml_document
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
    before = xml_document.FAST_FROM
    yield request.param
    xml_document.FAST_FROM = before


def form(way: str) -> str:
    return "shdr" if way.startswith("shdr") else way.removesuffix("_fast")


@settings(
    max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_every_input_is_accounted_for(data: st.DataObject, way: str, tmp_path: Path) -> None:
    path = tmp_path / "input"
    path.write_bytes(data.draw(mutations(READERS[way])))
    check(reader(way), path, form(way))


def test_the_corpus_is_read(way: str, tmp_path: Path) -> None:
    """Who starts from files that are all refused finds nothing."""
    for number, data in enumerate(READERS[way]):
        (tmp_path / str(number)).write_bytes(data)
        assert check(reader(way), tmp_path / str(number), form(way)), number


def test_compiled_modules_are_known_to_the_program() -> None:
    for room, modules in COMPILED.items():
        for module in modules:
            assert importlib.import_module(f"{room}.{module}")


def test_the_program_runs(tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="atheris has no build for this machine")
    done = subprocess.run(
        [sys.executable, PROGRAM, "--runs", "200", "--crashes", tmp_path / "crashes"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    lines = done.stdout.splitlines()
    assert [line.partition(":")[0] for line in lines] == list(READERS)
    for line in lines:
        accepted = int(line.split("inputs, ")[1].split()[0])
        assert 20 < accepted < 200, line  # some are read, some refused
    assert not list((tmp_path / "crashes").glob("*"))
