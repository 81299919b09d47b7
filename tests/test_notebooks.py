"""The notebooks: one question each, no definitions, no outputs kept, and they run."""

import ast
import json
import os
import shutil
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from jupyter_client import KernelManager
from nbclient import NotebookClient

from pipeline.app.fleet import machine_parameters, use_fleet
from pipeline.machine.control.parameters import ControlParameters
from pipeline.parameters import structure
from pipeline.schema.store import write_json
from pipeline.stages.__main__ import run
from tests import bundled_project
from tests.small_project import MACHINE, ROOT, build, change, inside, new_project, store
from tests.submodels.cutting import cutting_files
from tests.submodels.spindle import spindle_days
from tests.submodels.synthesis import generated_lives
from tests.test_program_commands import control_model

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
RECORDINGS = os.environ.get("KERF_RECORDINGS")
WEEK = "01_a_week_of_the_machine.ipynb"
EXPLAINED = "03_which_wear_explains_a_recording.ipynb"
HEAT = "04_what_heats_this_spindle.ipynb"
TIME = "05_where_does_a_programs_time_go.ipynb"
LOAD = "06_how_sure_is_the_load.ipynb"
CHALLENGER = "07_is_the_challenger_better.ipynb"
ONE_MORE = "08_what_would_one_more_recording_tell.ipynb"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.name)
def test_notebooks_are_numbered_and_hold_no_output(path: Path) -> None:
    assert path.name[:2].isdigit() and path.name[2] == "_"
    cells = nbformat.read(path, as_version=4).cells
    assert cells[0].cell_type == "markdown" and cells[0].source.splitlines()[0].endswith("?")
    for cell in cells:
        if cell.cell_type == "code":
            assert cell.outputs == [] and cell.execution_count is None


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.name)
def test_notebooks_define_nothing(path: Path) -> None:
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "code":
            found = [n for n in ast.walk(ast.parse(cell.source)) if isinstance(n, kinds)]
            assert not found, f"{path.name} defines {found[0]}: move it to its room"


KERNEL = KernelManager()
"""One process for all notebooks: its libraries take longer to load than most notebooks to run."""


@pytest.fixture(scope="module", autouse=True)
def kernel() -> Iterator[None]:
    yield
    if KERNEL.has_kernel:
        KERNEL.shutdown_kernel(now=True)


def executed(project: Path, name: str, asked: str) -> tuple[list[Any], Any]:
    """Outputs of a notebook that runs in its folder, and what ``asked`` is after its last cell.

    It begins without a name of those that ran before it.
    """
    folder = project / "notebooks"
    folder.mkdir(exist_ok=True)
    shutil.copy(ROOT / "notebooks" / name, folder)
    notebook = nbformat.read(folder / name, as_version=4)
    said = nbformat.v4.new_code_cell(f"import json\nprint(json.dumps({asked}))")
    notebook.cells.append(said)
    begin = f"%reset -f\nimport os\nos.chdir({str(folder)!r})\ndel os"
    notebook.cells.insert(0, nbformat.v4.new_code_cell(begin))
    NotebookClient(notebook, km=KERNEL, timeout=120).execute()
    outputs = [o for cell in notebook.cells if cell.cell_type == "code" for o in cell.outputs]
    return outputs, json.loads(outputs[-1].text)


def images(outputs: list[Any]) -> int:
    return sum("image/png" in output.get("data", {}) for output in outputs)


SAID = (
    "[hours.sum(axis=1).tolist(), float(hours.get('ACTIVE', hours.sum(axis=1)).sum()), len(cycles),"
    " int(table['cycles'].sum()), machine]"
)


def last_week(clean: Path) -> list[Path]:
    """State tables of the last ISO week on record."""
    days = sorted((clean / "state").iterdir())
    last = date.fromisoformat(days[-1].stem).isocalendar()[:2]
    return [p for p in days if date.fromisoformat(p.stem).isocalendar()[:2] == last]


def active_hours(week: list[Path]) -> float:
    states = [pq.read_table(p, columns=["execution"]) for p in week]
    return sum(t["execution"].to_pylist().count("ACTIVE") for t in states) / 3600


def held_against_the_tables(project: Path, machine: str) -> str:
    """Execute the week's notebook and hold it against the clean tables; what it printed first."""
    clean = project / "data/clean" / machine
    outputs, (days, active, cycles, counted, said) = executed(project, WEEK, SAID)
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]
    assert images(outputs) == 3
    assert said == machine
    week = last_week(clean)
    assert days == pytest.approx([24.0] * len(week))
    assert active == pytest.approx(active_hours(week))
    starts = pq.read_table(clean / "cycles.parquet")["start"].to_pandas()
    monday = pd.Timestamp(week[0].stem, tz="UTC")
    assert cycles == counted == int((starts >= monday).sum()) > 0
    return str(outputs[0].text)


