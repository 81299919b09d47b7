"""Which program ran: the right one, another revision in sections, an aborted one, none."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.moves import Kind
from pipeline.submodels.control.programs import match, read_matches, read_programs, tool_changes
from pipeline.submodels.control.runs import Run, Series
from pipeline.twin.control import ControlRecords, planned_program
from tests.submodels.control.part_programs import (
    SETUP,
    change,
    circles,
    long_cuts,
    moves_of,
    truth,
    zigzag,
)
from tests.submodels.control.polled_logs import (
    ALONE,
    ITEMS,
    Operated,
    logged_runs,
    polled_log,
    write_log,
)

CUTS = {
    1: [*long_cuts((600, 1200)), *zigzag(2000, 10, 90, 12)],
    2: [*circles(12, (800, 1600)), *long_cuts((900,))],
    3: [*long_cuts((1500, 700, 2100)), *circles(6, (1000,))],
}


def program(order=(1, 2, 3), feed=1.0, inserted=0):
    """Text of a program; ``inserted`` lines more are cut with tool 2."""
    lines = ["%", "G21 G90 G94"]
    for tool in order:
        work = [scaled(line, feed) for line in CUTS[tool]]
        more = [f"G1 X{k}.5 F900" for k in range(inserted)] if tool == 2 else []
        lines += [*change(tool, 2000 + 500 * tool), *work, *more]
    return [*lines, "M5", "M30", "%"]


def scaled(line, factor):
    """The line with F times ``factor``."""
    words = [f"F{float(w[1:]) * factor:g}" if w[0] == "F" else w for w in line.split()]
    return " ".join(words)


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    """Programs beside the logs: other tools, other feeds, other lengths."""
    folder = tmp_path_factory.mktemp("programs")
    texts = {
        "part": program(),
        "part-other-feeds": slower_finish(),
        "part-other-order": program((2, 1, 3)),
        "short": program((1,)),
    }
    return {name: moves_of(text, folder, name) for name, text in texts.items()}


def slower_finish():
    """The same lines; the third tool's feeds are slower."""
    lines, at = program(), program().index("T3 M6")
    return [*lines[:at], *(scaled(line, 0.7) for line in lines[at:])]


def run_of(moves, tmp_path, operated=ALONE, seed=1):
    log = polled_log(moves, truth(), np.random.default_rng(seed), operated, begin=2.0)
    [run] = logged_runs(tmp_path / "log.parquet", log)
    return run


@pytest.mark.parametrize("name", ["part", "part-other-feeds", "part-other-order"])
def test_the_program_that_ran_is_found(shelf, tmp_path, name):
    found = match(run_of(shelf[name], tmp_path), shelf)
    assert (found.program, found.whole, found.reason) == (name, True, "")
    assert found.parts() == [found.run]


@pytest.mark.parametrize("percent", [60.0, 110.0])
@pytest.mark.parametrize("name", ["part", "part-other-feeds"])
def test_feeds_tell_posts_apart_under_an_override_that_the_log_does_not_say(
    shelf, tmp_path, name, percent
):
    run = run_of(shelf[name], tmp_path, Operated(feed={0: percent}))
    assert match(run, shelf).program == name


def test_an_aborted_run_is_of_the_program_as_far_as_it_went(shelf, tmp_path):
    moves = shelf["part-other-order"]
    half = planned_program(moves, truth()).total / 2
    found = match(run_of(moves, tmp_path, Operated(abort=half)), shelf)
    assert (found.program, found.whole) == ("part-other-order", True)
    assert not found.run.completed


def test_another_revision_is_matched_in_the_sections_that_stayed(shelf, tmp_path):
    edited = moves_of(program(inserted=3), tmp_path, "edited")
    found = match(run_of(edited, tmp_path), shelf)
    assert found.program == "part"
    assert not found.whole
    text = program(inserted=3)
    at = {tool: text.index(f"T{tool} M6") + 1 for tool in (1, 2, 3)}
    assert [(s.first, s.shift) for s in found.sections] == [(at[1], 0), (at[3], 3)]
    assert found.sections[0].last == at[2]
    assert "log.txt: no program of the machine fits (lines up to" in found.reason
    assert found.left_out.startswith("all but lines ")  # the rest is learnt from
    assert f", which are as in {found.program}: log.txt: no program" in found.left_out
    assert f"T3 at line {at[3]}" in found.reason


def test_parts_of_another_revision_are_numbered_as_in_the_program(shelf, tmp_path):
    edited = moves_of(program(inserted=3), tmp_path, "edited")
    run = run_of(edited, tmp_path)
    first, last = match(run, shelf).parts()
    change = program().index("T3 M6") + 1
    assert last.line.value[0] == change
    assert (first.completed, last.completed) == (False, True)
    assert last.end == run.end
    assert first.start < first.end < last.start
    length = int(shelf["part"].line[-1])
    assert last.line.value.max() <= length
    assert [tool for _, tool in tool_changes(last)] == [3]


