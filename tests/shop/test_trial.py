"""Trial cuts: programs read from their text, ways that the axes go, parts that differ by chance."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.cutting.parameters import EndMill, Workpiece
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.cutting import BATCH, LENGTH, TOP, chance
from pipeline.shop.trial.job import TrialJob, shop_part
from pipeline.shop.trial.motion import Track, control_of, program_steps, track
from pipeline.shop.trial.trials import Trial, prepare, trial, trials

from .conftest import shop_parameters

MILL = EndMill(number=1, diameter=6.0, flutes=2, helix=0.0, sharpness=(1.0, 1.0))
JOB = TrialJob(blank=(0.0, 40.0, 0.0, 30.0, -10.0, 0.0), limit_load_N=60.0, tools={1: MILL})
MACHINE = ShopParameters(machine="trial")
HEAD = "G21 G90 G54\nG0 X-5 Y15 S5000 M3\nG43 Z5 H1\n"
SLOT = f"{HEAD}G1 Z-1 F200\nX30 F300\nG0 Z5\nM30\n"


def way_of(text: str, job: TrialJob = JOB, machine: ShopParameters = MACHINE) -> Track:
    program = program_steps(text, "P", job, machine.control)
    control = control_of(program, job, machine, np.random.default_rng(0))
    return track(control.run(program), job, machine.control)


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
@pytest.mark.parametrize("each", [3, pytest.param(1, marks=pytest.mark.proof)])
def test_a_program_read_from_its_text_takes_the_time_of_the_steps_it_was_written_with(
    machine, each
):
    """Facing, contours, pockets, chords, drilling with and without pecks; 1 us of rounding.

    Of each third program, or of all.
    """
    parameters = shop_parameters(machine)
    programs, _ = part_programs(parameters.control, parameters.generator("part programs"))
    for program in [*programs[::each], shop_part(parameters).program]:
        lengths = {t.number: t.length for t in program.tools}
        job = replace(JOB, lengths=lengths, tools={n: replace(MILL, number=n) for n in lengths})
        read = program_steps(program.text, program.name, job, parameters.control)
        took = [
            control_of(read, job, parameters, np.random.default_rng(1)).run(one).duration
            for one in (program, read)
        ]
        assert took[1] == pytest.approx(took[0], abs=1e-6 * len(program.steps)), program.name


def test_axes_lag_by_feed_over_gain_and_round_corners():
    """A ramp's lag behind a first-order lag is v / k; sampled at 2 ms it is v (1/k - dt/2)."""
    way = way_of(f"{HEAD}G1 Z-1 F3000\nX35\nY40\nG0 Z5\nM30\n")
    k, dt, v = MACHINE.control.position_gain, MACHINE.control.cycle, 50.0
    along = way.tip[(way.line == 5) & (way.tip[:, 0] > 10) & (way.tip[:, 0] < 25)]
    assert np.diff(along[:, 0]) == pytest.approx(np.full(len(along) - 1, v * dt), rel=1e-4)
    turning = way.tip[way.line == 6][0]  # the command is at the corner, the tool is not yet
    assert 35 - turning[0] == pytest.approx(v * (1 / k - dt / 2), rel=0.6)
    near = np.hypot(way.tip[:, 0] - 35, way.tip[:, 1] - 15)[way.tip[:, 2] < 0].min()
    assert 0.02 < near < v / k


def test_arcs_are_circles_and_helices_go_down_with_the_angle():
    """At a feed so slow that the lag (v / k = 30 um) shrinks the radius by less than 0.1 um."""
    way = way_of(f"{HEAD}G0 X25\nG1 Z0 F60\nG3 X25 Y15 Z-2 I-5 J0 F60\nG0 Z5\nM30\n")
    arc = way.tip[way.line == 6][1:]
    radius = np.hypot(arc[:, 0] - 20, arc[:, 1] - 15)
    assert radius == pytest.approx(np.full(len(arc), 5.0), abs=1e-3)
    angle = np.unwrap(np.arctan2(arc[:, 1] - 15, arc[:, 0] - 20))
    slope = np.polyfit(angle[200:-200], arc[200:-200, 2], 1)[0]
    assert slope == pytest.approx(-2 / (2 * np.pi), rel=1e-4)


def test_a_slot_takes_its_own_area_and_each_cell_when_the_tool_reaches_it():
    """Area of half a disc and a strip to a cell's width along its edge; ways to two cells."""
    its = prepare(SLOT, "P", JOB, MACHINE).swept
    r, cell, reach = 3.0, its.cell, 30.0
    taken = np.isfinite(its.first[0])
    area = 2 * r * reach + np.pi * r**2 / 2
    assert taken.sum() * cell**2 == pytest.approx(area, abs=cell * (2 * reach + np.pi * r))
    middle = int((15.0 - its.corner[1]) / cell)
    columns = np.arange(200, 1400)
    ahead = its.corner[0] + (columns + 0.5) * cell
    begins = its.path[np.flatnonzero(its.cuts)[0]]  # the front is at X0
    assert its.first[0, middle, columns] - begins == pytest.approx(ahead, abs=2 * cell)


