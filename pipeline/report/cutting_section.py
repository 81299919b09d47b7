"""The section on the cut: coefficients of the force model, and what they are good for."""

from typing import Any

from pipeline.charts.numbers import NARROW, counted, fixed, number, real
from pipeline.charts.sections import Block, Heading, Section, present
from pipeline.charts.sources import dig, objects_of, rows_of
from pipeline.charts.tables import Table
from pipeline.report.control_tables import files_table
from pipeline.report.cutting_model import remainder_words, terms_table
from pipeline.report.cutting_spindle import (
    no_load_figures,
    spindle_logs_table,
    spindle_table,
    spindle_words,
)
from pipeline.report.cutting_tables import (
    chain_table,
    coefficients_table,
    cutting_methods_table,
    cutting_methods_words,
    cutting_recordings_table,
    cutting_sources,
)
from pipeline.report.cutting_units import determined, unit_of, value_words
from pipeline.report.facts import Facts
from pipeline.report.model_tables import strongest_correlation

ILL = 1e4  # condition of the scaled Jacobian above which coefficients are hard to tell apart
CLOSE = 0.95  # correlation above which two coefficients are known as a sum only
LAW = (
    "The force on a cutting edge is taken as a cutting coefficient times the area of the chip "
    "plus an edge coefficient times its width, along the cutting speed (t), away from the "
    "workpiece (r) and along the axis (a)."
)
NO_FORCES = (
    "No force was recorded on a dynamometer, so no coefficient of a direction is known: a slot at "
    "three feeds or more, at 10 kHz, gives all of them."
)
LOAD_SERVES = (
    "When there is no dynamometer, the load of the spindle serves: logged over MTConnect with the "
    "line of a program of known cuts, and once without a cut, it gives the specific force, though "
    "no coefficient of a direction."
)
WEAR = (
    "The edge coefficients are the part of the force that does not depend on the chip, that is "
    "rubbing. Edge coefficients that grow with the same tool, material and depth mean a wearing "
    "edge: measure its flank and change it. Runout that grows means dirt, a worn collet or a bent "
    "shank: clean the taper, clamp the tool anew, check it with a dial gauge. Runout also loads "
    "one tooth more than its neighbours, and that one wears first."
)
ONCE = (
    "One set of records cannot say whether either has grown, nor tell a worn edge from a harder "
    "batch of material: cut the same slots again, once with a new edge and then every few weeks, "
    "and the list of changes below says what moved."
)


def cutting_section(found: Facts) -> Section | None:
    """Coefficients and what they were found from, then the spindle's own load."""
    cutting = found.cutting
    if cutting.document is None:
        return None
    text = [
        LAW if cutting.parameters else _no_forces(cutting.document),
        f"{_found_from(found)} {_fit_words(cutting.document)}".strip() if cutting.parameters
        else "",
        _runout_words(cutting.parameters.get("runout", {})),
        remainder_words(cutting.document),
    ]  # fmt: skip
    if cutting.validation is None and cutting.parameters:
        text.append("No recording has been held against the forces yet: there is no "
                    "cutting_validation.json.")  # fmt: skip
    blocks: list[Block] = present(coefficients_table(found), chain_table(found))
    if cutting.parameters:
        said = f"{WEAR} {ONCE}"
        blocks.append(Heading(heading="What maintenance can read from this", text=said))
    how = cutting_methods_table(found)
    if how is not None:
        words = cutting_methods_words(cutting)
        blocks += [Heading(heading="How they were found", text=words), how]
    blocks += present(terms_table(found))
    blocks += present(cutting_recordings_table(found), _files_table(found))
    spindle = present(spindle_table(found), no_load_figures(found), spindle_logs_table(found))
    said = spindle_words(found)
    if spindle or said:
        blocks += [Heading(heading="Power of the spindle", text=said), *spindle]
    return Section(key="cutting", title="The cut: forces at the tool",
                   text=[words for words in text if words], blocks=blocks)  # fmt: skip


