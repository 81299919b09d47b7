"""True parameters of a simulated machine's feed drives beside the identified ones."""

from collections.abc import Iterator, Mapping

from pipeline.charts.numbers import real
from pipeline.charts.parameters import KnownValue, Units, in_units
from pipeline.charts.sources import stated
from pipeline.schema.drive import MOTOR, DriveModel
from pipeline.schema.model import Parameter
from pipeline.submodels.contract import Shown
from pipeline.submodels.drive.inverse_dynamics import DIRECTIONS


def known_values(shown: Shown[DriveModel], units: Units) -> Iterator[KnownValue]:
    """Parameters beside the truth, in ``units``."""
    truth = stated(shown.truth, "drives")
    axes = {} if shown.model is None else dict(shown.model.axes)
    for part in (*sorted(axes), MOTOR):
        found = shown.parameters(part)
        of = stated(truth, MOTOR) if part == MOTOR else stated(truth, "axes", part)
        plain = {str(name): real(v.get("value") if isinstance(v, dict) else v)
                 for name, v in (of if isinstance(of, dict) else {}).items()}  # fmt: skip
        known = {name: v for name, v in plain.items() if v is not None}
        for name, true in truth_as_fitted(known, found).items():
            if (p := found.get(name)) is not None:
                factor = units.get(p.unit, ("", 1.0))[1]
                yield KnownValue(name=f"{part} {name}", true=true * factor,
                                 parameter=in_units(p, units))  # fmt: skip


def truth_as_fitted(
    truth: dict[str, float], parameters: Mapping[str, Parameter]
) -> dict[str, float]:
    """The truth [SI] by name, with friction and constant force split as the fit splits them.

    Motion shows the sums F_c+ + F_0 and F_c- - F_0 alone.  A fit that takes friction as equal in
    both directions, or F_0 as none, moves a part of F_0 into friction, and so must the truth.
    """
    both = [truth.get(f"coulomb_{direction}") for direction in DIRECTIONS]
    if both[0] is None or both[1] is None:
        return truth
    seen = [
        None if (p := parameters.get(f"coulomb_{direction}")) is None else p.value
        for direction in DIRECTIONS
    ]
    force = truth.get("offset", 0.0)
    offset = parameters.get("offset")
    if seen[0] is not None and seen[0] == seen[1]:
        moved = (both[0] - both[1]) / 2
    elif offset is None or not offset.determined:
        moved = -force
    else:
        return truth
    changed = {"offset": force + moved}
    for direction, sign in (("positive", -1.0), ("negative", 1.0)):
        changed |= {
            name: truth[name] + sign * moved
            for name in (f"coulomb_{direction}", f"static_{direction}") if name in truth
        }  # fmt: skip
    return {**truth, **changed}