def slot_cut(job: TrialJob, seed: int) -> Trial:
    """The slot read and cut anew."""
    return trial(prepare(SLOT, "P", job, MACHINE), job, MACHINE, seed)


def test_the_same_seed_is_the_same_part_and_another_one_is_not():
    one, again = (slot_cut(JOB, 7) for _ in range(2))
    assert one == again
    its = prepare(SLOT, "P", JOB, MACHINE)
    assert trial(its, JOB, MACHINE, 7) == one
    other = trial(its, JOB, MACHINE, 8)
    assert other.peak_load_N != one.peak_load_N and other.time_s != one.time_s


def test_parts_scatter_as_they_are_said_to():
    """2000 draws: standard errors are 1.6 % of a deviation, 2 % of Rayleigh's mean."""
    random = np.random.default_rng(5)
    parts = [chance(JOB, MACHINE, random) for _ in range(2000)]
    batch = np.array([p.workpiece.tangential for p in parts]) / Workpiece().tangential
    assert batch.mean() == pytest.approx(1, abs=4 * BATCH / 2000**0.5)
    assert batch.std() == pytest.approx(BATCH, rel=0.07)
    runout = np.array([p.tools[1].runout for p in parts])
    assert runout.mean() == pytest.approx(MILL.runout, rel=0.05)
    assert (runout > 2 * MILL.runout).mean() == pytest.approx(np.exp(-np.pi), abs=0.02)
    deeper = np.array([p.deeper[1] for p in parts])
    assert deeper.std() == pytest.approx(np.hypot(LENGTH, TOP), rel=0.07)
    assert all(0 <= p.used[1] <= 15 for p in parts)


def test_a_trial_has_the_time_and_the_peak_of_each_line():
    found = slot_cut(JOB, 1)
    assert found.peak_line == 5 and found.peak_load_N == found.peaks_N[5] > 30
    assert min(found.peaks_N.values()) == 0 and list(found.peaks_N) == sorted(found.peaks_N)
    assert slot_cut(replace(JOB, limit_load_N=500.0), 1).peaks_N == found.peaks_N


def test_trials_cut_the_same_parts_before_and_after():
    slower = SLOT.replace("F300", "F150")
    found = trials(SLOT, slower, replace(JOB, limit_load_N=60.0), MACHINE, range(3))
    assert found["seeds"] == 3 and found["before"]["above"] == 3
    assert found["after"]["time_s"]["mean"] - found["before"]["time_s"]["mean"] == pytest.approx(
        35 / 2.5 - 35 / 5, abs=0.05
    )
    assert found["after"]["peak_load_N"]["mean"] < found["before"]["peak_load_N"]["mean"] - 10
    same = trials(SLOT, SLOT, JOB, MACHINE, [4])
    assert same["before"] == same["after"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{HEAD}G18 G2 X5 Z5 I5 K0 F100\nM30\n", "P:4 is an arc outside the plane XY"),
        (f"{HEAD}G1 A5 F100\nM30\n", "P:4 moves a rotary axis"),
        ("%\n(NOTHING)\n%\n", "P does nothing"),
        ("G0 X0 S500 M4\nM30\n", "P:1 turns the spindle to the left"),
        (f"{HEAD}G33 Z-5 K1\nM30\n", "P:4 probes or cuts a thread"),
        (SLOT.replace("S5000 M3", ""), "cuts while the spindle stands"),
        (f"T7 M6\n{SLOT}", "P:6 goes into the blank with tool 7, which the job does not have"),
    ],
)  # fmt: skip
def test_what_the_mill_cannot_do_is_said_with_its_line(text, message):
    with pytest.raises(ValueError, match=message):
        prepare(text, "P", JOB, MACHINE)


def test_what_is_no_job_is_refused():
    for changes, message in (
        ({"blank": (0.0, 0.0, 0.0, 1.0, 0.0, 1.0)}, "TrialJob.blank"),
        ({"limit_load_N": 0.0}, "TrialJob.limit_load_N = 0.0 N must be finite and positive"),
        ({"tools": {}}, "TrialJob.tools"),
    ):
        with pytest.raises(ValueError, match=message):
            replace(JOB, **changes)
    with pytest.raises(ValueError, match="one seed or more"):
        trials(SLOT, SLOT, JOB, MACHINE, [])