def _no_forces(document: dict[str, Any]) -> str:
    """Why there are no coefficients, and what serves where nothing better can be recorded."""
    reason = str(document.get("reason") or "").rstrip(".")
    said = f"No coefficient of the cut could be found: {reason}." if reason else NO_FORCES
    return said if dig(document, "spindle") else f"{said} {LOAD_SERVES}"


def _found_from(found: Facts) -> str:
    rows = rows_of(found.cutting.document, "recordings")
    many = sum(row.get("role") == "training" for row in rows)
    of = _cut_words(found.cutting.document or {})
    if not many:
        return f"The recordings that they were found from{of} are not named."
    return f"Found from {counted(many, 'recording')}{of}."


def _cut_words(document: dict[str, Any]) -> str:
    """Which tool cut which material."""
    tool = dig(document, "tool")
    diameter, flutes = (real(dig(tool, key)) for key in ("diameter_mm", "flutes"))
    kind = str(dig(tool, "kind") or "tool").replace("_", " ")
    words = f" of a {kind} cutter" if dig(tool, "kind") else " of a tool"
    size = [f"{diameter:g}{NARROW}mm" if diameter else "", f"{flutes:g} teeth" if flutes else ""]
    named = [s for s in size if s]
    if named:
        words += f" ({', '.join(named)})"
    material = str(document.get("material") or "")
    return f"{words} in {material}" if material else words


def _fit_words(document: dict[str, Any]) -> str:
    """How well the fit holds, and which two coefficients it tells apart worst."""
    fit, words = dig(document, "fit"), []
    error, samples, turns = (real(dig(fit, k)) for k in ("rms_error_percent", "samples",
                                                         "revolutions"))  # fmt: skip
    if error is not None:
        over = [counted(round(n), one) for n, one in ((samples, "sample"), (turns, "revolution"))
                if n]  # fmt: skip
        words.append(f"What the fit leaves over is {number(error, 2)} % of the RMS force"
                     + (f" over {' of '.join(over)}" if over else ""))  # fmt: skip
    condition = real(dig(fit, "condition"))
    if condition is not None:
        ill = ", so some are hard to tell apart" if condition > ILL else ""
        words.append(f"the condition is {number(condition, 2)}{ill}")
    pair = _strongest(document)
    if pair is not None:
        close = ", so that little more than their sum is known" if abs(pair[2]) > CLOSE else ""
        words.append(f"told apart worst are {pair[0]} and {pair[1]} (correlation "
                     f"{fixed(pair[2], 2)}{close})")  # fmt: skip
    text = "; ".join(words)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _strongest(document: dict[str, Any]) -> tuple[str, str, float] | None:
    """The worst pair of those that the table shows; the fit has unknowns that it does not."""
    labels, matrix = (dig(document, "correlation", key) for key in ("names", "matrix"))
    if not isinstance(labels, list) or not isinstance(matrix, list):
        return None
    shown = objects_of(document, "parameters")
    kept = [i for i, name in enumerate(labels) if str(name) in shown]
    rows = [row if isinstance(row, list) else [] for row in matrix]
    values = [[rows[i][j] if i < len(rows) and j < len(rows[i]) else None for j in kept]
              for i in kept]  # fmt: skip
    return strongest_correlation({"correlation": {"names": [str(labels[i]) for i in kept],
                                                  "values": values}})  # fmt: skip


def _runout_words(runout: dict[str, Any]) -> str:
    """What the runout was when the records were made; empty where it is not determined."""
    if not determined(runout):
        return ""
    off = f"{value_words(runout)}{NARROW}{unit_of(runout)}".strip()
    return f"In these records the tool’s axis was {off} off the spindle’s."


def _files_table(found: Facts) -> Table | None:
    """Files by hash that the coefficients were found from."""
    files = {
        str(row["recording"]): str(row["sha256"])
        for row in rows_of(found.cutting.document, "recordings")
        if row.get("recording") and row.get("sha256") and row.get("role") == "training"
    }
    return files_table({"found_from": files}, "the coefficients were", cutting_sources(found))
