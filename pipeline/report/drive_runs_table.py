"""Recordings against the twin: force by inverse dynamics, following error in closed loop."""

from pipeline.charts.numbers import NOT_KNOWN, fixed, number, real
from pipeline.charts.sources import dig
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Head,
    Table,
    cells,
    left_out,
    names,
    numbers,
    sources,
)
from pipeline.report.driven import DriveRun
from pipeline.report.facts import Facts

FORCE = (
    "Force: error of the force that the recorded motion asks for, over the measured force; its "
    "plain guess is one constant level against the motion."
)
LEVEL = (
    "Means: of the force against motion, measured and by the model, whose friction levels they "
    "judge where single samples are rough."
)
FOLLOWING = (
    "Following error: the twin runs the recorded reference alone; errors over the record’s own "
    "RMS and maximum; its plain guess is speed over loop gain."
)


def drive_runs_table(found: Facts) -> Table | None:
    """Every axis in every recording, the judged first, with the plain guesses beside."""
    runs = found.drives.runs
    if not runs:
        return None
    force = any(run.force for run in runs)
    following = any(run.following for run in runs)
    reasons = any(_reason(run, found) for run in runs)
    level = not following and any(real(run.force.get("mean_measured")) for run in runs)
    unit = next((str(run.force.get("unit")) for run in runs if run.force), "")
    shown = (force, level, following, reasons)
    return Table(
        caption=f"Records against the twin{left_out(len(runs), MOST_ROWS)}",
        note=" ".join(
            words for words, there in zip((FORCE, LEVEL, FOLLOWING), shown, strict=False) if there
        ),
        heads=[
            *names("Recording", "axis"), *numbers(("length", "s")),
            *(numbers(("error", "%"), ("plain guess", "%"), group="Force") if force else []),
            *(numbers(("mean", unit), ("modelled", unit)) if level else []),
            *(numbers(("RMS", "µm"), ("max", "µm"), ("error RMS", "%"), ("error max", "%"),
                      ("error RMS", "µm"), ("plain guess", "µm"), group="Following error")
              if following else []),
            Head(name="verdict"), *names(*(["why"] if reasons else [])),
        ],
        rows=[_row(run, found, shown) for run in runs[:MOST_ROWS]],
        sources=sources(found.shelf, found.folders.models / "drive_validation.json"),
        folded=len(runs) > 40,
    )  # fmt: skip


def _row(run: DriveRun, found: Facts, shown: tuple[bool, bool, bool, bool]) -> list[Cell]:
    force, following = run.force, run.following
    forces = [
        _or_void(force.get("relative_error_percent"), 1),
        _or_void(force.get("baseline_relative_error_percent"), 1),
    ]
    levels = [_or_void(force.get("mean_measured")), _or_void(force.get("mean_modelled"))]
    followings = [
        _or_void(following.get("rms_um")),
        _or_void(following.get("max_um")),
        _or_void(following.get("error_rms_percent"), 1),
        _or_void(following.get("error_max_percent"), 1),
        _or_void(following.get("error_rms_um")),
        _or_void(following.get("baseline_error_rms_um")),
    ]
    return cells(
        Cell(text=run.recording or NOT_KNOWN, code=True),
        run.axis,
        number(run.seconds),
        *(forces if shown[0] else []),
        *(levels if shown[1] else []),
        *(followings if shown[2] else []),
        _verdict(run),
        *([_reason(run, found) or "–"] if shown[3] else []),
    )


def _or_void(value: object, decimals: int | None = None) -> str:
    x = real(value)
    if x is None:
        return "–"
    return number(x) if decimals is None else fixed(x, decimals)


def _verdict(run: DriveRun) -> Cell:
    if run.role == "training":
        return Cell(text="learnt from", status="unknown")
    return Cell(text="not judged" if run.status == "unknown" else run.status, status=run.status)


def _reason(run: DriveRun, found: Facts) -> str:
    """Why it failed or was not judged, less what stands with the axis already."""
    if run.role == "training":
        return ""
    said = str(dig(found.drives.axes.get(run.axis), "drive", "servo_reason") or "")
    return (run.reason.replace(said, "") if said else run.reason).strip("; ")