def test_a_week_of_a_simulated_machine(tmp_path: Path) -> None:
    """Three days of a second week, and one of the week before that does not count."""
    project = new_project(tmp_path / "project")
    clean, starts = project / "data/clean" / MACHINE, []
    (clean / "state").mkdir(parents=True)
    for k, day in enumerate(("2026-01-09", "2026-01-12", "2026-01-13", "2026-01-15")):
        time = pd.date_range(f"{day}T06:00:00Z", periods=3600, freq="s", name="time")
        execution = np.repeat(["READY", "ACTIVE", None], [900, 2000 + k, 700 - k])
        values = {"spindle_speed": 3000.0, "spindle_temperature": 30.0 + k}
        frame = pd.DataFrame({"time": time, "execution": execution, **values})
        frame.to_parquet(clean / f"state/{day}.parquet")
        starts += [time[900], time[1800]]
    cycles = {"cycle": range(len(starts)), "program": ["O1", None] * 4, "start": starts}
    ends = {"active_s": 600.0, "complete": True, "tool_changes": 2}
    pd.DataFrame({**cycles, **ends}).to_parquet(clean / "cycles.parquet")
    said = held_against_the_tables(project, MACHINE)
    assert said.startswith(f"{MACHINE}: ") and ", simulated" in said


@pytest.mark.proof
def test_a_week_of_a_machine_that_was_built(tmp_path: Path) -> None:
    project = new_project(tmp_path / "project")
    none = {"recorded": False}  # of which the state of the machine has nothing
    change(project, f"machine.{MACHINE}.shop", cutting=none, drives=none, growth=none)
    build(project, "shop", "ingest", "clean")
    said = held_against_the_tables(project, MACHINE)
    assert said.startswith(f"{MACHINE}: ") and ", simulated" in said


@pytest.mark.proof
@pytest.mark.skipif(not RECORDINGS, reason="KERF_RECORDINGS names no folder of recordings")
def test_a_day_of_a_recorded_machine(tmp_path: Path) -> None:
    project = new_project(tmp_path / "project")
    machine, found = "mazak01", Path(str(RECORDINGS)) / "nist_mazak01"
    day = sorted(found.glob("week_*/*.txt"), key=lambda path: path.stat().st_size)[-1]
    raw = project / "data/raw" / machine
    for path in (found / "Devices.xml", day):
        target = raw / path.relative_to(found)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.symlink_to(path)
    with inside(project):
        use_fleet("recorded")
        run("compose", "conf", "params.yaml", "data/settings")
        change(project, "fleet", machines=[machine], submodels={}, optimised=[])
        for stage, folders in (("ingest", ("raw", "signals")), ("clean", ("signals", "clean"))):
            run(f"{stage}@{machine}", *(f"data/{folder}/{machine}" for folder in folders))
    said = held_against_the_tables(project, machine)
    assert ", recorded" in said and "NIST" in said


