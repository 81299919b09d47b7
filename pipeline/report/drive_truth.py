"""The simulated drives as they were made, against what was found of them."""

from typing import Any

from pipeline.charts.numbers import between, number, powers, real, resolved, signed
from pipeline.charts.sources import dig, objects_of
from pipeline.charts.tables import MOST_ROWS, Cell, Table, cells, left_out, names, numbers, sources
from pipeline.report.drive_units import in_shop_units, si_in_shop_units
from pipeline.report.facts import Facts

MOST_OPEN = 20  # rows that need not be unfolded
NOTE = (
    "Motion shows only sums of friction and of the force that is always there: where the fit takes "
    "friction as alike both ways, or that force as none, the truth is parted the same way."
)


def drive_truth_table(found: Facts) -> Table | None:
    """True value, value found, and whether its 95 % interval holds the truth, by axis."""
    truth = dig(found.model.truth, "drives")
    parts = [
        (axis, _values(dig(truth, "axes", axis)), objects_of(one, "parameters"))
        for axis, one in found.drives.axes.items()
    ]
    motor = dig(found.drives.drive, "motor")
    parts.append(("motor", _values(dig(truth, "motor")), objects_of(motor, "parameters")))
    shown = [(part, truth_as_found(true, found), found) for part, true, found in parts]
    parted = any(a != b for (_, a, _), (_, b, _) in zip(parts, shown, strict=True))
    rows = [
        (_inside(value, p), _row(part, name, value, p))
        for part, true, parameters in shown
        for name, value in true.items()
        if (p := parameters.get(name)) is not None
    ]
    if not rows or found.folders.truth is None:
        return None
    known = [inside for inside, _ in rows if inside is not None]
    return Table(
        caption=f"Drives: what was simulated against what was found; {sum(known)} of "
        f"{number(len(known))} intervals hold the truth{left_out(len(rows), MOST_ROWS)}",
        note=NOTE if parted else "",
        heads=[*names("Parameter"),
               *numbers(("true", ""), ("found", ""), ("off by", "%"), ("95 % interval", "")),
               *names("unit", "interval")],
        rows=[row for _, row in rows[:MOST_ROWS]],
        sources=sources(found.shelf, found.folders.models / "drive.json", found.folders.truth),
        folded=len(rows) > MOST_OPEN,
    )  # fmt: skip


def _values(truth: Any) -> dict[str, float]:
    """True values by name, as numbers or as objects with a ``value``."""
    found = truth if isinstance(truth, dict) else {}
    plain = {name: dig(v, "value") if isinstance(v, dict) else v for name, v in found.items()}
    return {str(name): x for name, v in plain.items() if (x := real(v)) is not None}


def truth_as_found(
    truth: dict[str, float], parameters: dict[str, dict[str, Any]]
) -> dict[str, float]:
    """The truth, with friction and constant force parted as the fit parts them.

    Motion shows the sums F_c+ + F_0 and F_c- - F_0 alone.  A fit that takes friction as alike both
    ways, or F_0 as none, moves a part d of F_0 into friction, and so must the truth.

    Parameters
    ----------
    truth : dict of str to float
        True values by name, in SI.
    parameters : dict of str to dict
        What was found, by name.
    """
    both = [truth.get(f"coulomb_{way}") for way in ("positive", "negative")]
    if both[0] is None or both[1] is None:
        return truth
    seen = [parameters.get(f"coulomb_{way}", {}).get("value") for way in ("positive", "negative")]
    force = truth.get("offset", 0.0)
    if seen[0] is not None and seen[0] == seen[1]:
        moved = (both[0] - both[1]) / 2
    elif not parameters.get("offset", {}).get("determined"):
        moved = -force
    else:
        return truth
    changed = {"offset": force + moved}
    for way, sign in (("positive", -1.0), ("negative", 1.0)):
        changed |= {f"{kind}_{way}": truth[f"{kind}_{way}"] + sign * moved
                    for kind in ("coulomb", "static") if f"{kind}_{way}" in truth}  # fmt: skip
    return {**truth, **changed}


def _inside(true: float, p: dict[str, Any]) -> bool | None:
    """Whether the interval holds the truth; None where nothing was found."""
    shown = in_shop_units(p)
    low, high = shown["low"], shown["high"]
    if not p.get("determined") or low is None or high is None:
        return None
    return bool(low <= si_in_shop_units(true, str(p.get("unit") or "")) <= high)


def _row(part: str, name: str, true: float, p: dict[str, Any]) -> list[Cell]:
    shown, inside = in_shop_units(p), _inside(true, p)
    true_shown = si_in_shop_units(true, str(p.get("unit") or ""))
    known = bool(p.get("determined")) and shown["value"] is not None
    digits = resolved(shown["low"], shown["high"])
    verdict = {
        True: Cell(text="holds the truth", status="passed"),
        False: Cell(text="misses the truth", status="failed"),
        None: Cell(text="–"),
    }[inside]
    return cells(
        Cell(text=f"{part} {name}", code=True),
        number(true_shown, digits),
        number(shown["value"], digits) if known else "not determined",
        signed(100 * (shown["value"] / true_shown - 1), 2) if known and true_shown else "–",
        "–" if inside is None else between(shown["low"], shown["high"]),
        powers(shown["unit"]) or "–",
        verdict,
    )
