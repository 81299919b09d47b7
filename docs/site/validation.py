"""Validation pages, made from the key figures in data/metrics, and the figures of README and docs/.

``python docs/site/validation.py`` fills in each figure that stands beside its source, as
``pipeline/app/document_figures.py`` says; with ``--check`` it names those that are stale.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from pipeline.app.document_figures import document_figures, filled  # noqa: E402

REMEDY = "run `python docs/site/validation.py`"
MOST_QUANTITIES = 12
"""Rows of a machine on a page; further quantities stand in its metrics file and report."""


class Subject(NamedTuple):
    """A subject whose predictions are judged."""

    title: str
    page: str
    """How-to page."""
    compared: str
    """What is compared with what."""


SUBJECTS = {
    "spindle": Subject(
        "Spindle temperature", "models",
        "Winding temperature on days that no model was fitted on: in windows of one hour, each "
        "started from a measured temperature, and in a free run over the day from its first "
        "temperature alone.",
    ),
    "deformation": Subject(
        "Spindle growth", "deformation",
        "Growth of the spindle nose on whole speed profiles that no method was fitted on.",
    ),
    "control": Subject(
        "Control", "control",
        "Run time of programs, without the operator's stops, on runs that the control was not "
        "identified from; the relative error is that of the judged times together.",
    ),
    "drive": Subject(
        "Feed drives", "drives",
        "Force rebuilt from the recorded motion, and following error of the simulated closed loop "
        "that gets the recorded reference alone, on recordings that the drives were not identified "
        "from.",
    ),
    "following_residual": Subject(
        "Residual following error", "following-residual",
        "Following error predicted by drive model and network on recordings held out: before the "
        "motion, and estimated from measurements that are 20 ms old.",
    ),
    "cutting": Subject(
        "Cutting forces", "cutting",
        "Forces on the dynamometer over one revolution, on recordings that nothing was fitted on. "
        "Where everything was fitted on, each recording is predicted by a fit on the others.",
    ),
    "wear": Subject(
        "Tool wear", "wear",
        "Flank wear of tools that no method was trained on, reading by reading.",
    ),
    "synthesis": Subject(
        "Generated signals", "synthesis",
        "Wear that judges read from generated windows, against the wear that was requested, on "
        "tools held out; and how far windows of the same conditions differ.",
    ),
}  # fmt: skip
QUANTITY_HEAD = (
    "| machine | quantity | MAE, RMSE, worst | error | inside 90 % | error saved against |\n"
    "|---|---|---|---|---|---|\n"
)
OPTIMISED_HEAD = (
    "| machine | program | time as programmed | optimised | change | cost | peak load "
    "| P(load > limit) | geometry |\n|---|---|---|---|---|---|---|---|---|\n"
)


SHOWN = {"N/m": (1e-6, "N/µm"), "N s/m": (1e-3, "N s/mm"), "m": (1e6, "µm")}
"""Units in which quantities are shown, and the factor to them."""


def pages(metrics: Path) -> dict[str, str]:
    """Validation pages by name, in Markdown."""
    simulated = simulated_machines()
    found = {}
    for name, subject in SUBJECTS.items():
        files = _files(metrics, name)
        if files:
            found[name] = _page(name, subject, files, simulated)
    return found | {"optimisation": _optimisation_page(_files(metrics, "optimise"), simulated)}


def simulated_machines() -> set[str]:
    """Machines whose records a fleet takes from the simulated shop floor."""
    fleets = (yaml.safe_load(path.read_text()) for path in (ROOT / "conf/fleet").glob("*.yaml"))
    return {machine for fleet in fleets for machine in fleet["simulated"]}


def _files(metrics: Path, name: str) -> dict[str, dict[str, Any]]:
    """Key figures by machine."""
    paths = sorted(metrics.glob(f"*_{name}.json"))
    return {path.stem.removesuffix(f"_{name}"): json.loads(path.read_text()) for path in paths}


def _page(
    name: str, subject: Subject, files: dict[str, dict[str, Any]], simulated: set[str]
) -> str:
    verdicts = "".join(
        f"| {_label(machine, simulated)} | {figures['status']} | {figures['cases_judged']} |\n"
        for machine, figures in files.items()
    )
    rows = "".join(
        _row(_label(machine, simulated), quantity, values)
        for machine, figures in files.items()
        for quantity, values in list(_quantities(figures))[:MOST_QUANTITIES]
    )
    return (
        f"# Validation: {subject.title.lower()}\n\n{subject.compared}\n\n"
        f"How to use it: [{subject.title}](../{subject.page}.md). Theory: "
        f"[{subject.title}](../theory/{subject.page}.md). Method of all judgements: "
        f"[Judgement](../theory/judgement.md).\n\n"
        f"| machine | verdict | cases judged |\n|---|---|---|\n{verdicts}\n{QUANTITY_HEAD}{rows}\n"
        f"{_identified(files, simulated)}"
        f"The tables are made from `data/metrics/<machine>_{name}.json`, which\n\n"
        f"```sh\ndvc repro judge_{name}\n```\n\n"
        "writes for the machines of the active fleet; `reports/<machine>_"
        f"{name}.html` has every recording. MAE and RMSE are over all judged samples, "
        "*worst* is the greatest RMSE of a group, *inside 90 %* the share of samples inside the "
        "90 % prediction interval. *Error saved* is the share of a baseline's mean absolute error "
        "that the model avoids. Machines marked *simulated* are those of the simulated shop floor; "
        "mill00 has short records and the quick budget.\n"
    )


def _identified(files: dict[str, dict[str, Any]], simulated: set[str]) -> str:
    """Table of the parameters that stand among the key figures, or nothing."""
    rows = [
        f"| {_label(machine, simulated)} | {part} | {name.replace('_', ' ')} "
        f"| {_parameter(values)} |\n"
        for machine, figures in files.items()
        for part, parameters in figures.items()
        if isinstance(parameters, dict)
        for name, values in parameters.items()
        if isinstance(values, dict) and "interval_95" in values
    ]
    head = "| machine | part | parameter | identified, 95 % interval |\n|---|---|---|---|\n"
    return head + "".join(rows) + "\n" if rows else ""


def _unit(values: dict[str, Any]) -> str:
    return "µm" if values["unit"] == "um" else str(values["unit"])


def _parameter(values: dict[str, Any]) -> str:
    if values["value"] is None or values["interval_95"] is None:
        return "not determined"
    factor, unit = SHOWN.get(values["unit"], (1.0, values["unit"]))
    value, low, high = (_figure(factor * x) for x in (values["value"], *values["interval_95"]))
    return f"{value} ({low} to {high}) {unit}"


def _quantities(figures: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Judged quantities; parameters of a shaft, which stand beside them, have no error."""
    for quantity, values in figures.items():
        if isinstance(values, dict) and "rmse" in values:
            yield quantity, values


