"""The ledger of a machine: what is scored, once, in which order, and what the command says."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

import pipeline.app.commands  # noqa: F401, its commands
from pipeline.app.kerf import app
from pipeline.monitoring.budget import Budget, MonitoringSettings
from pipeline.monitoring.drift import decided
from pipeline.monitoring.reasons import causes
from pipeline.parameters import read_yaml
from pipeline.schema.bundle import Bundle, BundledModel, bundle_of, copy_bundle
from pipeline.schema.ledger import Night, asks, latest, read_ledger, serving, spent, write_ledger
from pipeline.schema.store import StoreError, write_text
from pipeline.submodels.contract import Target
from tests.bundled_project import MACHINE, SEALED, TRAINING, project, source, spindle
from tests.small_project import inside
from tests.submodels.spindle.spindle_days import ONE, state_table

NIGHTS = ("2026-01-26", "2026-01-27", "2026-01-28")
ONE_NIGHT = Night(
    night=NIGHTS[0], bundle="b", model="m", submodel="spindle", quantity="q", regime="", unit="K",
    records="r", n=1, share=0.5, result="within",
)  # fmt: skip


def ready(root: Path, hot_from: str = "", sealed: bool = False) -> Path:
    """The project with a champion; from the day ``hot_from`` on the sensor reads 9 K too high."""
    project(root, sealed=sealed)
    folder = root / f"data/signals/{MACHINE}"
    files = json.loads((folder / "manifest.json").read_text())
    for number, day in enumerate(NIGHTS, start=20):
        table = state_table(ONE, number, day, 2.0).reset_index()
        table["spindle_temperature"] += 9.0 * bool(hot_from and day >= hot_from)
        table.to_parquet(root / f"data/clean/{MACHINE}/state/{day}.parquet")
        files["files"][source(day).file] = {
            "sha256": source(day).sha256, "last": f"{day}T16:00:00Z", "format": "shdr",
        }  # fmt: skip
    (folder / "manifest.json").write_text(json.dumps(files))
    models = spindle(root)
    copy_bundle(models, bundle_of(models, MACHINE, ["spindle"]), root / f"data/champion/{MACHINE}")
    (root / "conf/machine").mkdir(parents=True)
    write_text("", root / f"conf/machine/{MACHINE}.yaml")
    params = (root / "params.yaml").read_text()
    (root / "params.yaml").write_text(params + "monitoring: {}\n")
    return root


def nightly(root: Path, *words: str) -> tuple[int, str]:
    with inside(root):
        done = CliRunner().invoke(app, ["nightly", "--machine", MACHINE, *words])
    return done.exit_code, done.output


def ledger(root: Path) -> Path:
    return root / f"data/ledger/{MACHINE}.jsonl"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return ready(tmp_path)


def test_frozen_and_training_days_are_never_scored_and_a_night_is_scored_once(
    tmp_path: Path,
) -> None:
    root = ready(tmp_path, sealed=True)
    assert nightly(root)[0] == 0
    found = read_ledger(ledger(root))
    assert NIGHTS[0] == SEALED
    assert sorted({one.night for one in found if one.n}) == list(NIGHTS[1:])
    before = ledger(root).read_bytes()
    assert nightly(root)[0] == 0 and ledger(root).read_bytes() == before


def test_a_lost_working_day_is_named_and_a_stop_of_the_recording_is_not(root: Path) -> None:
    """The machine was learnt on a Monday: the 26th is lost, and the 12th lies in a stop."""
    (root / f"data/clean/{MACHINE}/state/{NIGHTS[0]}.parquet").unlink()
    manifest = root / f"data/signals/{MACHINE}/manifest.json"
    files = json.loads(manifest.read_text())["files"]
    del files[source(NIGHTS[0]).file]
    manifest.write_text(json.dumps({"files": files}))
    assert nightly(root)[0] == 0
    found = read_ledger(ledger(root))
    assert [one.night for one in found if one.result == "no records"] == [NIGHTS[0]]


def test_night_by_night_gives_the_bytes_of_all_at_once(root: Path) -> None:
    nightly(root)
    whole = ledger(root).read_bytes()
    ledger(root).unlink()
    state, aside = root / f"data/clean/{MACHINE}/state", root / "aside"
    aside.mkdir()
    for day in NIGHTS[1:]:
        shutil.move(state / f"{day}.parquet", aside)
    manifest = root / f"data/signals/{MACHINE}/manifest.json"
    every = json.loads(manifest.read_text())["files"]
    for k, day in enumerate(NIGHTS):
        if k:
            shutil.move(aside / f"{day}.parquet", state)
        known = {n: e for n, e in every.items() if e["last"][:10] <= day}
        manifest.write_text(json.dumps({"files": known}))
        nightly(root)
    assert ledger(root).read_bytes() == whole


def test_a_newest_night_whose_records_grew_gets_a_further_line_that_counts(root: Path) -> None:
    nightly(root)
    before = read_ledger(ledger(root))
    manifest = root / f"data/signals/{MACHINE}/manifest.json"
    files = json.loads(manifest.read_text())
    files["files"][source(NIGHTS[-1]).file]["sha256"] = "f" * 64
    manifest.write_text(json.dumps(files))
    path = root / f"data/clean/{MACHINE}/state/{NIGHTS[-1]}.parquet"
    pd.read_parquet(path).iloc[:5400].to_parquet(path)
    nightly(root)
    after = read_ledger(ledger(root))
    assert after[: len(before)] == before and len(after) == len(before) + 1
    assert after[-1].night == NIGHTS[-1] and after[-1].n < before[-1].n
    assert [one for one in latest(after) if one.night == NIGHTS[-1]] == [after[-1]]


def test_the_command_ends_with_3_where_a_night_asks_and_says_why(tmp_path: Path) -> None:
    root = ready(tmp_path, hot_from=NIGHTS[1])
    status, said = nightly(root)
    assert status == 3
    assert "asks for identification" in said and "sensor" in said
    status, text = nightly(root, "--json", "-")
    (night,) = asks(read_ledger(ledger(root)))
    assert status == 3 and night.night == NIGHTS[-1]
    assert json.loads(text[text.index("[") : text.rindex("]") + 1])[-1]["ask"] == "identification"


def test_a_quiet_machine_ends_with_0_and_one_without_nights_says_so(
    root: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    status, said = nightly(root)
    assert status == 0 and "within" in said
    bare = ready(tmp_path_factory.mktemp("bare"))
    for day in NIGHTS:
        (bare / f"data/clean/{MACHINE}/state/{day}.parquet").unlink()
    manifest = bare / f"data/signals/{MACHINE}/manifest.json"
    files = json.loads(manifest.read_text())["files"]
    kept = {n: e for n, e in files.items() if e["last"][:10] == TRAINING}
    manifest.write_text(json.dumps({"files": kept}))
    status, said = nightly(bare)
    assert status == 0 and ledger(bare).read_bytes() == b""
    assert f"no night to score: {MACHINE} has no day after its champion's training" in said
    shutil.rmtree(bare / f"data/champion/{MACHINE}")
    status, said = nightly(bare)
    assert status == 0
    assert f"no night to score: nothing serves {MACHINE}: `dvc repro champion@{MACHINE}`" in said


def test_a_ledger_only_grows_and_a_broken_line_is_named(tmp_path: Path) -> None:
    path = tmp_path / "m.jsonl"
    write_ledger([ONE_NIGHT], path)
    with pytest.raises(StoreError, match="only grows"):
        write_ledger([replace(ONE_NIGHT, n=2)], path)
    assert read_ledger(path) == (ONE_NIGHT,)
    with path.open("a") as file:
        file.write("{}\n")
    with pytest.raises(StoreError, match="line 2"):
        read_ledger(path)


def test_the_budget_spent_is_the_sum_of_the_shares_of_28_nights() -> None:
    nights = [replace(ONE_NIGHT, night=f"2026-03-{k:02d}", share=0.14) for k in range(1, 15)]
    assert spent(nights) == pytest.approx(0.07)
    assert spent([replace(ONE_NIGHT, share=None, result="no records")]) is None


BUDGET = Budget(
    target=Target(quantity="q", unit="K", limits={"mae": 1.0}), allowed={"mae": 1.0},
    shares=(0.4, 0.5, 0.6),
)  # fmt: skip


def asking(share: float, nights: list[float]) -> list[Night]:
    """Nights of two shares alike, then of ``nights``, each decided after those before it."""
    found: list[Night] = []
    for k, one in enumerate([share, share, *nights]):
        night = replace(ONE_NIGHT, night=f"2026-03-{1 + k:02d}", share=one,
                        result="over" if one > 1 else "within")  # fmt: skip
        found += decided([night], found, {night.target: BUDGET}, MonitoringSettings())
    return found


def test_a_fault_that_lasts_is_asked_for_until_the_errors_are_back_for_seven_nights() -> None:
    (lasting,) = asks(asking(2.0, [2.0] * 25))
    assert (lasting.since, lasting.night) == ("2026-03-02", "2026-03-27")
    (within,) = asks(asking(2.0, [0.95] * 25))
    assert within.result == "within", "errors twice those of the judgement are not back"
    assert len(asks(asking(2.0, [0.5] * 5))) == 1
    assert asks(asking(2.0, [0.5] * 7)) == []
    (again,) = asks(asking(2.0, [0.5] * 9 + [2.0, 2.0]))
    assert again.since == "2026-03-13"


def test_a_rise_that_the_test_alarms_on_once_is_asked_for_as_long_as_it_lasts() -> None:
    nights = asking(0.5, [0.5] * 4 + [0.9] * 18)
    first = next(one.night for one in nights if one.ask)
    assert [one.ask for one in nights if one.night >= first] == ["identification"] * sum(
        one.night >= first for one in nights
    )
    assert {one.since for one in nights if one.ask} == {first}


def test_a_cause_is_named_where_the_residuals_tell_it_from_the_others() -> None:
    """Both explain the mean of a warm day; only the rise explains the warming up as well."""
    night = replace(ONE_NIGHT, rmse=1.0)
    quiet = [replace(night, night=f"2026-01-0{k}", rmse=0.1) for k in range(1, 4)]
    rise = {"offset": 0.9**0.5, "temperature_rise": 0.91**0.5, "all": 0.95**0.5}
    assert causes([replace(night, parts=rise)], quiet) == ["temperature_rise", "offset"]
    assert causes([replace(night, parts=rise | {"offset": 0.7**0.5})], quiet) == [
        "temperature_rise"
    ]
    thin = rise | {"offset": 0.84**0.5}
    assert len(causes([replace(night, parts=thin)], quiet)) == 2, "a single night"
    two = [replace(night, night=name, parts=thin) for name in NIGHTS[:2]]
    assert causes(two, quiet) == ["temperature_rise"]
    found = decided([replace(night, parts=rise, share=2.0, result="over")],
                    [*quiet, replace(night, night="2026-01-10", share=2.0, result="over")],
                    {night.target: BUDGET}, MonitoringSettings())  # fmt: skip
    assert found[0].reason == "not known" and "heat or sensor, not clear yet" in found[0].words


def test_an_ask_is_of_the_model_that_serves_and_missing_records_end_with_some() -> None:
    nights = asking(2.0, [])
    lost = replace(ONE_NIGHT, quantity="", night="2026-03-04", share=None, result="no records",
                   ask="records", since="2026-03-04")  # fmt: skip
    assert [one.ask for one in asks([*nights, lost])] == ["identification", "records"]
    back = [replace(ONE_NIGHT, night=night) for night in ("2026-03-05", "2026-03-06")]
    assert asks([*nights, lost, *back]) == []

    def bundle(sha256: str) -> Bundle:
        models = {"spindle": BundledModel(sha256=sha256, status="passed")}
        return Bundle(machine="m", origin="recorded", sha256="b", submodels=models)

    assert serving(nights, bundle("m")) == tuple(nights)
    assert serving(nights, bundle("new")) == serving(nights, None) == ()


def test_settings_out_of_range_are_refused_and_conf_has_the_defaults() -> None:
    with pytest.raises(ValueError, match=r"monitoring.factor = 0.5 1 must lie from 1 to 10"):
        MonitoringSettings(factor=0.5)
    text = (Path(__file__).parents[2] / "conf/monitoring/default.yaml").read_text()
    assert MonitoringSettings(**read_yaml(text)) == MonitoringSettings()


def night_of(number: int, **fields: object) -> Night:
    return replace(ONE_NIGHT, night=f"2026-02-{number:02d}", **fields)  # type: ignore[arg-type]


LOST = {"quantity": "", "unit": "", "n": 0, "share": None, "result": "no records",
        "ask": "records", "reason": "records missing", "since": "2026-02-02"}  # fmt: skip


def test_an_ask_for_records_is_told_by_the_night_that_ends_the_outage() -> None:
    lost = [night_of(1), night_of(2, **LOST), night_of(3, **LOST), night_of(4)]
    assert [one.night for one in asks(lost)] == ["2026-02-03"]
    assert asks([*lost, night_of(5)]) == []
    assert asks([*lost, night_of(3)]) == [], "its records came later"


def test_an_ask_of_a_target_that_is_not_met_any_more_ends() -> None:
    ask = {"ask": "training", "rule": "r", "reason": "heat", "since": "2026-02-01"}
    nights = [night_of(1, regime="free run", **ask), *(night_of(k) for k in range(1, 28))]
    assert [one.regime for one in asks(nights)] == ["free run"]
    assert asks([*nights, night_of(28), night_of(29)]) == []


def test_a_ledger_of_before_an_ask_had_a_first_night_still_grows(tmp_path: Path) -> None:
    path = tmp_path / "ledger.jsonl"
    write_ledger([night_of(1, ask="training", rule="r", reason="heat")], path)
    line = json.loads(path.read_text())
    del line["since"]
    path.write_text(json.dumps(line) + "\n")
    before = path.read_text()
    known = read_ledger(path)
    assert known[0].since == "2026-02-01"
    write_ledger([*known, night_of(2)], path)
    assert path.read_text().startswith(before) and len(read_ledger(path)) == 2
    with pytest.raises(StoreError, match="holds nights that the new ledger lacks"):
        write_ledger([night_of(2)], path)
