"""Canaries: checks of whether a model has seen the measurement that it predicts.

An input shares causes with what is measured, never the noise of its sensor.  So the probe looks at
what is left of both row by row: bends (how far a value lies off the straight line through those
some rows before and after), of which the other inputs and the input itself in the rows beside
explain the smooth part.  What share of what is left of the measurement does the input then explain
(squared partial correlation)?  Least squares in double precision on columns of length one, without
a penalty, so that neither the scale of an input nor a difference of two large ones hides it, and
shifted by some rows, since a late copy is a copy.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.predictions import BASELINE
from pipeline.schema.verdict import Canary, Role
from pipeline.submodels import scoring
from pipeline.submodels.contract import Prediction, SeenInputs, Target

INPUTS, PREDICTIONS = "measurement among the inputs", "measurement in the prediction"
"""Names of the checks."""
SAMPLES, VALUES = 100, 10
"""Samples, and different values among them, from which on a prediction without any error at all has
seen what it predicts [1]."""
SHARE, ALONE = 1 / 3, 0.95
"""Share from which on an input is the measurement [1]: a copy with noise up to twice as strong as
what is left of the measurement.  Where there are too few rows to take the other inputs out, an
input alone has to explain more, since it shares causes, and chance."""
EXACT = 1e-6
"""Share of the bends left over by all inputs below which they make up the measurement together [1]:
a thousandth of them, finer than the noise of any sensor."""
APART = (1, 4, 16)
"""Rows from a value to those of the straight line [1]."""
SHIFTS = (0, 1, -1, 2, -2)
"""Rows by which inputs are shifted, ahead of the measurement, behind it where negative [1]."""
KNOWN = 0.5
"""Share of the rows from which on an input counts as recorded [1]."""
FEWEST_ROWS, FOR_EACH, MOST_ROWS = 20, 10, 4000
"""Rows below which nothing is probed; rows for each column of the other inputs below which an input
is probed alone; rows that are looked at, evenly, at most [1]."""


@dataclass(frozen=True, kw_only=True)
class Explained:
    """Share of what is left over ``apart`` rows that an input explains, ``ahead`` by some rows."""

    name: str
    """Input; empty for all of them together."""
    share: float
    apart: int
    ahead: int = 0
    alone: bool = False
    """Whether no other inputs are taken out, since there are too few rows."""

    @property
    def bound(self) -> float:
        """Share from which on the input is a copy of the measurement [1]."""
        return ALONE if self.alone else SHARE


def canaries(
    predicted: Iterable[Prediction], frame: pd.DataFrame, targets: Sequence[Target], deciding: Role
) -> tuple[Canary, ...]:
    """Checks of the inputs of all cases, and of the predictions in the table of those that decide.

    A check that has nothing to look at is left out.
    """
    tables: dict[str, list[SeenInputs]] = {}
    for one in predicted:
        for seen in one.seen:
            tables.setdefault(seen.quantity, []).append(seen)
    probed = [(name, strongest(some)) for name, some in tables.items()]
    found = [_of_inputs(name, one) for name, one in probed if one is not None]
    return (*found, *_of_predictions(frame, targets, deciding))


def failures(found: Iterable[Canary]) -> list[str]:
    """What failed and why, as reasons of a verdict."""
    return [one.words for one in found if one.status == "failed"]


def _of_inputs(quantity: str, one: Explained) -> Canary:
    left = "" if one.alone else " that the other inputs leave over"
    rows = "row to row" if one.apart == 1 else f"over {one.apart} rows"
    size = f"{100 * one.share:.3g} % of the changes of {quantity} {rows}{left}"
    if one.share < one.bound:
        return Canary(
            name=INPUTS, status="passed",
            words=f"{quantity}: the input that explains most, {one.name}, explains {size}; a copy "
            f"of the measurement explains {100 * one.bound:.3g} % or more",
        )  # fmt: skip
    late = "ahead of" if one.ahead > 0 else "behind"
    shift = f"{abs(one.ahead)} row{'s' if abs(one.ahead) > 1 else ''}"
    when = f", {shift} {late} it" if one.ahead else ""
    which = one.name or "a sum of the inputs"
    return Canary(
        name=INPUTS, status="failed",
        words=f"{which} among the inputs is the target {quantity}{when}: it explains {size}, as "
        "only a copy of the measurement does: find what it is made of and leave it out",
    )  # fmt: skip


def _of_predictions(frame: pd.DataFrame, targets: Sequence[Target], deciding: Role) -> list[Canary]:
    """Targets that are predicted as measured bit for bit; none of too few samples."""
    checked, found = 0, []
    if len(frame):
        needed = {"case", "quantity", "regime", "scored", "measured", "predicted"}
        needed |= {BASELINE + name for target in targets for name in target.must_beat}
        frame = frame.loc[frame["role"] == deciding, frame.columns.isin(list(needed))]
    for target in targets:
        rows = scoring.scored_rows(frame, target)
        if len(rows) < SAMPLES or rows["measured"].nunique() < VALUES:
            continue
        checked += 1
        if np.array_equal(rows["measured"].to_numpy(float), rows["predicted"].to_numpy(float)):
            words = (
                f"{target.quantity}: all {len(rows)} predictions equal what was measured bit for "
                "bit: an input of the model holds the measurement, find it and leave it out"
            )
            found.append(Canary(name=PREDICTIONS, status="failed", words=words))
    if checked and not found:
        words = f"of {checked} predicted quantities and regimes none equals what was measured"
        found.append(Canary(name=PREDICTIONS, status="passed", words=words))
    return found


def strongest(tables: Sequence[SeenInputs]) -> Explained | None:
    """The input that explains most of a quantity; None where there are too few rows to tell."""
    tables = [one for one in tables if len(one.t)]
    if not tables:
        return None
    names = [
        name for name in tables[0].inputs
        if all(name in one.inputs for one in tables)
        and np.mean([np.isfinite(one.inputs[name]).mean() for one in tables]) >= KNOWN
    ]  # fmt: skip
    found = [one for apart in APART if names for one in _explained(tables, names, apart)]
    return max(found, key=_grave, default=None)


def _grave(one: Explained) -> tuple[bool, float]:
    """Order of gravity: an input that is a copy goes before a sum of several."""
    return bool(one.name) and one.share >= one.bound, one.share / one.bound


def _explained(
    tables: Sequence[SeenInputs], names: Sequence[str], apart: int
) -> Iterator[Explained]:
    """The share that each input explains, at each shift."""
    shifts: tuple[int, ...] = SHIFTS
    x, y = _bends(tables, names, apart, shifts)
    if len(y) < FEWEST_ROWS:  # short lives of tools have no rows to shift by
        shifts = (0,)
        x, y = _bends(tables, names, apart, shifts)
    if len(y) < FEWEST_ROWS or not y.std() > 0:
        return
    many, size = len(names), np.linalg.norm(x, axis=0)
    there = [k for k in range(len(size)) if size[k] > 0]
    alone = len(y) < FOR_EACH * len(there)
    scaled = np.column_stack([x / np.where(size > 0, size, 1.0), y])
    triangle = np.asarray(np.linalg.qr(scaled, mode="r"))
    columns, target = triangle[:, :-1], triangle[:, -1]
    if not alone and _left(target[:, None], columns[:, there]).var() < EXACT * target.var():
        yield Explained(name="", share=1.0, apart=apart)
    for j, name in enumerate(names):
        own = [k for k in there if k % many == j]
        others = [] if alone else [k for k in there if k % many != j]
        block = _left(np.column_stack([columns[:, own], target]), columns[:, others])
        for k, place in enumerate(own):
            share = _partial(block, k, EXACT * float(target @ target))
            yield Explained(
                name=name, share=share, apart=apart, ahead=shifts[place // many], alone=alone
            )


def _left(columns: Floats, others: Floats) -> Floats:
    """What others leave of some columns."""
    q: Floats = np.linalg.qr(others)[0]
    left: Floats = columns - q @ (q.T @ columns)
    return left


def _partial(block: Floats, k: int, least: float) -> float:
    """Squared partial correlation of a column with the last, given all others; 0 of nothing left.

    ``least``: square of the last column below which nothing is left of it.
    """
    pair = _left(block[:, [k, -1]], np.delete(block, [k, block.shape[1] - 1], axis=1))
    size = (pair**2).sum(axis=0)
    if size[0] < EXACT**2 or size[1] < least:  # inputs have length one
        return 0.0
    return float((pair[:, 0] @ pair[:, 1]) ** 2 / size.prod())


def _bends(
    tables: Sequence[SeenInputs], names: Sequence[str], apart: int, shifts: Sequence[int]
) -> tuple[Floats, Floats]:
    """Bends of the inputs at every shift, (N, shifts * D), and of the measurement, (N,)."""
    margin = apart + max(shifts)
    stride = max(sum(len(one.t) for one in tables) // MOST_ROWS, 1)
    parts = []
    for one in tables:
        at = np.arange(margin, len(one.t) - margin, stride)
        if not len(at):
            continue
        x = np.column_stack([np.asarray(one.inputs[name], float) for name in names])
        columns = [_off_the_line(x, one.t, at - shift, apart) for shift in shifts]
        part = np.hstack([*columns, _off_the_line(one.measured[:, None], one.t, at, apart)])
        parts.append(part[np.isfinite(part).all(axis=1)])
    whole = np.concatenate(parts) if parts else np.zeros((0, 1))
    return whole[:, :-1], whole[:, -1]


def _off_the_line(values: Floats, t: Floats, at: Ints, apart: int) -> Floats:
    """Values at some rows less those of the line through the rows before and after, (N, D)."""
    before, after = at - apart, at + apart
    with np.errstate(divide="ignore", invalid="ignore"):  # two rows at once: no line
        share = ((t[at] - t[before]) / (t[after] - t[before]))[:, None]
    found: Floats = values[at] - (1 - share) * values[before] - share * values[after]
    return found