def _row(machine: str, quantity: str, values: dict[str, Any]) -> str:
    saved = ", ".join(
        f"{baseline.replace('_', ' ')} {_percent(share)}"
        for baseline, share in (values["skill_mae"] or {}).items()
    )
    coverage = _percent(values["coverage_90"])
    if values["half_width_over_rmse"] == "not known":
        coverage += ", too wide to be of use"
    relative = values["relative_percent"]
    error = "–" if relative is None else f"{relative:.3g} %"
    errors = ", ".join(_figure(values[key]) for key in ("mae", "rmse", "worst_rmse"))
    cells = (machine, quantity.replace("_", " "), f"{errors} {_unit(values)}", error, coverage,
             saved or "–")  # fmt: skip
    return f"| {' | '.join(cells)} |\n"


def _optimisation_page(files: dict[str, dict[str, Any]], simulated: set[str]) -> str:
    rows = "".join(
        _optimised_row(_label(machine, simulated), program, figures)
        for machine, figures in files.items()
        for program in _programs(figures)
    )
    return (
        "# Validation: optimised programs\n\nPrograms that stage `optimise` changed, as programmed "
        "and optimised, predicted by the twin of the machine. The geometry is compared by an "
        "independent proof.\n\nHow to use it: [Optimise a program](../optimisation.md). Theory: "
        f"[Optimisation](../theory/optimisation.md).\n\n{OPTIMISED_HEAD}{rows}\n"
        "The table is made from `data/metrics/<machine>_optimise.json`, which\n\n"
        "```sh\ndvc repro optimise\n```\n\nwrites for the machines of the active fleet. Where the "
        "simulated shop floor cuts both programs (`dvc repro trial`), "
        "`reports/<machine>_programs.html` lays predicted and cut times and loads side by side.\n"
    )


def _programs(figures: dict[str, Any]) -> list[str]:
    end = "_before_time_s"
    return [key.removesuffix(end) for key in figures if key.endswith(end)]


def _optimised_row(machine: str, program: str, figures: dict[str, Any]) -> str:
    before, after = (figures[f"{program}_{when}_time_s"] for when in ("before", "after"))
    cost = " → ".join(_figure(figures.get(f"{program}_{w}_cost_KRW")) for w in ("before", "after"))
    load = " → ".join(_figure(figures[f"{program}_{w}_peak_load_N"]) for w in ("before", "after"))
    same = "unchanged" if figures[f"{program}_same_geometry"] else "CHANGED"
    exceeded = figures.get(f"{program}_exceedance")
    chance = "–" if exceeded is None else f"{100 * exceeded:.2g} %"
    return (
        f"| {machine} | {program} | {_figure(before)} s | {_figure(after)} s | "
        f"{100 * (after / before - 1):+.1f} % | {cost} KRW | {load} N | {chance} | {same} |\n"
    )


def _label(machine: str, simulated: set[str]) -> str:
    return f"{machine} (simulated)" if machine in simulated else machine


def _figure(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f} %"


def documents() -> list[Path]:
    """README and the pages of docs/."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def stale(path: Path) -> list[str]:
    """Figures of a document that are not what their source says, each in a sentence."""
    name = str(path.relative_to(ROOT))
    return [
        f"{name}, line {one.line}: {one.shown} is {one.recomputed} in {one.source}: {REMEDY}"
        for one in document_figures(path.read_text(encoding="utf-8"), ROOT, name)
        if one.shown != one.recomputed
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Fill in the figures of README and docs/.")
    parser.add_argument("--check", action="store_true", help="name those that are stale instead")
    if parser.parse_args().check:
        sys.exit("\n".join(said for path in documents() for said in stale(path)) or None)
    for path in documents():
        path.write_text(filled(path.read_text(encoding="utf-8"), ROOT, path.name), encoding="utf-8")
