"""Recordings of the dynamometer: what a plain reader finds in them is what is true of them."""

import re
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.shop.cutting.dynamometer import FINE, Baseline, amplified, converted, crosstalk
from pipeline.shop.cutting.force import AXIAL
from pipeline.shop.cutting.parameters import RATE, Dynamometer, EndMill
from pipeline.shop.cutting.records import write_cutting

from .conftest import Simulated, shop_parameters

NAME = re.compile(
    r"(?P<immersion>slot|up|down)-n(?P<speed>\d+)f(?P<feed>\d+)ap(?P<depth>[\d.]+)"
    r"(?:ae(?P<width>[\d.]+))?"
)
FORCES = ["Fx", "Fy", "Fz"]


def read(cuts: Simulated, file: str) -> pd.DataFrame:
    """A file of the dynamometer; what is torn is left out."""
    comma = cuts.parameters.cutting.dynamometer.decimal == ","
    return pd.read_csv(
        cuts.folder / file, sep=";" if comma else ",", decimal="," if comma else ".",
        skiprows=[*range(18), 19], on_bad_lines="skip",
    ).dropna()  # fmt: skip


def files(cuts: Simulated, fault: str | None = None) -> list[dict[str, Any]]:
    """What is told of all files, or of those with one fault (``""``: none)."""
    return [f for f in cuts.truth["more"]["files"] if fault is None or f["fault"] == fault]


def test_names_and_heads_say_the_conditions(cuts):
    written = {f"dynamometer/{p.name}" for p in (cuts.folder / "dynamometer").iterdir()}
    assert written == {f["file"] for f in files(cuts)}
    for f in files(cuts):
        said = NAME.fullmatch(Path(f["file"]).stem)
        assert said is not None
        c = f["conditions"]
        width = said["width"] or cuts.parameters.cutting.tool.diameter
        assert said["immersion"] == c["immersion"]
        assert [float(said[k]) for k in ("speed", "feed", "depth")] == [
            c["speed"], c["feed"], c["depth"],
        ]  # fmt: skip
        assert float(width) == c["width"]
        head = (cuts.folder / f["file"]).read_text().splitlines()[:20]
        assert head[0].startswith("DynoWare") and Path(f["file"]).stem in head[2]
        assert float(re.split("[,;]", head[10])[1]) == RATE


def test_every_row_is_there_at_ten_thousand_a_second(cuts):
    for f in files(cuts):
        table = read(cuts, f["file"])
        assert list(table.columns) == ["Time", *FORCES]
        assert len(table) == f["rows"] - (f["fault"] == "torn")
        assert np.diff(table["Time"]) == pytest.approx(np.full(len(table) - 1, 1 / RATE), abs=2e-6)


def plate(machine: str, mean: list[float]) -> np.ndarray:
    """Mean force on the workpiece along the dynamometer's axes, from that on the tool.

    mill01: x along the feed, y left, z up.  mill02: turned, y along the feed, x right, z down.
    """
    ahead, left, lift = -mean[0], -mean[1], mean[2]
    return np.array([ahead, left, lift] if machine == "mill01" else [-left, ahead, -lift])


def test_means_are_those_of_the_cut_seen_through_the_chain(cuts):
    """Over the time inside the material: crosstalk, offset and drift are told.

    1 N: a broken turn more or less of 50, and the noise's own mean.
    """
    mixed = np.array(cuts.truth["more"]["dynamometer"]["crosstalk"])
    for f in files(cuts, ""):
        table, true = read(cuts, f["file"]), f["true"]
        since = (table["Time"] - table["Time"].iloc[0]).to_numpy()
        inside = (since >= true["inside_s"][0]) & (since <= true["inside_s"][1])
        drift = np.outer(since, true["drift_N_s"]) + true["offset_N"]
        seen = (table[FORCES].to_numpy() - drift)[inside].mean(axis=0)
        expected = mixed @ plate(cuts.parameters.machine, true["mean_on_tool_N"])
        assert seen == pytest.approx(expected, abs=1.0)


def test_in_the_air_there_is_nothing_but_the_chain(cuts):
    d = cuts.parameters.cutting.dynamometer
    for f in files(cuts, ""):
        if f["window"] == "inside":
            continue
        forces = read(cuts, f["file"])[FORCES].to_numpy()
        air = forces[:1000] if f["window"] == "entry" else forces[-1000:]
        spread = np.sqrt(d.noise**2 + d.hum**2 / 2 + f["true"]["step_N"] ** 2 / 12)
        assert air.std(axis=0) == pytest.approx(np.full(3, spread), rel=0.1)
        assert forces.std(axis=0).min() > 5 * spread


def test_teeth_pass_at_the_true_speed(cuts):
    """Phase of the teeth's own harmonic advances as the spindle turns, to 0.03 %."""
    flutes = cuts.parameters.cutting.tool.flutes
    for f in files(cuts, ""):
        if f["window"] != "inside":
            continue
        force = read(cuts, f["file"])[FORCES[0]].to_numpy()
        true = f["true"]["speed_rpm"]
        moments = np.arange(force.size) / RATE
        wave = force * np.exp(-2j * pi * true / 60 * flutes * moments)
        turn = round(RATE * 60 / true)
        smooth = np.convolve(wave, np.ones(turn) / turn, "valid")
        phase = np.unwrap(np.angle(smooth))
        slip = (phase[-1] - phase[0]) / (2 * pi) / (smooth.size / RATE) / (true / 60 * flutes)
        assert abs(slip) < 1e-3  # a wander of 0.1 % over some tenths of a second
        assert abs(true / f["conditions"]["speed"] - 1) < 3e-3


