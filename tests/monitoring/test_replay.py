"""Replay: what stands, which part explains it, what is ruled out; the command with its page."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.monitoring.replay import Replay, largest_rise, replacements, standing_of
from pipeline.monitoring.replay_parts import parts_of
from pipeline.monitoring.replay_windows import Series
from pipeline.monitoring.state import write_twin_state
from pipeline.parameters import read_params
from pipeline.schema.bundle import bundle_of, copy_bundle
from pipeline.schema.golden import Days
from pipeline.schema.history import Entry, write_history
from pipeline.schema.store import read_json, write_json, write_table
from pipeline.schema.twin_state import MANIFEST, TwinState
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.submodels.cases import Records, Roles
from tests.bundled_project import DAYS, MACHINE, project, spindle
from tests.small_project import inside
from tests.submodels.spindle.spindle_days import ONE, state_table
from tests.test_cli import kerf, refused

GOOD, SPAN = ("g1", "g2"), (1000.0, 2000.0)


@given(st.lists(st.floats(-4, 4), max_size=30))
def test_the_largest_rise_is_the_greatest_sum_of_windows_in_a_row(values: list[float]) -> None:
    z = np.array(values)
    rise, first, after = largest_rise(z)
    every = [sum(z[a:b] ** 2 - 1) for a in range(len(z)) for b in range(a + 1, len(z) + 1)]
    assert rise == pytest.approx(max([0.0, *every]), abs=1e-9)
    assert rise == pytest.approx(sum(z[first:after] ** 2 - 1), abs=1e-9)


def windows(seed: int, **factors: float) -> Series:
    """Cuts of tools 1 and 2 and a spindle that turns free, each load by a factor in the span."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 2000.0, 2.0)
    day = np.where(t < 500, GOOD[0], np.where(t < 1000, GOOD[1], "now"))
    tool, made = np.where(np.arange(len(t)) % 7 < 3, "1", "2"), t >= SPAN[0]
    found = {}
    for name, level in (("cut_load", 40.0), ("no_load_power", 300.0)):
        factor = np.where(made, factors.get(name, 1.0), 1.0)
        factor[made & (tool == "1")] *= factors.get("tool", 1.0) if name == "cut_load" else 1.0
        found[name] = pd.DataFrame({
            "t": t, "day": day, "seconds": 2.0, "estimated": level, "low": 0.9 * level,
            "high": 1.1 * level, "measured": level * (factor + rng.normal(0, 0.04, len(t))),
            "speed": 3000.0, "feed": 10.0, "tool_number": tool, "under": 5.0,
        })  # fmt: skip
    return found


def found_in(series: Series) -> Replay:
    standing = standing_of(series, SPAN, GOOD)
    rows = replacements(standing, parts_of(series, standing.masks, None, standing.begin))
    return Replay(
        machine="m", origin="simulated", first="", last="", days=(), bundle="", version=1,
        previous=None, known_good=GOOD, borrowed="", quantities=standing.quantities,
        replaced=tuple(row for row, *_ in rows), missing={},
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("factors", "named", "part"),
    [
        ({}, (), ""),
        ({"tool": 1.5}, ("cutting",), "force of tool 1"),
        ({"cut_load": 1.4, "no_load_power": 1.4}, ("sensor",), "spindle load"),
        ({"no_load_power": 1.5}, ("cutting",), "no-load power"),
    ],
)
def test_the_part_that_changed_is_named(
    factors: dict[str, float], named: tuple[str, ...], part: str, seed: int
) -> None:
    found = found_in(windows(seed, **factors))
    assert found.named == named, found.sentence
    assert not named or (found.replaced[0].part == part and found.replaced[0].best >= 0.9)


def test_what_would_spoil_a_quantity_that_fits_is_ruled_out() -> None:
    """A display that shows too much would show it without a cut too."""
    found = found_in(windows(0, cut_load=1.4))
    (display,) = [one for one in found.replaced if one.part == "spindle load"]
    assert display.spoilt == "no_load_power" and "cutting" in found.named


def test_a_residual_that_no_part_has_is_explained_by_none() -> None:
    series = windows(0)
    noise = np.random.default_rng(1).normal(0, 0.6, len(series["cut_load"]))
    late = series["cut_load"]["t"] >= SPAN[0]
    series["cut_load"]["measured"] *= 1 + noise * late
    found = found_in(series)
    assert found.stands == ["cut_load"] and found.named == ()
    assert found.sentence == "no sub-model explains the residual of cut load"


