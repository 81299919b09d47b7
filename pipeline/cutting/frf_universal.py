"""Frequency responses from universal files (UFF, UNV): data set 58, text or binary.

Units: a label of the ordinate counts, then data set 164, else SI.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.frf import FrequencyResponse, joined
from pipeline.cutting.frf_unit import one_direction, unit_of

_DERIVATIVES = {8: 0, 11: 1, 12: 2}
"""Specific data type of data set 58: displacement, velocity, acceleration."""
_RESPONSE, _TRANSLATIONS = 4, {1: "x", 2: "y"}


def read_universal(path: Path, direction: str | None) -> FrequencyResponse:
    """All frequency responses of a universal file, as one.

    Raises
    ------
    OSError, ValueError
        When the file cannot be read.
    """
    try:
        import pyuff
    except ImportError as error:
        raise ValueError("universal files need the package pyuff: pip install kerf[uff]") from error
    path.read_bytes()  # what hinders reading is said by the system, not by pyuff
    try:
        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in file.get_set_types()]
        sets = [file.read_sets(k) for k, kind in enumerate(types) if kind == 58]
        units = [file.read_sets(k) for k, kind in enumerate(types) if kind == 164]
    except Exception as error:  # pyuff raises Exception itself for whatever is wrong in a file
        raise ValueError(f"is no whole universal file: {str(error)[:200]}") from error
    responses = [item for item in sets if item.get("func_type") == _RESPONSE]
    if not responses:
        raise ValueError(
            f"holds {len(sets)} data sets 58, and none is a frequency response (function type 4)"
        )
    return joined([_one(item, units, direction) for item in responses])


def _one(
    item: dict[str, Any], units: list[dict[str, Any]], direction: str | None
) -> FrequencyResponse:
    there, where = int(item.get("rsp_dir", 0)), int(item.get("ref_dir", 0))
    sign = 1
    if direction is None:
        if abs(there) not in _TRANSLATIONS or abs(where) not in _TRANSLATIONS:
            raise ValueError(
                f"data set 58 has response direction {there}, reference direction {where}: only "
                "1, 2 and -1, -2 (x and y) count; leave the others out, or say the direction"
            )
        sign = 1 if there * where > 0 else -1
        named = _TRANSLATIONS[abs(there)] + _TRANSLATIONS[abs(where)]
        name = named[0] if named[0] == named[1] else named
    else:
        name = direction
    values: NDArray[Any] = np.asarray(item["data"])
    frequency = np.asarray(item["x"], dtype=np.float64)
    if len(values) != len(frequency) or len(values) != int(item.get("num_pts", len(values))):
        raise ValueError(
            f"data set 58 announces {item.get('num_pts')} values and has {len(values)}: it is cut"
        )
    factor, derivative = _unit(item, units)
    return one_direction(frequency, values.astype(np.complex128) * factor, derivative, name, sign)


def _unit(item: dict[str, Any], units: list[dict[str, Any]]) -> tuple[float, int]:
    """Factor to SI and derivative: a label counts, then data set 164, else SI."""
    kind = int(item.get("ordinate_spec_data_type", 0))
    if kind not in _DERIVATIVES:
        raise ValueError(
            f"data set 58 is of ordinate data type {kind}: only 8 (displacement), 11 (velocity) "
            "and 12 (acceleration) over a force count"
        )
    label = str(item.get("ordinate_axis_units_lab", "")).strip()
    if label and label.upper() != "NONE":
        factor, derivative = unit_of(label if label.endswith("/N") else f"{label}/N")
        if derivative != _DERIVATIVES[kind]:
            raise ValueError(
                f"data set 58 is of ordinate data type {kind}, and its unit is {label!r}: one of "
                "them is wrong"
            )
        return factor, derivative
    if units:
        length, force = float(units[0]["length"]), float(units[0]["force"])
        if not (length > 0.0 and force > 0.0):
            raise ValueError(f"data set 164 has factors {length:g}, {force:g}, not above 0")
        return force / length, _DERIVATIVES[kind]
    return 1.0, _DERIVATIVES[kind]
