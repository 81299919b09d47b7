"""Seconds of one core that the state of a week at 10 Hz takes, 6 million rows."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
import pytest

from pipeline.monitoring.day_estimates import day_state
from pipeline.schema.bundle import MODEL
from pipeline.schema.twin_state import write_day
from pipeline.submodels.cases import Case
from pipeline.submodels.contract import judging_of, submodel
from tests import bundled_project
from tests.monitoring.made_state import day_rows, estimators, load_of
from tests.small_project import inside

WEEK_S = 25.0
"""State and monitoring together have 60 s: a day of the state takes a seventh of this."""
ROWS = 864_000


@pytest.mark.benchmark(timer=process_time)
def test_a_day_at_10_hz(tmp_path: Path, benchmark: Callable[..., object]) -> None:
    root = bundled_project.project(tmp_path)
    folder = bundled_project.spindle(root) / "spindle"
    rng = np.random.default_rng(0)
    rpm = np.repeat(rng.choice([0.0, 3000.0, 9000.0], ROWS // 1200), 1200)
    words = {"execution": "ACTIVE", "program": "O1", "tool_number": "4"}
    numbers = {"spindle_speed": rpm, "spindle_load": load_of(rpm, rng.uniform(0, 3000, ROWS)),
               "path_feedrate": np.full(ROWS, 20.0),
               "spindle_temperature": 25 + 5 * np.sin(np.arange(ROWS) / 1e5),
               **{f"{axis}_{kind}position": np.cumsum(rng.normal(size=ROWS))
                  for axis in "xyz" for kind in ("", "commanded_")}}  # fmt: skip
    rows = day_rows({**{k: np.full(ROWS, v) for k, v in words.items()}, **numbers}, "cut", 0.1)
    case = Case(name=rows.day, group=rows.day, role="held_out", files=(), conditions={},
                load=lambda: rows.frame)  # fmt: skip
    with inside(root):
        from pipeline.monitoring.budget import MonitoringSettings
        from pipeline.monitoring.nightly import ServingModel
        from pipeline.parameters import read_params

        one = submodel("spindle")
        judging = judging_of(one, read_params(), bundled_project.MACHINE)
    serving = ServingModel(one=one, folder=folder, judging=judging, bundle="", sha256="",
                           settings=MonitoringSettings())  # fmt: skip
    assert (folder / MODEL).exists()
    given = replace(estimators({"spindle": serving}), cases={rows.day: case})
    given.serving["spindle"].predictor  # noqa: B018  the model is loaded once

    def state() -> None:
        found, _ = day_state(rows, given)
        write_day(rows.frame.index, found, tmp_path / "day.parquet")
        assert np.isfinite(found["spindle_temperature_estimated"]).mean() > 0.9

    benchmark.pedantic(state, rounds=2)  # type: ignore[attr-defined]
    seconds = benchmark.stats["min"]  # type: ignore[attr-defined]
    assert 7 * seconds <= WEEK_S, f"a week takes {7 * seconds:.1f} s"
