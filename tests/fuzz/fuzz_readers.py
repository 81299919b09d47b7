"""Coverage-guided fuzzing of the readers that take what comes from outside.

``python tests/fuzz/fuzz_readers.py --runs 100000`` gives each reader that many inputs.  A reader
passes when it raises nothing but UnreadableFile and every batch has read = kept + rejected; an
input that breaks one is written to ``--crashes``.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.fuzz.seeds import DOCUMENTS, LOGS, TREES, WORDS

READERS = {
    "shdr": LOGS,
    "mtconnect_xml": DOCUMENTS,
    "mtconnect_json": TREES,
}
"""Readers, with the corpus that each starts from."""

COMPILED = {
    "pipeline.signals.shdr": ("scan",),
}
"""Modules of compiled functions, which cannot be instrumented; what calls them is."""

LONGEST = 4096
"""Bytes of an input."""


def reader(name: str) -> Callable[..., Any]:
    """The function ``read`` of a reader."""
    from pipeline.signals.mtconnect import json_document as mtconnect_json
    from pipeline.signals.mtconnect import xml_document as mtconnect_xml
    from pipeline.signals.shdr import log as shdr

    return {
        "shdr": shdr.read,
        "mtconnect_xml": mtconnect_xml.read,
        "mtconnect_json": mtconnect_json.read,
    }[name]


def check(read: Callable[..., Any], path: Path, form: str) -> int | None:
    """Read one file; the records read, None when it is refused as a whole.

    Raises
    ------
    AssertionError
        When a batch does not account for what was read.
    """
    from pipeline.signals.columns import OBSERVATIONS
    from pipeline.signals.formats import RecordSource, UnreadableFile

    n = 0
    try:
        for batch in read(path, RecordSource(format=form, files="*"), path.parent):  # type: ignore[arg-type]
            n += batch.read
            if batch.read != batch.kept + len(batch.rejected):
                raise AssertionError(f"{batch.read} read, {batch.kept} kept, {batch.rejected}")
            if not all(rejection.reason for rejection in batch.rejected):
                raise AssertionError("a record is rejected without a reason")
            if not batch.observations.schema.equals(OBSERVATIONS):
                raise AssertionError("a batch is no table of observations")
            batch.observations.validate(full=True)
    except UnreadableFile as error:
        if not str(error):
            raise AssertionError("a file is refused without a reason") from error
        return None
    return n


def fuzz(name: str, runs: int, *, seed: int, limit: int, crashes: Path) -> None:
    """Fuzz one reader, ``limit`` seconds an input at most; ends the process."""
    import atheris

    folder = Path(tempfile.mkdtemp())
    corpus = folder / "corpus"
    corpus.mkdir()
    compiled = [f"{room}.{module}" for room, modules in COMPILED.items() for module in modules]
    with atheris.instrument_imports(include=["pipeline.signals"], exclude=compiled):
        read = reader(name)
        # Reading the corpus imports and compiles what a reader needs only when called, so that
        # no input is charged for it.
        for number, data in enumerate(READERS[name]):
            (corpus / str(number)).write_bytes(data)
            check(read, corpus / str(number), name)
    words = (w.encode("utf-8", "surrogatepass") for w in WORDS)
    lines = ['"' + "".join(f"\\x{byte:02x}" for byte in word) + '"\n' for word in words]
    (folder / "words").write_text("".join(lines))
    path = folder / "input"

    counts = {"inputs": 0, "accepted": 0}

    def one_input(data: bytes) -> None:
        path.write_bytes(data)
        accepted = check(read, path, name) is not None
        counts["inputs"] += 1
        counts["accepted"] += accepted
        if counts["inputs"] == runs:
            sys.stdout.write(f"{runs} inputs, {counts['accepted']} accepted as a file\n")
            sys.stdout.flush()

    crashes.mkdir(parents=True, exist_ok=True)
    options = [f"-atheris_runs={runs}", f"-max_len={LONGEST}", f"-seed={seed}", f"-timeout={limit}",
               f"-dict={folder / 'words'}", f"-artifact_prefix={crashes}/{name}-",
               "-print_final_stats=1", "-verbosity=0"]  # fmt: skip
    atheris.Setup([sys.argv[0], *options, str(corpus)], one_input)
    atheris.Fuzz()


def main() -> None:
    """Fuzz one reader, or each in a process of its own."""
    parser = argparse.ArgumentParser(description="Fuzz the readers of logs and documents.")
    parser.add_argument("--runs", type=int, default=100_000, help="inputs for each reader")
    parser.add_argument("--reader", choices=READERS, help="only this one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=int, default=20, help="seconds for one input, 1 or more")
    parser.add_argument("--crashes", type=Path, default=Path(tempfile.gettempdir()) / "kerf-fuzz")
    asked = parser.parse_args()
    if asked.reader:
        fuzz(asked.reader, asked.runs, seed=asked.seed, limit=asked.limit, crashes=asked.crashes)
    broken = 0
    for name in READERS:
        start = perf_counter()
        options = ["--runs", asked.runs, "--seed", asked.seed, "--limit", asked.limit,
                   "--crashes", asked.crashes]  # fmt: skip
        done = subprocess.run(
            [sys.executable, __file__, "--reader", name, *map(str, options)],
            capture_output=True, text=True, errors="replace", check=False,
        )  # fmt: skip
        seconds = perf_counter() - start
        said = done.stdout.strip() or "broke off"
        sys.stdout.write(f"{name}: {said}, {seconds:.0f} s\n")
        if done.returncode:
            sys.stdout.write(f"{done.stderr}\nCRASH, the input is in {asked.crashes}\n")
        sys.stdout.flush()
        broken += done.returncode != 0
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