def stored(root: Path, last: pd.DataFrame | None = None) -> None:
    """Clean records of a spindle, the last golden day another one, and the state of its twin."""
    clean = root / f"data/clean/{MACHINE}"
    if last is not None:
        last.reset_index().to_parquet(clean / "state/2026-01-22.parquet")
    empty = pa.table({"start": pa.array([], pa.timestamp("ns", "UTC")),
                      "end": pa.array([], pa.timestamp("ns", "UTC")),
                      "kind": pa.array([], pa.string())})  # fmt: skip
    write_table(empty, clean / "segments.parquet")
    pd.DataFrame({"start": pd.DatetimeIndex([], tz="UTC"), "end": pd.DatetimeIndex([], tz="UTC"),
                  "complete": [], "active_s": [], "program": []}).to_parquet(
        clean / "cycles.parquet")  # fmt: skip
    with inside(root):
        folder = Path("data/champion") / MACHINE
        write_twin_state(
            folder, Records.of_machine(Path("data"), MACHINE, folder),
            Path("data/twin_state") / MACHINE, values=read_params(),
            roles=Roles(training_days=Days(first=DAYS[0], last="2026-01-20")),
            cleaning=CleanSettings(), tools={}, sets=None,
        )  # fmt: skip


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A project whose second version serves, better than the first."""
    root = project(tmp_path_factory.mktemp("replay"))
    (root / "conf/machine").mkdir(parents=True)
    (root / f"conf/machine/{MACHINE}.yaml").write_text("")
    params = root / "params.yaml"
    params.write_text(f"{params.read_text()}cleaning: {{}}\n")
    entries: list[Entry] = []
    for version, (home, error_K) in enumerate({"warm": 3.0, "champion": 0.0}.items(), start=1):
        bundle = bundle_of(models := spindle(root, error_K), MACHINE, ("spindle",))
        (root / "data" / home).mkdir(parents=True)
        copy_bundle(models, bundle, root / "data" / home / MACHINE)
        entries.append(Entry(
            machine=MACHINE, number=version, event="promoted" if entries else "first",
            version=version, bundle=bundle.sha256, at=f"2026-01-0{version}T00:00:00Z", by="Kim",
            why="better", before=entries[-1].sha256 if entries else "",
        ))  # fmt: skip
    write_history(entries, root / f"data/history/{MACHINE}.jsonl")
    yield root


def replayed(root: Path, out: Path, *more: str) -> Replay:
    words = ("--from", "2026-01-21", "--to", "2026-01-22", "--out", str(out), *more)
    done = kerf(root, "replay", "--machine", MACHINE, *words)
    assert done.exit_code == 0, done.stderr
    found = read_json(out / "replay.json", Replay)
    assert done.stdout.startswith(found.sentence)
    return found


def test_the_command_names_a_sensor_and_writes_tables_and_page(root: Path, tmp_path: Path) -> None:
    day = state_table(ONE, 4, "2026-01-22", 2.0)
    hours = np.arange(len(day)) / 3600
    stored(root, day.assign(spindle_temperature=day["spindle_temperature"] + 5 + 8 * hours))
    found = replayed(root, tmp_path, "--with", "2026-01-19..2026-01-20")
    assert found.named == ("sensor",) and found.stands == [
        "spindle_temperature",
        "morning_temperature",
    ]
    best = found.replaced[0]
    assert best.part == "temperature drift" and best.borrowed is not None and best.borrowed < 0.1
    assert best.parameters["K more an hour"] == pytest.approx(8, rel=0.1)
    assert (found.version, found.previous) == (2, 1)
    table = pq.read_table(tmp_path / "days/2026-01-22.parquet")
    rows, name = table.to_pandas(), "spindle_temperature"
    assert len(rows) == len(day) and table.schema.field(f"{name}_previous").metadata == {
        b"unit": b"CELSIUS"
    }
    off = {part: (rows[f"{name}_measured"] - rows[f"{name}_{part}"]).abs().median()
           for part in ("estimated", "previous", best.key)}  # fmt: skip
    assert off[best.key] < 1.0 < off["estimated"]
    apart = (rows[f"{name}_previous"] - rows[f"{name}_estimated"]).median()
    assert apart == pytest.approx(3.0, abs=0.6)  # of the ambient that the version before had wrong
    page = (tmp_path / "replay.html").read_text()
    assert "temperature drift" in page and "version before" in page and "simulated" in page


def test_the_command_names_the_spindle_where_its_cooling_is_worse(
    root: Path, tmp_path: Path
) -> None:
    weak = replace(ONE, cooling_rate=0.4 * ONE.cooling_rate)
    stored(root, state_table(weak, 4, "2026-01-22", 2.0))
    found = replayed(root, tmp_path)
    assert found.named == ("spindle",) and "morning_temperature" not in found.stands
    cooling = next(one for one in found.replaced if one.part == "cooling")
    assert cooling.removed > 0.9 and cooling.parameters["× cooling"] == pytest.approx(0.4, rel=0.25)


def test_what_cannot_be_replayed_is_one_sentence(root: Path, tmp_path: Path) -> None:
    stored(root)
    state = root / f"data/twin_state/{MACHINE}" / MANIFEST
    known = read_json(state, TwinState)

    def said(first: str, last: str, *more: str | Path) -> str:
        return refused(root, "replay", "-m", MACHINE, "--from", first, "--to", last, "--out",
                       tmp_path, *more)  # fmt: skip

    assert "no records from 2025-01-01 to 2025-01-02: there are days from" in said(
        "2025-01-01", "2025-01-02"
    )
    assert "'noon' is neither a day nor a time" in said("noon", "2026-01-22")
    assert "names no end after its begin" in said("2026-01-22", "2026-01-21")
    assert "'22.1.2026' is neither a day nor a time" in said("2026-01-21", "22.1.2026")
    lent = ("--with", "2025-01-05..2025-01-09")
    assert "no records in --with 2025-01-05..2025-01-09" in said("2026-01-21", "2026-01-22", *lent)
    back = ("--with", "2026-01-19..2026-01-18")
    assert "names no end after its begin" in said("2026-01-21", "2026-01-22", *back)
    assert "has nothing to compare" in said("2026-01-22T20:00", "2026-01-22T21:00")
    days = {day: replace(one, role="held_out") for day, one in known.days.items()}
    write_json(replace(known, days=days), state)
    assert "has nothing to compare" in said("2026-01-21", "2026-01-22")
    write_json(replace(known, bundle="another"), state)
    assert f"dvc repro state@{MACHINE}" in said("2026-01-21", "2026-01-22")
    write_json(replace(known, days={}), state)
    assert "has no log of its control" in said("2026-01-21", "2026-01-22")
