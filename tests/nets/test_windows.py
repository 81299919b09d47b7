"""Windows: what stands in them, and inputs that could not be known yet."""

from math import inf

import numpy as np
import pytest

from pipeline.nets.windows import Recording, WindowInput, windows_of

STEP = 0.01
COMMAND, OLD = WindowInput(name="command"), WindowInput(name="error", older_than_s=0.05)


def recording(name: str = "a", many: int = 40, start: float = 0.0) -> Recording:
    """Numbers that say which sample they are of."""
    k = start + np.arange(many, dtype=np.float64)
    signals = {"command": k, "position": k + 0.25, "error": k + 0.5}
    return Recording(name=name, step_s=STEP, signals=signals, measured=frozenset({"position"}))


def test_commands_reach_the_target_s_time_and_measurements_end_at_their_age() -> None:
    found = windows_of([recording()], [COMMAND, OLD], "error", 8, 0.05)
    assert found.x.shape == (40 - 7 - 5, 8, 2) and found.leaks == ()
    t = found.y - 0.5
    np.testing.assert_array_equal(found.at, t)
    np.testing.assert_array_equal(found.x[:, -1, 0], t)
    np.testing.assert_array_equal(found.x[:, 0, 0], t - 7)
    np.testing.assert_array_equal(found.x[:, -1, 1] - 0.5, t - 5)


def test_an_age_between_two_samples_is_rounded_up() -> None:
    older = WindowInput(name="error", older_than_s=0.051)
    found = windows_of([recording()], [older], "error", 3, 0.05)
    np.testing.assert_array_equal(found.y - found.x[:, -1, 0], 6.0)


def test_no_window_crosses_from_one_recording_into_the_next() -> None:
    parts = [recording("a", 20), recording("short", 4, 500.0), recording("b", 25, 1000.0)]
    found = windows_of(parts, [COMMAND, OLD], "error", 6, 0.02)
    assert set(found.group) == {"a", "b"}
    assert (np.ptp(found.x[..., 0], axis=1) == 5).all()
    assert ((found.y > 900) == (found.group == "b")).all()
    assert ((found.x > 900).all(axis=(1, 2)) == (found.group == "b")).all()
    only = found.of("b")
    assert set(only.group) == {"b"} and len(only.at) == (found.group == "b").sum()


@pytest.mark.parametrize(
    ("given", "horizon", "said"),
    [
        (WindowInput(name="error", older_than_s=0.04), 0.05, "'error' is a measurement .* younger"),
        (WindowInput(name="position", older_than_s=0.0), 0.01, "'position' is a measurement"),
        (OLD, inf, "'error' .* that no measurement may enter"),
        (WindowInput(name="position"), 0.0, "'position' is measured, but declared as known"),
        (WindowInput(name="error"), 0.0, "'error' is measured, but declared as known"),
    ],
    ids=["younger", "no age", "before the motion", "measured", "target"],
)
def test_an_input_that_could_not_be_known_is_refused_by_name(
    given: WindowInput, horizon: float, said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        windows_of([recording()], [COMMAND, given], "error", 4, horizon)
    leaky = windows_of([recording()], [COMMAND, given], "error", 4, horizon, allow_leaks=True)
    assert leaky.leaks == (given.name,) == leaky.of("a").leaks


def test_a_copy_of_the_target_under_another_name_is_refused() -> None:
    first = recording()
    copied = {**first.signals, "model": first.signals["error"].copy()}
    with pytest.raises(ValueError, match="'model' holds the very values of the target 'error'"):
        windows_of(
            [Recording(name="a", step_s=STEP, signals=copied)],
            [WindowInput(name="model")], "error", 4, 0.05,
        )  # fmt: skip


def test_what_cannot_be_made_windows_of_is_refused() -> None:
    with pytest.raises(ValueError, match="recording a is given 2 times"):
        windows_of([recording(), recording()], [COMMAND], "error", 4, 0.0)
    with pytest.raises(ValueError, match="has no signal 'force'"):
        windows_of([recording()], [WindowInput(name="force")], "error", 4, 0.0)
    with pytest.raises(ValueError, match="long enough"):
        windows_of([recording(many=7)], [COMMAND, OLD], "error", 4, 0.05)
    broken = recording()
    broken.signals["error"][17] = np.nan
    with pytest.raises(ValueError, match="the first at sample 17"):
        windows_of([broken], [COMMAND], "error", 4, 0.0)
    with pytest.raises(ValueError, match="as many samples"):
        Recording(name="a", step_s=STEP, signals={"u": np.ones(3), "v": np.ones(4)})
    with pytest.raises(ValueError, match=r"older_than_s = -0\.1 s"):
        WindowInput(name="error", older_than_s=-0.1)
