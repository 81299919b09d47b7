"""Each leak is found whatever its scale, noise or delay; honest inputs are not taken for one."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest

from pipeline.schema.arrays import Floats
from pipeline.submodels.canaries import INPUTS, canaries, failures
from pipeline.submodels.contract import Prediction, SeenInputs

ROWS, RECORDINGS = 900, 3
NOISE = 0.2
"""Noise of the probe, beside a following error of 340 um of which 0.7 um are not modelled [um]."""


def recording(seed: int, leak: Callable[[Floats, Floats], Floats] | None = None) -> SeenInputs:
    """Residual of an axis: what its speed leaves of a following error of 340 um, and noise."""
    rng = np.random.default_rng(seed)
    t = 0.002 * np.arange(ROWS)
    speed = np.sin(2 * np.pi * (0.7 + 0.2 * seed) * t) + 0.3 * np.sign(np.sin(9.0 * t))
    modelled = 340.0 * speed
    # 0.6 um follow from the square of the speed, which a linear probe does not see
    residual = 0.6 * speed**2 + NOISE * rng.standard_normal(ROWS)
    heat = np.cumsum(np.abs(speed)) / ROWS + 0.01 * rng.standard_normal(ROWS)
    inputs = {"speed": speed, "modelled error": modelled, "motor temperature": heat}
    if leak is not None:
        inputs["measured"] = leak(modelled, residual)
    return SeenInputs(quantity="following error", t=t, measured=residual, inputs=inputs)


def found(leak: Callable[[Floats, Floats], Floats] | None) -> list[str]:
    seen = tuple(recording(seed, leak) for seed in range(RECORDINGS))
    checked = canaries([Prediction(frame=pd.DataFrame(), seen=seen)], pd.DataFrame(), [], "golden")
    assert [one.name for one in checked] == [INPUTS]
    return failures(checked)


def noisy(modelled: Floats, residual: Floats) -> Floats:
    """A copy that another sensor took, with as much noise as the first."""
    return residual + NOISE * np.random.default_rng(9).standard_normal(ROWS)


LEAKS = {
    "itself": lambda modelled, residual: residual,
    "hidden by its scale": lambda modelled, residual: 1e-9 * residual + 3e4,
    "measured beside modelled": lambda modelled, residual: modelled + residual,
    "with noise": noisy,
    "a row late": lambda modelled, residual: np.roll(residual, 1),
    "two rows early": lambda modelled, residual: np.roll(residual, -2),
    "late, scaled and with noise": lambda m, residual: 1e-6 * np.roll(noisy(m, residual), 1),
}


@pytest.mark.parametrize("leak", LEAKS.values(), ids=LEAKS)
def test_a_leak_is_found(leak):
    (said,) = found(leak)
    assert said.startswith("measured among the inputs is the target following error")
    assert ("1 row behind it" in said) == (leak in (LEAKS["a row late"], [*LEAKS.values()][-1]))


def test_a_ridge_hides_what_the_probe_finds():
    """Scaling by 340 um and a penalty of 1 % leave the leak no better than honest inputs."""
    leaky = [recording(seed, LEAKS["measured beside modelled"]) for seed in range(RECORDINGS)]
    x = np.concatenate([np.column_stack(list(one.inputs.values())) for one in leaky])
    y = np.concatenate([one.measured for one in leaky])
    x = (x - x.mean(axis=0)) / x.std(axis=0)
    y = y - y.mean()

    def error(ridge: float, columns: int) -> float:
        a = x[:, :columns]
        slopes = np.linalg.solve(a.T @ a + ridge * len(a) * np.eye(columns), a.T @ y)
        return float(np.std(y - a @ slopes))

    honest = error(1e-2, 3)
    assert error(1e-2, 4) > 0.95 * honest and error(1e-12, 4) < 1e-3 * honest


def test_honest_inputs_are_no_leak():
    assert found(None) == []


def test_an_input_that_explains_all_but_the_noise_is_no_leak():
    """A cause of the whole error, however strong, has not the noise of the probe."""
    assert found(lambda modelled, residual: residual - NOISE * _noise_of(residual)) == []


def _noise_of(residual: Floats) -> Floats:
    """The noise of a recording, which its seed gives."""
    draws = (np.random.default_rng(seed).standard_normal(ROWS) for seed in range(RECORDINGS))
    return next(one for one in draws if np.std(np.diff(residual - NOISE * one)) < 0.5 * NOISE)


def test_two_copies_do_not_hide_each_other():
    seen = [recording(seed, LEAKS["itself"]) for seed in range(RECORDINGS)]
    seen = [replace(s, inputs={**s.inputs, "again": 2.0 * s.measured}) for s in seen]
    check = partial(canaries, frame=pd.DataFrame(), targets=[], deciding="golden")
    (said,) = failures(check([Prediction(frame=pd.DataFrame(), seen=tuple(seen))]))
    assert "a sum of the inputs" in said


def test_short_lives_of_tools_are_probed_without_a_shift():
    """Seven readings a tool, unevenly over its use, beside features without a bearing on it."""
    rng = np.random.default_rng(0)
    seen = []
    for _ in range(8):
        use = np.cumsum(rng.uniform(8.0, 20.0, 7))
        wear = 20.0 + 1.5 * use + 5.0 * rng.standard_normal(7)
        features = {f"feature {k}": rng.standard_normal(7) + 0.01 * use for k in range(60)}
        seen.append(SeenInputs(quantity="wear", t=use, measured=wear, inputs=features))
    check = partial(canaries, frame=pd.DataFrame(), targets=[], deciding="golden")
    honest = check([Prediction(frame=pd.DataFrame(), seen=tuple(seen))])
    assert [one.status for one in honest] == ["passed"]
    leaky = [replace(s, inputs={**s.inputs, "level": 1e3 * s.measured}) for s in seen]
    (said,) = failures(check([Prediction(frame=pd.DataFrame(), seen=tuple(leaky))]))
    assert said.startswith("level among the inputs is the target wear")


def test_too_few_rows_are_not_probed():
    seen = replace(
        recording(0), t=np.arange(5.0), measured=np.arange(5.0), inputs={"a": np.ones(5)}
    )
    empty = replace(seen, t=np.zeros(0), measured=np.zeros(0), inputs={"a": np.zeros(0)})
    for one in (seen, empty):
        assert canaries([Prediction(frame=pd.DataFrame(), seen=(one,))], pd.DataFrame(), [],
                        "golden") == ()  # fmt: skip
