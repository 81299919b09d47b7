"""Units: from the text that users and MTConnect documents write to factors and offsets.

The only module that imports pint, and only when a conversion is not the identity.  Angles, counts,
sound level, acidity, apparent and reactive power are dimensions of their own here, so that a
speed in revolution/minute never turns into a percentage or a hertz without its turn: one hertz is
one revolution/second.  Arithmetic is exact (fractions); only the result is rounded.
"""

import re
from fractions import Fraction
from functools import lru_cache
from typing import Any

from pipeline.signals.unit_names import (
    AMBIGUOUS,
    ASKED,
    MTCONNECT_UNITS,
    NAMES,
    NATIVE_UNITS,
    SAME,
    WHOLE,
)

_DEFINITIONS = (
    "radian = [angle] = rad",
    "hertz = revolution / second = Hz",
    "count = [count]",
    "decibel = [sound_level] = dB",
    "acidity_ph = [acidity]",
    "volt_ampere = [apparent_power] = VA",
    "volt_ampere_reactive = [reactive_power] = var = VAR = VAr",
    "strain = []",
)

_LETTER = r"(?![²³¹⁻])[^\W\d_]"
_NAME = rf"(?:{_LETTER})+|°(?:{_LETTER})*|%|‰"
_TOKEN = re.compile(
    rf"\s*(?:(?P<name>{_NAME})(?P<power>(?:\^|\*\*)?[-+]?\d(?!\d)|[⁻]?[²³¹])?"
    r"|(?P<one>1)(?=\s*/)|(?P<over>/)|(?P<times>[*·⋅.\-_])|(?P<open>\()|(?P<close>\)))\s*"
)
_SUPERSCRIPT = str.maketrans("⁻¹²³", "-123")
_DIMENSIONS = {"SQUARE": 2, "CUBIC": 3, "sq": 2, "cu": 3}
_SCALES = ("degree_Celsius", "degree_Fahrenheit")
_SIGNS = "°%‰µΩΩÅåΔε"
_LONGEST = 60  # characters; no unit is longer, and no text may keep pint busy


def conversion(from_unit: str, to_unit: str) -> tuple[float, float]:
    """Factor and offset that take a value from one unit to another.

    Parameters
    ----------
    from_unit, to_unit : str
        Ordinary text (``"mm/min"``, ``"°C"``, ``"rpm"``) or MTConnect's names; ``""`` for none.

    Returns
    -------
    tuple of float
        ``(factor, offset)`` with ``value_to = value_from * factor + offset``.

    Raises
    ------
    ValueError
        When a unit is not known or the two do not measure the same quantity.

    Examples
    --------
    >>> conversion("inch/min", "MILLIMETER/SECOND")[0] * 60
    25.4
    >>> conversion("°C", "CELSIUS")
    (1.0, 0.0)
    """
    source, target = _plain(from_unit), _plain(to_unit)
    if source == target and source in _KNOWN:
        return 1.0, 0.0
    return _conversion(source, target)


def mtconnect_factor(native: str, units: str, scale: float = 1.0) -> tuple[float, float]:
    """Factor and offset from an adapter's ``nativeUnits`` to the document's ``units``.

    Parameters
    ----------
    native, units : str
        The attributes ``nativeUnits`` and ``units`` of a data item.
    scale : float
        ``nativeScale``: the number in the log is the measured value times this.

    Returns
    -------
    tuple of float
        ``(factor, offset)``: ``value_units = value_native * factor + offset``.

    Raises
    ------
    ValueError
        As :func:`conversion`, or when ``scale`` is zero or not finite.
    """
    if not (0 < abs(scale) < float("inf")):
        raise ValueError(f"nativeScale {scale} of {native!r} divides nothing: give a finite number")
    factor, offset = conversion(native, units)
    return factor / scale, offset


def mtconnect_unit(unit: str) -> str:
    """MTConnect's unit for the quantity that ``unit`` measures; ``unit`` itself when it has none.

    Raises
    ------
    ValueError
        When the unit is not known, or is a letter that stands for several quantities.
    """
    plain = _plain(unit)
    if plain in MTCONNECT_UNITS or not plain:
        return plain
    if plain in AMBIGUOUS:
        either = " or ".join(repr(name) for name in AMBIGUOUS[plain])
        raise ValueError(f"unit {plain!r} can be {either}: write the one that is meant")
    alike = _alike().get(_dimension(plain), [plain])
    names = " ".join(_names(_parsed(plain)))
    asked = [choice for word, choice in ASKED if word in names and choice in alike]
    return (asked or alike)[0]


def _plain(unit: str) -> str:
    """Text without brackets, namespace and ``_3D``, as MTConnect's name where it is one."""
    text = unit.strip()
    if text[:1] + text[-1:] in ("[]", "()") and text != "[-]":
        text = text[1:-1].strip()
    text = re.sub(r"^[a-z]+:(?=[A-Z])", "", text).replace("μ", "µ").replace("º", "°")
    text = re.sub(r"(?i)\s+per\s+", "/", text).removesuffix("_3D")
    return SAME.get(text, text)


