"""`kerf chatter` on files as recorders write them."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import pipeline.app.program_commands  # noqa: F401, its commands
from pipeline.app.kerf import app

RATE = 5120.0
SPEED_RPM, TEETH = 6000, 3


def recorded(path: Path, head: str, unit_s: float, chatter_Hz: float) -> Path:
    """Three seconds of a cut with a chatter line as loud as the teeth."""
    t = np.arange(round(3 * RATE)) / RATE
    noise = np.random.default_rng(1).standard_normal(len(t))
    signal = np.sin(2 * np.pi * SPEED_RPM / 60 * TEETH * t) + 0.05 * noise
    signal += np.sin(2 * np.pi * chatter_Hz * t)
    np.savetxt(path, np.column_stack([t / unit_s, signal]), delimiter=",", header=f"{head},acc",
               comments="", fmt="%.9g")  # fmt: skip
    return path


@pytest.mark.parametrize(
    ("head", "unit_s"),
    [("time", 1.0), ("t", 1.0), ("Time", 1.0), ("time_s", 1.0), ("time_ms", 1e-3)],
)
def test_a_column_of_time_is_known_by_its_usual_names(
    head: str, unit_s: float, tmp_path: Path
) -> None:
    file, out = recorded(tmp_path / "cut.csv", head, unit_s, 743.0), tmp_path / "chatter.json"
    done = CliRunner().invoke(app, ["chatter", str(file), "--teeth", str(TEETH), "--speed",
                                    str(SPEED_RPM), "--json", str(out)])  # fmt: skip
    assert done.exit_code == 0, done.output
    found = json.loads(out.read_text())
    assert found["verdict"] == "chatter"
    assert found["frequency_Hz"] == pytest.approx(743.0, rel=0.01)
