"""The verdict on predicted program times, in words for the head of the page."""

from pipeline.charts.numbers import counted, fixed, real, signed
from pipeline.charts.sections import PartVerdict
from pipeline.report.controlled import Controlled, run_status


def worst_error(control: Controlled) -> float | None:
    """The error of the judged run that is farthest off [%]; None without any."""
    errors = [e for r in control.judged if (e := real(r.get("error_percent"))) is not None]
    return max(errors, key=abs) if errors else None


def times_verdict(control: Controlled) -> PartVerdict | None:
    """Whether program times may be planned with; None when no time was predicted at all."""
    if control.validation is None:
        return None
    judged, limit, worst = control.judged, control.limit, worst_error(control)
    if worst is None or limit is None:
        return PartVerdict(
            status="unknown",
            sentence="Program times are predicted, and no run could be judged.",
            todo="Record another run of each program, to judge the predicted times by.",
        )
    failed = [r for r in judged if run_status(r, limit) == "failed"]
    good = len(judged) - len(failed)
    sentence = (
        f"Predicted program times lie within ±{fixed(limit, 0)} % on {good} of "
        f"{counted(len(judged), 'judged run')}, at worst {signed(worst)} %."
    )
    if not failed:
        return PartVerdict(
            status="passed", sentence=sentence, todo="Nothing to repair: plan with these times."
        )
    programs = ", ".join(dict.fromkeys(str(r.get("program")) for r in failed))
    return PartVerdict(
        status="failed",
        sentence=sentence,
        todo=f"Do not plan with the predicted time of {programs}; the types of block below say "
        "what the prediction gets wrong.",
    )