_KNOWN = frozenset(u.removesuffix("_3D") for u in (*MTCONNECT_UNITS, *NATIVE_UNITS)) | {""}


@lru_cache(maxsize=4096)
def _conversion(source: str, target: str) -> tuple[float, float]:
    for source_unit in _meanings(source):
        for target_unit in _meanings(target):
            if source_unit.dimensionality == target_unit.dimensionality:
                zero = _registry().convert(Fraction(0), source_unit, target_unit)
                one = _registry().convert(Fraction(1), source_unit, target_unit)
                return float(one - zero), float(zero)
    raise ValueError(
        f"unit {source!r} cannot become {target!r}: they measure different quantities; "
        "correct the unit of this signal"
    )


def _meanings(text: str) -> list[Any]:
    """Pint units that a text can stand for."""
    return [_parsed(name) for name in AMBIGUOUS.get(text, (text,))]


@lru_cache(maxsize=4096)
def _dimension(plain: str) -> tuple[tuple[str, Fraction], ...]:
    return tuple(sorted(_parsed(plain).dimensionality.items()))


@lru_cache(maxsize=1)
def _alike() -> dict[tuple[tuple[str, Fraction], ...], list[str]]:
    """MTConnect's units by dimension."""
    found: dict[tuple[tuple[str, Fraction], ...], list[str]] = {}
    for unit in MTCONNECT_UNITS:
        if not unit.endswith("_3D"):
            found.setdefault(_dimension(unit), []).append(unit)
    return found


@lru_cache(maxsize=1)
def _registry() -> Any:
    """Pint with this module's dimensions; built from nothing so that no cached dimension is old."""
    from importlib.resources import files

    import pint

    registry = pint.UnitRegistry(None, non_int_type=Fraction, on_redefinition="ignore")
    registry.load_definitions(str(files("pint") / "default_en.txt"))
    for line in _DEFINITIONS:
        registry.define(line)
    return registry


@lru_cache(maxsize=4096)
def _parsed(text: str) -> Any:
    """Pint unit of a text."""
    result = _registry().parse_units("")
    if text in WHOLE:
        return _registry()(WHOLE[text]).units if WHOLE[text] else result
    import pint

    try:
        return _product([(_named(name, text), power) for name, power in _terms(text)], result)
    except pint.PintError as error:  # a unit on a scale of logarithms, in a product
        raise _unknown(text) from error


def _product(terms: list[tuple[Any, int]], result: Any) -> Any:
    """Product of units and powers; beside others a temperature is a difference."""
    for unit, power in terms:
        scale = next((name for name in _names(unit) if name in _SCALES), None)
        if scale and (len(terms) > 1 or power != 1):
            unit = _registry().parse_units(f"delta_{scale}")
        result = result * unit**power
    return result


def _terms(text: str) -> list[tuple[str, int]]:
    """Names and powers of a text, by the grammar of units only: no numbers, no expressions."""
    terms: list[tuple[str, int]] = []
    inside, sign, dimension, position = False, 1, 1, 0
    while position < len(text):
        token = _TOKEN.match(text, position)
        if token is None or len(text) > _LONGEST or (inside and (token["over"] or token["open"])):
            raise _unknown(text)
        position = token.end()
        if token["name"] in _DIMENSIONS:
            dimension = _DIMENSIONS[token["name"]]
        elif token["name"]:
            power = int((token["power"] or "1").translate(_SUPERSCRIPT).lstrip("^*+"))
            terms.append((token["name"], sign * dimension * power))
            sign, dimension = (sign if inside else 1), 1
        elif token["over"]:
            sign = -1
        elif token["open"] or token["close"]:
            inside = bool(token["open"])
            sign = sign if inside else 1
    if inside or sign < 0:
        raise _unknown(text)
    return terms


def _names(unit: Any) -> list[str]:
    """Names in a pint unit; its own text cannot be had, as pint cannot print exact powers."""
    return [name for name, _ in _registry().Quantity(1, unit).unit_items()]


def _named(name: str, text: str) -> Any:
    """Pint unit of one name in a text."""
    import pint

    if name == "S" and text.isupper() and len(text) > 1:
        name = "second"
    if not all(sign in _SIGNS or (sign.isascii() and sign.isalpha()) for sign in name):
        raise _unknown(text)
    written = [name.lower(), name] if len(name) > 2 and name.istitle() else [name, name.lower()]
    for candidate in [NAMES.get(name, written[0]), *written, name.lower().removesuffix("s")]:
        try:
            return _registry().parse_units(candidate)
        except (pint.UndefinedUnitError, pint.DefinitionSyntaxError, ValueError):
            continue
    raise _unknown(text)


def _unknown(text: str) -> ValueError:
    return ValueError(
        f"unit {text[:_LONGEST]!r} is not known: write it as in 'mm/min', 'degC' or MTConnect's "
        "'REVOLUTION/MINUTE'"
    )