def test_faults_are_as_told(cuts):
    d = cuts.parameters.cutting.dynamometer
    (clipped,), (lost,), (torn,) = (files(cuts, k) for k in ("clipped", "lost", "torn"))
    assert clipped["reject"] and lost["reject"] and not torn["reject"]
    forces = read(cuts, clipped["file"])[FORCES].to_numpy()
    at_end = np.abs(forces) >= d.low_range - 1.5 * clipped["true"]["step_N"]
    assert at_end.sum(axis=0).tolist() == clipped["true"]["clipped"]
    assert 100 < at_end.sum() < at_end.size / 3
    spread = read(cuts, lost["file"])[FORCES].std()
    assert spread["Fy"] < 3 * np.hypot(d.noise, d.hum) and spread["Fx"] > 20
    text = (cuts.folder / torn["file"]).read_text()
    assert not text.endswith("\n")
    assert all(not any(f["true"]["clipped"]) for f in files(cuts, ""))


def test_values_stand_on_the_converters_steps(cuts):
    """To the six digits that are written: 5e-4 N of some hundred."""
    f = files(cuts, "")[0]
    counts = read(cuts, f["file"])[FORCES].to_numpy() / f["true"]["step_N"]
    assert np.abs(counts - np.round(counts)).max() < 0.02


def misses(cuts: Simulated, coefficients: dict[str, float]) -> np.ndarray:
    """True mean forces less those of a linear-edge model, shape (files, 3) [N]; and the former."""
    tool, out = cuts.parameters.cutting.tool, []
    for f in (f for f in files(cuts) if not f["reject"]):
        c = f["conditions"]
        arc = np.arccos(1 - 2 * c["width"] / tool.diameter)
        ends = (0.0, arc) if c["immersion"] == "up" else (pi - arc, pi)
        over = linear_edge_integrals(coefficients, c["feed_per_tooth"], *ends)
        expected = tool.flutes * c["depth"] / (2 * pi) * over
        true = np.array(f["true"]["mean_on_tool_N"])
        out.append([true - expected, true])
    return np.array(out).swapaxes(0, 1)


def test_the_truth_predicts_the_mean_forces(cuts):
    """Closed form of the linear-edge model with the truth's coefficients, against what was cut.

    What it cannot know: wear over the series (8 to 38 um on mill02, a quarter of the edge's force),
    the error of the depth (1 %), the size effect.
    """
    apart, true = misses(cuts, cuts.truth["parameters"])
    share = np.linalg.norm(apart, axis=1) / np.linalg.norm(true, axis=1)
    assert 0.005 < share.max() < 0.15 and share.mean() < 0.06


def linear_edge_integrals(p: dict[str, float], h: float, begin: float, end: float) -> np.ndarray:
    """Integrals over phi of x, y and axial force for each width [N/mm], by Simpson's rule."""
    q = np.linspace(begin, end, 401)
    t, r, a = (p[f"K_{k}c"] * h * np.sin(q) + p[f"K_{k}e"] for k in "tra")
    weights = np.ones(401)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    x, y = -t * np.cos(q) - r * np.sin(q), t * np.sin(q) - r * np.cos(q)
    return np.array([weights @ f for f in (x, y, a)]) * (end - begin) / 400 / 3


def test_a_recording_too_short_for_the_tool_is_named(tmp_path):
    short = {"dynamometer": {"series": {"seconds": 0.1, "block": 20.0}}}
    with pytest.raises(ValueError, match=r"Series.seconds = 0.1 s is too short.*12.0 mm"):
        write_cutting(tmp_path, shop_parameters("mill01", cutting=short))


@pytest.mark.parametrize("frequency", [50.0, 1000.0, 2000.0])
def test_a_channel_answers_as_its_mode(frequency):
    """Gain 1 / sqrt((1 - r2)2 + (2 zeta r)2) once it has settled.

    A sine that goes straight from step to step has sinc2 of its height.
    """
    d = replace(Dynamometer(), noise=0.0, hum=0.0, mains=50.0)
    still = Baseline(offset=np.zeros(3), drift=np.zeros(3), hum_phase=np.zeros(3))
    steps = FINE * RATE // 2
    force = np.zeros((steps, 4))
    force[:, AXIAL] = np.sin(2 * pi * frequency * np.arange(steps) / (FINE * RATE))
    random = np.random.default_rng(0)
    out = amplified(force, np.eye(3), still, d, steps // 2, random)
    r = frequency / d.z.frequency
    gain = 1 / np.hypot(1 - r * r, 2 * d.z.damping * r)
    low = np.sinc(frequency / RATE / FINE) ** 2
    wave = np.exp(-2j * pi * frequency * np.arange(len(out)) / RATE)
    assert 2 * abs((out[:, 2] * wave).mean()) == pytest.approx(gain * low, rel=1e-3)
    assert not out[:, :2].any()


def test_crosstalk_keeps_to_its_share():
    mixed = crosstalk(Dynamometer(), np.random.default_rng(5))
    assert np.diag(mixed) == pytest.approx(np.ones(3))
    beside = np.abs(mixed[~np.eye(3, dtype=bool)])
    assert beside.max() <= 0.018 and beside.min() > 0.005


def test_the_converter_has_two_ends():
    values, at_end = converted(np.array([[-11.0, 0.26, 11.0]]), 10.0, 8)
    assert values == pytest.approx(np.array([[-10.0, 0.234375, 10 - 10 / 128]]))
    assert at_end.tolist() == [1, 0, 1]


def test_a_tool_of_another_count_of_teeth_is_named():
    with pytest.raises(ValueError, match=r"EndMill.sharpness = \(1.0, 1.1\).*3 teeth"):
        EndMill(sharpness=(1.0, 1.1))
