import pandas as pd
import pytest

from pipeline.signals.contracts import TABLES, check, check_files

TIME = pd.date_range("2024-03-04", periods=3, freq="s", tz="UTC")


def state(**changes):
    good = {"time": TIME, "execution": ["READY", None, "ACTIVE"], "spindle_load": [1.0, None, 3.0]}
    return pd.DataFrame(good | changes)


def test_a_good_state_table_passes_and_comes_back():
    frame = state()
    assert check("state", frame) is frame


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (state(spindle_load=[1.0, 2.0, 900.0]), "'spindle_load', row 2: 900.0.*500 PERCENT"),
        (state(spindle_load=["a", "b", "c"]), "'spindle_load' is .* where numbers belong"),
        (state(execution=[1, 2, 3]), "'execution' is int64 where words belong"),
        (state(time=TIME[::-1]), "'time', row 1: 2024-03-04.* does not follow"),
        (state(time=TIME.tz_localize(None)), "'time' is .* where times with the plant's zone"),
        (state(speed=1.0), "'speed' is not of this table"),
        (state().drop(columns="time"), "'time' is missing"),
    ],
)
def test_what_breaks_the_state_is_told_in_one_sentence(frame, words):
    with pytest.raises(ValueError, match=f"^state: column {words}") as reported:
        check("state", frame)
    assert str(reported.value).endswith("clean the machine's signals again")
    assert "\n" not in str(reported.value)


def test_a_segment_that_ends_before_it_starts():
    frame = pd.DataFrame({"start": TIME[1:2], "end": TIME[:1], "kind": ["off"]})
    with pytest.raises(ValueError, match=r"segments: column 'end', row 0: 2024-03-04 00:00:00"):
        check("segments", frame)


def test_a_word_that_is_none_of_the_list():
    frame = pd.DataFrame({"start": TIME[:1], "end": TIME[1:2], "kind": ["lunch"]})
    with pytest.raises(ValueError, match=r"'kind', row 0: 'lunch' where one of off, warm_up"):
        check("segments", frame)


def test_an_unknown_table_names_the_known_ones():
    with pytest.raises(ValueError, match=f"'stat' has no contract; name one of {TABLES[0]}"):
        check("stat", state())


def test_files_that_break_a_contract_are_named(tmp_path):
    (tmp_path / "state").mkdir()
    broken = tmp_path / "state/2026-01-05.parquet"
    pd.DataFrame({"time": ["monday"], "spindle_speed": [1.0]}).to_parquet(broken)
    with pytest.raises(ValueError, match=r"2026-01-05\.parquet: state: column 'time'"):
        check_files(tmp_path, {"state": "state/*.parquet"})
