"""Page of the following error that is left over: its words, tables and figures, from few files."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from pipeline.charts.sources import SourceRegistry
from pipeline.nets.sequence import sequence_network
from pipeline.nets.settings import CnnLstmAttentionSettings, WindowTraining
from pipeline.nets.stored import Scaling
from pipeline.nets.window_training import TrainedSequence
from pipeline.nets.windows import WindowInput
from pipeline.schema.model import Band, Condition
from pipeline.schema.verdict import Fact, Figures, JudgedCase, Score, Verdict
from pipeline.submodels.contract import Shown
from pipeline.submodels.following_residual.model import (
    ESTIMATION,
    PREDICTION,
    KindScore,
    LeakShown,
    LoadedResidual,
    ResidualModel,
    SearchFacts,
    UseModel,
    attention_shown,
    key_of,
    to_and_fro,
)
from pipeline.submodels.following_residual.submodel import SUBMODEL
from tests.submodels.made_pages import drawn, held_to_golden, made, tables, words

INPUTS = tuple(WindowInput(name=n) for n in ("speed", "acceleration", "since reversal"))
BANDS = {"": Band(lower=1.0, upper=1.0, n=100, groups=5)}
LENGTH, STEP = 12, 0.004
SCORES = {
    "twin alone": KindScore(rmse_um=2.0, max_um=9.0, spread_um=0.2),
    "arx": KindScore(rmse_um=0.5, max_um=3.0, spread_um=0.1),
    "cnn_lstm_attention": KindScore(rmse_um=0.8, max_um=4.0, spread_um=0.1),
}
LATE = {"persistence": SCORES["twin alone"], "arx": SCORES["arx"]}


def made_use(scores: Mapping[str, KindScore], **changes: Any) -> UseModel:
    one = UseModel(champion="arx", scores=scores, bands=BANDS, inputs=INPUTS)
    return replace(one, **changes)


def model_of(axes: dict[str, dict[str, UseModel]], **changes: Any) -> ResidualModel:
    one = ResidualModel(
        submodel="following_residual", machine="rig", origin="simulated", parameters={},
        trained_on=(),
        conditions={"highest speed X": Condition(unit="mm/s", low=0.0, high=100.0)},
        axes=axes, step_s=STEP, horizon_s=0.02, settle_s=0.1, length=LENGTH,
        search=SearchFacts(
            kind="cnn_lstm_attention", axis="X", method="genetic", candidates=11, pruned=3,
            history_um=(0.6, 0.5, 0.5), chosen={"units": 64.0, "l2": 1e-4},
            bounds_hit={"units": "upper"},
        ),
        leak=LeakShown(
            axis="X", kind="cnn_lstm_attention", inputs=("position",), rmse_um=0.07,
            honest_um=0.8, max_um=0.5, honest_max_um=4.0,
        ),
    )  # fmt: skip
    return replace(one, **changes)


def judged(quantity: str, base: str) -> Verdict:
    def score(group: str, after: float, before: float) -> Score:
        return Score(
            quantity=quantity, unit="um", group=group, regime="", role="held_out", n=200,
            rmse=after / 4, max=after, baselines={base: Figures(rmse=before / 4, max=before)},
        )  # fmt: skip

    def case(name: str, role: Any, speed: float) -> JudgedCase:
        at = {"highest speed X": Fact(value=speed, unit="mm/s")}
        return JudgedCase(case=name, group=name, role=role, conditions=at)

    return Verdict(
        submodel="following_residual", machine="rig", origin="simulated", status="passed",
        reasons=(),
        judged_role="held_out", golden=None,
        scores=(score("a.csv", 1.0, 4.0), score("b.csv", 2.5, 8.0), score("all", 2.5, 8.0)),
        cases=(case("a.csv", "held_out", 25.0), case("b.csv", "held_out", 50.0),
               case("c.csv", "training", 25.1)),
    )  # fmt: skip


def predicted(quantity: str, base: str) -> pd.DataFrame:
    t = 0.01 * np.arange(200)
    frames = []
    for case, left in (("a.csv", 1.0), ("b.csv", 2.5)):
        after = left * np.exp(-(((t - 1.2) / 0.05) ** 2))
        frames.append(pd.DataFrame({
            "case": case, "group": case, "role": "held_out", "quantity": quantity, "unit": "um",
            "regime": "", "t": t, "measured": 50.0 + after, "predicted": 50.0, "low": 49.0,
            "high": 51.0, "scored": True, f"baseline_{base}": 50.0 - 2 * after,
        }))  # fmt: skip
    return pd.concat(frames, ignore_index=True)


@pytest.fixture()
def shown(tmp_path: Path) -> Shown:
    quantity = "following error X"
    return Shown(
        machine="rig", origin="simulated", shelf=SourceRegistry(), folder=tmp_path,
        model=model_of({"X": {PREDICTION: made_use(SCORES), ESTIMATION: made_use(LATE)}}),
        verdict=judged(quantity, "twin alone"), predictions=predicted(quantity, "twin alone"),
    )  # fmt: skip


def with_attention(model: ResidualModel) -> ResidualModel:
    kind = CnnLstmAttentionSettings(filters=3, units=4)
    built = sequence_network(kind, LENGTH, len(INPUTS), torch.Generator().manual_seed(1))
    one = TrainedSequence(
        kind=kind, settings=WindowTraining(), precision="float32", length=LENGTH, inputs=INPUTS,
        leaks=(), network=built, history=np.ones((1, 3)), validation_groups=(),
        x_scaling=Scaling(shift=np.zeros(3), scale=np.array([0.1, 1.0, 2.0])),
        y_scaling=Scaling(shift=np.array(0.0), scale=np.array(1e-6)),
    )  # fmt: skip
    key = key_of("X", PREDICTION, "cnn_lstm_attention")
    served = LoadedResidual(file=model, documents={key: (one.document(),)})
    return replace(model, attention=attention_shown(served, {}))


def test_the_page_is_the_golden_one(shown):
    held_to_golden(made(SUBMODEL, shown), Path(__file__).with_name("page.txt"))


def test_every_network_stands_with_its_error_left_out_and_on_records_that_decide(shown):
    rows = tables(made(SUBMODEL, shown))["Methods compared"]
    before = [row for row in rows if "before the motion" in row[0]]
    assert [row[1] for row in before] == [
        "ARX (serves)", "CNN-LSTM with attention", "drive model alone"
    ]  # fmt: skip
    assert before[0][2:5] == ["0.500 ± 0.10", "0.625", "2.50"] and before[2][3:5] == [
        "2.00",
        "8.00",
    ]


def test_the_prediction_is_drawn_beside_the_drives_model_alone(shown):
    found = drawn(made(SUBMODEL, shown))
    worst = next(svg for caption, svg in found.items() if caption.startswith("Worst recording, b"))
    assert "Predicted less measured, µm" in worst and worst.count("curve free") == 2


def test_a_machine_without_recorded_commands_is_estimated_only(shown):
    quantity = "following error, estimated X"
    found = made(SUBMODEL, replace(
        shown, model=model_of({"X": {ESTIMATION: made_use(LATE, by_time=True)}}, with_drive=False,
                              search=None, leak=None),
        verdict=judged(quantity, "persistence"), predictions=predicted(quantity, "persistence"),
    ))  # fmt: skip
    said = words(found)
    assert found.verdict is not None and "kerf simulate" not in said
    assert "measurements that are 20.0 ms old or older" in said and "no model of its drives" in said
    assert "stretches of time left out" in said and "last error known 8.00 µm" in said


def test_attention_is_shown_by_regime_where_the_network_is_there(shown):
    assert not any("attention over the window" in one for one in drawn(made(SUBMODEL, shown)))
    assert shown.model is not None
    model = with_attention(shown.model)
    found = model.attention
    assert found is not None and found.axis == "X"
    weights = found.weights
    assert set(weights) == {"at rest", "after a reversal", "accelerating", "constant speed"}
    for values in weights.values():
        assert sum(values) == pytest.approx(1.0, abs=1e-5)
    assert len(found.ms) == len(values) and found.ms[-1] > -1e3 * STEP * LENGTH
    found_ = drawn(made(SUBMODEL, replace(shown, model=model)))
    assert any("attention over the window" in one for one in found_)


def test_the_motion_to_and_fro_ends_where_it_began_at_the_speed_asked():
    way = to_and_fro(0.05)
    assert way[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(np.diff(way)).max() / 0.001 == pytest.approx(0.05)