@pytest.fixture(scope="module")
def with_generator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a small generator of signals, and the lives that it is held against."""
    project = tmp_path_factory.mktemp("wear") / "project"
    built = generated_lives.once(tmp_path_factory)
    shutil.copytree(built.signals, project / "data/signals/rig")
    shutil.copytree(built.folder, project / "data/models/rig/synthesis")
    records = {
        "recordings": ["wear/*.parquet"],
        "channels": {"force": {"column": "force", "quantity": "force"},
                     "vibration": {"column": "vibration", "quantity": "acceleration"}},
        "wear": {"name": "wear"}, "tool": "tool", "progress": "time_in_cut",
        "continuous": {"feed": "mm/min", "time_in_cut": "min"}, "discrete": ["cut_type"],
        "table": {"file": "wear/lives.csv", "key": "file"}, "rate_Hz": 1000.0, "length": 100,
    }  # fmt: skip
    (project / "params.yaml").write_text(
        json.dumps({"machine": {"rig": {"wear_records": records}}})
    )
    return project


def test_the_wear_that_explains_a_recording(with_generator: Path) -> None:
    asked = "[error, guess, table['tool'].tolist(), len(explanations)]"
    outputs, (error, guess, tools, many) = executed(with_generator, EXPLAINED, asked)
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]
    assert images(outputs) == 2
    assert many == len(tools) >= 4
    assert set(tools) <= set(generated_lives.HELD_OUT)
    assert error < guess


def outputs_of(project: Path, name: str, asked: str, pictures: int) -> Any:
    """What ``asked`` is after a notebook that drew its pictures and said no warning."""
    outputs, answer = executed(project, name, asked)
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]
    assert images(outputs) == pictures
    return answer


def test_what_heats_a_spindle_of_known_sources(tmp_path: Path) -> None:
    bundled_project.spindle(bundled_project.project(tmp_path))
    shares, days = outputs_of(tmp_path, HEAT, "[shares.mean().to_dict(), len(heats)]", 2)
    assert days == len(bundled_project.DAYS)
    assert sum(shares.values()) == pytest.approx(100)
    heating = spindle_days.ONE.heating
    assert all((shares[name] > 0) == (heating.get(name, 0.0) > 0) for name in shares)


def test_the_challenger_that_errs_less_is_better(tmp_path: Path) -> None:
    bundled_project.project(tmp_path)
    bundled_project.spindle(tmp_path, error_K=2.0)
    (tmp_path / "data/models").rename(tmp_path / "data/champion")
    bundled_project.spindle(tmp_path)
    asked = "[table[['champion', 'challenger', 'result']].values.tolist(), len(points)]"
    rows, points = outputs_of(tmp_path, CHALLENGER, asked, 1)
    assert rows and all(new < old and said != "worse" for old, new, said in rows)
    assert points >= len(bundled_project.DAYS) - 2


def test_the_time_of_a_program_goes_where_it_says(tmp_path: Path) -> None:
    project = new_project(tmp_path / "project")
    with inside(project):
        values = machine_parameters("hurco")
    control = structure(values, "machine.hurco.control", ControlParameters)
    store(project, values)
    write_json(control_model(hurco02=control), project / "data/models/hurco/control/model.json")
    raw = project / "data/raw/hurco"
    raw.mkdir()
    (raw / "part.nc").write_text("G21 G90 G94\nG1 X100 F1000\nG1 X100.05 F9000\nY50 F500\nM30\n")
    total, lines, short = outputs_of(
        project, TIME, "[totals['total_time_s'], lines.to_dict(), short]", 3
    )
    assert sum(lines.values()) == pytest.approx(total, abs=1e-3)
    assert lines["2"] == pytest.approx(6.0, abs=0.5) and max(lines, key=lines.get) in ("2", "4")
    assert 0 < short < 0.1  # the block of 0.05 mm does not reach 9 m/min


def known_forces() -> pd.DataFrame:
    """Five recordings of which one peak lies outside of its interval, and half of each waveform."""
    rows = []
    for number in range(5):
        measured = 115.0 if number == 4 else 103.0
        ends = {"predicted": 100.0, "low": 90.0, "high": 110.0}
        rows.append({"quantity": "peak force in the plane", "measured": measured} | ends)
        for value in (100.0, 120.0):
            rows.append({"quantity": "force in the plane of the feed", "measured": value} | ends)
        rows[-3:] = [one | {"case": f"cut-{number}.csv"} for one in rows[-3:]]
    return pd.DataFrame(rows).assign(role="held_out", regime="")


def test_the_load_is_as_sure_as_its_intervals(tmp_path: Path) -> None:
    folder = tmp_path / "data/models/rig/cutting"
    folder.mkdir(parents=True)
    known_forces().to_parquet(folder / "predictions.parquet")
    asked = "[int(inside.sum()), len(peaks), held.tolist(), margin.tolist(), spread]"
    inside, peaks, held, margin, spread = outputs_of(tmp_path, LOAD, asked, 2)
    assert (inside, peaks) == (4, 5) and held == [0.5] * 5
    assert spread == pytest.approx(10 / 1.6449 / 100, rel=1e-4)
    assert margin[0] == 0 and margin == sorted(margin)


def test_one_more_recording_narrows_every_interval(tmp_path: Path) -> None:
    write_json(cutting_files.model(), tmp_path / "data/models/rig/cutting/model.json")
    asked = "[[list(one) for one in best.values()], list(map(list, best))]"
    found, names = outputs_of(tmp_path, ONE_MORE, asked, 1)
    assert len(found) == len(names) == 12  # six coefficients at two depths
    assert all(0 < after < 100 for _, after in found)
    deeper = [after for (_, after), (_, depth) in zip(found, names, strict=True)
              if depth > min(one for _, one in names)]  # fmt: skip
    assert np.mean(deeper) < np.mean([after for _, after in found])