def test_without_a_program_that_fits_one_sentence_says_what_was_seen(shelf, tmp_path):
    run = run_of(moves_of(program((3, 2, 1)), tmp_path, "other"), tmp_path)
    found = match(run, shelf)
    assert (found.program, found.parts()) == (None, [])
    text = program((3, 2, 1))
    assert f"T3 at line {text.index('T3 M6') + 1}, T2 at line" in found.reason
    assert "4 programs" in found.reason
    assert found.reason.endswith("put the program that ran beside the log")
    assert match(run, {}).program is None


def test_a_run_that_completed_early_is_not_of_a_longer_program(shelf, tmp_path):
    """The short program is the longer one's beginning, line by line, and ran to its end."""
    run = run_of(shelf["short"], tmp_path)
    assert match(run, shelf).program == "short"
    longer = {name: shelf[name] for name in ("part", "part-other-feeds")}
    found = match(run, longer)
    assert run.completed
    assert (found.program, found.whole) == (None, False)
    last = int(run.line.value.max())
    assert f"says that it completed, but came to line {last} of " in found.reason
    assert "never showed T2, T3" in found.reason
    aborted = replace(run, completed=False)
    assert match(aborted, longer).program == "part"


def test_a_last_line_that_a_poll_missed_is_no_shorter_program(shelf, tmp_path):
    run = run_of(shelf["part"], tmp_path)
    seen = run.line.value < run.line.value.max()
    cut = replace(run, line=Series(time=run.line.time[seen], value=run.line.value[seen]))
    assert match(cut, {"part": shelf["part"]}).whole


def test_a_tie_that_no_feed_breaks_is_not_guessed(shelf, tmp_path):
    run = run_of(shelf["part"], tmp_path)
    mute = replace(run, feed=Series(time=np.empty(0), value=np.empty(0)))
    pair = {name: shelf[name] for name in ("part", "part-other-feeds")}
    found = match(mute, pair)
    assert found.program is None
    assert "part, part-other-feeds fit alike" in found.reason
    copies = {"a": shelf["part"], "b": shelf["part"]}
    assert match(mute, copies).program == "a"


