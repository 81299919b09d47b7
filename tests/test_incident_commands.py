"""The stages of monitoring and its commands in a project: what is said, written and sent."""

import json
from collections.abc import Iterator
from email import message_from_string, policy
from pathlib import Path

import pytest

from pipeline.schema.incident import Monitored
from pipeline.schema.store import read_json
from pipeline.stages.__main__ import run
from tests.monitoring.test_delivery import receiver
from tests.monitoring.test_incidents import MONDAY, alarms, made, put
from tests.small_project import MACHINE, inside, new_project
from tests.test_cli import kerf, refused


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A project whose machine was overloaded on a Monday, and had an alarm three times."""
    root = new_project(tmp_path_factory.mktemp("project"))
    state, clean = root / f"data/twin_state/{MACHINE}", root / f"data/clean/{MACHINE}"
    made(state, {MONDAY: put("spindle_load", 3600, 60, 140.0)})
    clean.mkdir(parents=True)
    days = ("2026-01-05T08:00", "2026-01-08T09:00", "2026-01-09T07:00")
    alarms(clean, *(("x", "fault", day, 2.0) for day in days))
    with inside(root):
        run(f"identify_monitoring@{MACHINE}", *(f"data/{name}/{MACHINE}"
            for name in ("twin_state", "clean", "usual")))  # fmt: skip
        monitor()
    yield root


def monitor() -> bytes:
    written = Path(f"data/incidents/{MACHINE}.json")
    names = ("twin_state", "signals", "clean", "usual")
    run(f"monitor@{MACHINE}", *(f"data/{name}/{MACHINE}" for name in names), str(written))
    return written.read_bytes()


def test_the_stages_write_the_same_bytes_again(project: Path) -> None:
    with inside(project):
        first, again = Path(f"data/incidents/{MACHINE}.json").read_bytes(), monitor()
    assert first == again
    found = read_json(project / f"data/incidents/{MACHINE}.json", Monitored)
    assert {one.component for one in found.incidents} >= {"spindle drive", "x"}
    assert found.origin == "simulated" and len(found.known_good) == 3


def test_incidents_are_listed_as_table_lines_and_e_mail(project: Path, tmp_path: Path) -> None:
    said = kerf(project, "incidents", "--machine", MACHINE)
    assert said.exit_code == 3 and "Spindle load over its limit" in said.stdout
    assert "not assessed: x following error: not logged" in said.stdout
    lines, mail = tmp_path / "i.jsonl", tmp_path / "mail.txt"
    kerf(project, "incidents", "-m", MACHINE, "--lines", lines, "--email", mail)
    every = [json.loads(one) for one in lines.read_text().splitlines()]
    assert len(every) >= 2 and all(one["machine"] == MACHINE for one in every)
    message = message_from_string(mail.read_text(), policy=policy.default)
    assert message["Subject"].startswith(f"{MACHINE}: 2 to act on")
    late = kerf(project, "incidents", "-m", MACHINE, "--since", "2026-02-01")
    assert late.exit_code == 0 and "no incident" in late.stdout
    assert "--since tomorrow is no day" in refused(
        project, "incidents", "-m", MACHINE, "--since", "tomorrow"
    )


def test_incidents_are_delivered_once_by_the_command(project: Path) -> None:
    with receiver(500) as to:
        words = ("deliver", "-m", MACHINE, "--webhook", to.url, "--since", MONDAY)
        first, again = kerf(project, *words), kerf(project, *words)
        n = to.counted  # of the drive and of the cut
        assert first.exit_code == again.exit_code == 0 and len(to.requests) == n + 1 == 3
        assert f"{n} incidents delivered" in first.stdout and "token" not in first.stdout
        assert "0 incidents delivered" in again.stdout and f"{n} before" in again.stdout
    gone = kerf(project, *words[:4], "http://127.0.0.1:9/x", "--attempts", "1")
    assert gone.exit_code == 1 and "not delivered in 1 attempt" in gone.stdout


def test_incidents_that_were_not_looked_for_are_refused_with_the_stage(project: Path) -> None:
    path = project / f"data/incidents/{MACHINE}.json"
    held = path.read_bytes()
    try:
        path.unlink()
        assert f"dvc repro monitor@{MACHINE}" in refused(project, "incidents", "-m", MACHINE)
    finally:
        path.write_bytes(held)
