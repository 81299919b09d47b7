"""Every `kerf …` of README and docs is a command with its options; those that are cheap run."""

import re
import shlex
import shutil
from itertools import pairwise
from pathlib import Path

import pytest
from typer.main import get_command

import pipeline.app.commands
import pipeline.app.incident_commands
import pipeline.app.life_commands
import pipeline.app.program_commands  # noqa: F401, its commands
from pipeline.app.commands import app
from tests.small_project import new_project
from tests.test_cli import kerf

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PART = "G21 G90 G17\nG54\nT4 M6\nS5000 M3\nG0 X-20 Y20 Z5\nG1 Z-2 F500\nX50 F1200\nM30\n"
QUICK = {
    "interpret", "simulate", "check", "preflight", "status", "machine schema", "fleet simulated",
}  # fmt: skip
"""Commands that run here; of those below, tests of their own run each."""
MODELS = "asks an identified model"
MINUTES = "takes a minute and an identified model"
RECORDS = "reads records that the user has"
ELSEWHERE = {
    "thermal-growth": MODELS, "fleet": "names the user's own fleet", "golden": RECORDS,
    "identify": "fits what the pipeline built", "worker": "works until a scheduler ends",
    "ingest": RECORDS, "machine new": RECORDS, "optimise": MINUTES, "predict": MODELS,
    "promote": MODELS, "rollback": MODELS, "history": MODELS,
    "records": RECORDS, "report": "draws what the pipeline built",
    "simulate --corrected": MODELS, "synthesise": MODELS, "transfer": MODELS,
    "verify": "reads pages that the pipeline built", "wear": MODELS,
    "nightly": MODELS, "chatter": RECORDS, "incidents": MODELS, "deliver": MODELS,
    "replay": MODELS,
}  # fmt: skip
"""Why the others do not run here."""


AGAIN = (["machine", "schema"], ["fleet", "simulated"])
"""Commands that the ordinary suite runs elsewhere: with ``--page``, and among those of fleets."""


def cheap(words: list[str]) -> bool:
    """Whether a command runs here."""
    corrected = "--corrected" in words
    return (words[0] in QUICK or " ".join(words[:2]) in QUICK) and not corrected


def commands() -> list[list[str]]:
    """Words of each command in a block of the pages, once."""
    found: dict[str, list[str]] = {}
    for page in PAGES:
        for block in re.findall(r"^```(?:sh|bash)\n(.*?)^```", page.read_text(), re.M | re.S):
            for line in block.replace("\\\n", " ").splitlines():
                if line.startswith("kerf "):
                    words = [w for w in shlex.split(line, comments=True) if w != "…"]
                    found[" ".join(words)] = words[1:]
    return list(found.values())


COMMANDS = commands()
RUN = [one for one in COMMANDS if cheap(one)]


def test_the_pages_hold_commands() -> None:
    names = {one[0] for one in COMMANDS}
    assert (
        len(COMMANDS) > 25
        and {"ingest", "optimise", "promote", "wear", "interpret", "check"} <= names
    )
    assert len(RUN) > 11


def test_a_command_that_does_not_run_here_has_a_reason() -> None:
    left = [one for one in COMMANDS if not cheap(one)]
    names = {
        f"{one[0]} --corrected" if one[0] == "simulate" else
        " ".join(one[:2]) if one[0] == "machine" else one[0]
        for one in left
    }  # fmt: skip
    assert names == set(ELSEWHERE)


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_documented_command_is_one(words: list[str]) -> None:
    group = get_command(app)
    assert words[0] in group.commands, f"there is no kerf {words[0]}"  # type: ignore[attr-defined]
    command = group.commands[words[0]]  # type: ignore[attr-defined]
    command.make_context(words[0], words[1:])  # raises at an option or choice that there is not


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = new_project(tmp_path_factory.mktemp("documented") / "project")
    shutil.copy(ROOT / "champions.json", folder)
    places = ["part.nc", "faster.nc", "data/raw/mill00/parts/O5181.nc"]
    places += [word for words in RUN for word in words[1:] if re.search(r"\.nc$", word, re.I)]
    for place in places:
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(PART)
    return folder


@pytest.mark.parametrize(
    "words",
    [pytest.param(one, marks=pytest.mark.proof) if one in AGAIN else one for one in RUN],
    ids=" ".join,
)
def test_a_cheap_documented_command_runs(words: list[str], project: Path) -> None:
    done = kerf(project, *words)
    assert done.exit_code == 0, done.output
    for option, value in pairwise(words):
        if option in ("--out", "--json", "--page"):
            assert (project / value).stat().st_size > 0