def test_a_log_that_begins_in_the_middle_has_no_total(shelf, tmp_path):
    run = run_of(shelf["part"], tmp_path)
    middle = float(run.line.time[len(run.line.time) // 2])
    found = match(run.during(middle, run.end), shelf)
    assert found.program == "part"
    assert not found.whole
    [part] = found.parts()
    assert part.start >= middle
    line = int(part.line.value[0])
    assert found.reason.startswith(f"log.txt: the log begins at line {line} of part")


def test_programs_that_jump_are_left_out(shelf, tmp_path):
    moves = shelf["part"]
    jumps = replace(moves, line=moves.line[::-1].copy())
    found = match(run_of(moves, tmp_path), {"jumps": jumps})
    assert found.program is None
    assert "0 programs of up to 0 lines are there, 1 more jump" in found.reason


def test_tool_changes_stand_at_the_line_that_was_shown_without_a_tool():
    run = Run(
        recording="log", number=1, start=0.0, end=9.0, completed=True,
        line=Series(time=np.arange(9.0), value=np.arange(10.0, 19.0)),
        tool=Series(
            time=np.array([0.0, 2.0, 3.5, 6.0]), value=np.array([4.0, 0.0, 7.0, 8.0])
        ),
    )  # fmt: skip
    assert tool_changes(run) == [(12, 7), (15, 8)]  # T8: no poll saw the empty spindle


def test_a_section_whose_first_line_is_unknown_is_no_section():
    """T1 was seen before any line; from 0 to T2 there are as many lines as between T1 and T2."""
    changes = [1, 14, 27]  # in the program
    lines, seen = np.array([2.0, 13.0, 20.0, 26.0, 38.0]), [0.5, 2.1, 4.1]
    run = Run(
        recording="log", number=1, start=0.0, end=9.0, completed=True,
        line=Series(time=np.arange(1.0, 6.0), value=lines),
        tool=Series(time=np.array(seen), value=np.array([1.0, 2.0, 3.0])),
    )  # fmt: skip
    assert [line for line, _ in tool_changes(run)] == [0, 13, 26]
    found = match(run, SMALL)
    assert [(s.first, s.shift) for s in found.sections] == [(13, -1), (26, -1)]
    rows = SMALL["small"].kind == Kind.TOOL_CHANGE
    assert SMALL["small"].line[rows].tolist() == changes


NUMBERS = st.lists(st.integers(-1, 60), min_size=2, max_size=30)


@given(lines=NUMBERS, tools=st.lists(st.integers(-1, 4), max_size=8), completed=st.booleans())
def test_whatever_a_log_says_a_run_is_matched_or_told_why_not(lines, tools, completed):
    """Lines and tools in any order: each run has a program, or a reason, and its parts are runs."""
    run = Run(
        recording="log", number=1, start=0.0, end=float(len(lines)), completed=completed,
        line=Series(time=np.arange(len(lines)) * 1.0, value=np.array(lines, dtype=float)),
        tool=Series(time=np.arange(len(tools)) + 0.5, value=np.array(tools, dtype=float)),
    )  # fmt: skip
    found = match(run, SMALL)
    assert found.program is not None or found.reason
    for part in found.parts():
        assert run.start <= part.start <= part.end <= run.end
        assert len(part.line.time)


def _small():
    from tests.machine.programs import Writer

    writer = Writer()
    for tool in (1, 2, 3):
        writer.set(tool=tool).row(Kind.TOOL_CHANGE)
        for k in range(12):
            writer.to(X=10.0 * (k % 2))
    return {"small": writer.moves}


SMALL = _small()


RECORDS = ControlRecords(
    logs="control/*.txt", programs="programs/*.nc",
    units={"left": "*-left.txt", "right": "*-right.txt"}, default_unit="left",
    simulate=("programs/one*",),
)  # fmt: skip
TEXTS = {
    "one": ["G21 G90 G94", *change(1, 3000), *long_cuts((600, 900)), "M30"],
    "two": ["G21 G90 G94", *change(2, 3000), *long_cuts((500, 700, 900)), "M30"],
    "bad": ["G21 G90", "G1 X10 F500", "G2 X20 Y0 I500 F100", "M30"],
}


def files_of(signals):
    return json.loads((signals / "manifest.json").read_text())["files"]


@pytest.fixture
def machine(tmp_path):
    """Raw programs, and signals of two logs and of a recording of another kind."""
    raw, signals = tmp_path / "raw", tmp_path / "signals"
    (raw / "programs").mkdir(parents=True)
    (signals / "observations").mkdir(parents=True)
    moves = {}
    for name, lines in TEXTS.items():
        path = raw / "programs" / f"{name}.nc"
        path.write_text("\n".join(lines) + "\n")
        if name != "bad":
            moves[name] = moves_of(lines, tmp_path, name)
    files = {"agent/week.txt": {"output": None}}
    for file, name in {"control/b-left.txt": "one", "control/a-right.txt": "two"}.items():
        log = polled_log(moves[name], truth(), np.random.default_rng(1))
        output = f"observations/{file.replace('/', '__')}.parquet"
        write_log(log, signals / output)
        files[file] = {"output": output}
    files["agent/other.txt"] = files["control/b-left.txt"]
    (signals / "manifest.json").write_text(json.dumps({"files": files}))
    return raw, signals


def test_programs_are_read_and_what_cannot_be_followed_is_kept_with_its_reason(machine):
    raw, _ = machine
    programs = read_programs(raw, RECORDS, SETUP)
    assert list(programs.moves) == ["programs/one.nc", "programs/two.nc"]
    assert list(programs.refused) == ["programs/bad.nc"]
    assert "bad.nc:3:" in programs.refused["programs/bad.nc"]


def test_runs_are_those_of_the_logs_in_order_of_their_names(machine):
    raw, signals = machine
    programs = read_programs(raw, RECORDS, SETUP).moves
    matches = read_matches(signals, files_of(signals), RECORDS, ITEMS, programs)
    assert [(m.run.name, m.program) for m in matches] == [
        ("control/a-right.txt", "programs/two.nc"),
        ("control/b-left.txt", "programs/one.nc"),
    ]
    assert [RECORDS.unit(m.run.recording) for m in matches] == ["right", "left"]


def test_a_recording_of_no_unit_is_refused_in_one_sentence():
    with pytest.raises(ValueError, match=r"^recording control/c.txt fits no pattern .*left\.txt"):
        RECORDS.unit("control/c.txt")
    alone = ControlRecords(logs="*", programs="*")
    assert alone.unit("control/c.txt") == ""


def test_a_default_unit_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"default_unit is 'middle': name one of its units, left"):
        ControlRecords(logs="*", programs="*", units={"left": "*"}, default_unit="middle")


def test_programs_of_one_name_are_told_apart_by_their_folder(tmp_path):
    for place in ("a/one.nc", "b/one.nc", "b/two.nc"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text("M30\n")
    shown = ControlRecords(logs="*.txt", programs="*/*.nc").shown(tmp_path)
    assert list(shown) == ["a_one.nc", "b_one.nc", "two"]
