"""Units: from the text that users and MTConnect documents write to factors and offsets.

The only module that imports pint.  Angles, counts, sound level, acidity, apparent and reactive
power are dimensions of their own here: one hertz is one revolution/second, no percentage.
Arithmetic is exact (fractions); only the result is rounded.

Source: MTConnect 1.0 to 2.7, UnitEnum and NativeUnitEnum.
"""

import re
from fractions import Fraction
from functools import lru_cache
from threading import RLock
from typing import Any

MTCONNECT_UNITS = (
    "MILLIMETER", "MILLIMETER/SECOND", "MILLIMETER/SECOND^2", "MILLIMETER/REVOLUTION",
    "DEGREE", "DEGREE/SECOND", "DEGREE/SECOND^2", "REVOLUTION/MINUTE",
    "PERCENT", "CELSIUS", "SECOND", "NEWTON", "JOULE", "NEWTON_METER", "PASCAL", "PASCAL/SECOND",
    "PASCAL_SECOND", "AMPERE", "COULOMB", "VOLT", "WATT", "VOLT_AMPERE",
    "VOLT_AMPERE_REACTIVE", "OHM", "OHM_METER", "SIEMENS/METER", "KILOGRAM", "GRAM/CUBIC_METER",
    "LITER", "LITER/SECOND", "SQUARE_MILLIMETER", "CUBIC_MILLIMETER/SECOND^2", "COUNT",
    "COUNT/SECOND", "DECIBEL", "PH", "HERTZ", "MILLIMETER_3D", "DEGREE_3D", "UNIT_VECTOR_3D",
    "MICRO_RADIAN", "REVOLUTION/SECOND", "REVOLUTION/SECOND^2", "METER/SECOND^2", "GRAM",
    "MILLIGRAM", "MILLIGRAM/CUBIC_MILLIMETER", "MILLILITER", "CUBIC_METER", "CUBIC_MILLIMETER",
    "CUBIC_MILLIMETER/SECOND", "WATT_SECOND",
)  # fmt: skip
"""UnitEnum of MTConnect 1.0 to 2.7; of several for one dimension the first is the one on disk."""

NATIVE_UNITS = (
    "AMPERE_HOUR", "BAR", "CENTIPOISE", "CUBIC_FOOT", "CUBIC_FOOT/HOUR", "CUBIC_FOOT/MINUTE",
    "DEGREE/MINUTE", "FAHRENHEIT", "FOOT", "FOOT/MINUTE", "FOOT/SECOND", "FOOT/SECOND^2",
    "FOOT_3D", "GALLON/MINUTE", "GRAVITATIONAL_ACCELERATION", "GRAVITATIONAL_FORCE", "HOUR",
    "INCH", "INCH/MINUTE", "INCH/REVOLUTION", "INCH/SECOND", "INCH/SECOND^2", "INCH_3D",
    "INCH_POUND", "KELVIN", "KILOWATT", "KILOWATT_HOUR", "LITER/MINUTE", "MICROMETER",
    "MICROTORR", "MILLIMETER/MINUTE", "MILLIMETER_MERCURY", "MINUTE", "PASCAL/MINUTE", "POUND",
    "POUND/INCH^2", "RADIAN", "RADIAN/MINUTE", "RADIAN/SECOND", "RADIAN/SECOND^2", "RANKINE",
    "SQUARE_INCH", "TORR",
)  # fmt: skip
"""NativeUnitEnum of MTConnect 1.0 to 2.7, without OTHER, which stands for an unknown unit."""

# Ordinary text for MTConnect's own units: what needs no conversion must not wait for pint.
SAME = {
    "mm": "MILLIMETER", "mm/s": "MILLIMETER/SECOND", "mm/s^2": "MILLIMETER/SECOND^2",
    "mm/s²": "MILLIMETER/SECOND^2", "mm/rev": "MILLIMETER/REVOLUTION", "deg": "DEGREE",
    "°": "DEGREE", "deg/s": "DEGREE/SECOND", "°/s": "DEGREE/SECOND", "rpm": "REVOLUTION/MINUTE",
    "RPM": "REVOLUTION/MINUTE", "1/min": "REVOLUTION/MINUTE", "U/min": "REVOLUTION/MINUTE",
    "%": "PERCENT", "percent": "PERCENT", "degC": "CELSIUS", "°C": "CELSIUS",
    "CELCIUS": "CELSIUS", "s": "SECOND", "sec": "SECOND", "N": "NEWTON", "Nm": "NEWTON_METER",
    "N*m": "NEWTON_METER", "N·m": "NEWTON_METER", "N m": "NEWTON_METER", "Pa": "PASCAL",
    "A": "AMPERE", "V": "VOLT", "W": "WATT", "J": "JOULE", "Hz": "HERTZ", "kg": "KILOGRAM",
    "dB": "DECIBEL", "pH": "PH", "-": "", "1": "", "[-]": "",
}  # fmt: skip

# Whole texts that the grammar below would misread or does not know.
WHOLE = {
    "UNIT_VECTOR": "", "MILLIMETER_MERCURY": "mmHg", "GRAVITATIONAL_ACCELERATION": "g_0",
    "GRAVITATIONAL_FORCE": "gram * g_0", "INCH_POUND": "inch * force_pound",
    "POUND/INCH^2": "psi", "MICRO_RADIAN": "microradian", "VOLT_AMPERE": "volt_ampere",
    "VOLT_AMPERE_REACTIVE": "volt_ampere_reactive", "PH": "acidity_ph", "pH": "acidity_ph",
    "1/min": "revolution / minute", "/min": "revolution / minute",
    "min-1": "revolution / minute", "min^-1": "revolution / minute",
    "min⁻¹": "revolution / minute", "1/s": "revolution / second", "s-1": "revolution / second",
    "s^-1": "revolution / second", "Upm": "revolution / minute", "ipm": "inch / minute",
    "IPM": "inch / minute", "ips": "inch / second", "ipr": "inch / revolution",
    "fpm": "foot / minute", "sfm": "foot / minute", "lpm": "liter / minute",
    "gpm": "gallon / minute", "in-lb": "inch * force_pound", "ft-lb": "foot * force_pound",
    "ft-lbs": "foot * force_pound", "in-lbf": "inch * force_pound",
    "ft-lbf": "foot * force_pound", "dB(A)": "decibel", "g_0": "g_0", "g_n": "g_0",
    "lb/in2": "psi", "lb/in^2": "psi",
}  # fmt: skip

# Names of one unit that pint lacks or reads as something that no machine tool reports.
NAMES = {
    "MM": "mm", "M": "meter", "NM": "newton * meter", "KN": "kilonewton", "KNM": "kN * meter",
    "KW": "kilowatt", "KWH": "kilowatt_hour", "KVA": "kilovolt_ampere", "KHZ": "kilohertz",
    "KPA": "kilopascal", "MPA": "megapascal", "Mpa": "megapascal", "UM": "micrometer",
    "IN": "inch", "CM": "cm", "°": "degree", "U": "revolution",
    "tr": "revolution", "rev": "revolution", "Umdr": "revolution", "pcs": "count",
    "inc": "count", "cnt": "count", "counts": "count", "Nm": "newton * meter",
    "kNm": "kilonewton * meter", "mNm": "millinewton * meter", "Ncm": "newton * centimeter",
    "Nmm": "newton * millimeter", "dBA": "decibel", "grd": "degree", "min": "minute",
    "ε": "strain", "µε": "microstrain", "με": "microstrain",
}  # fmt: skip

# One letter, two units: the other side of the conversion tells which is meant.
AMBIGUOUS = {
    "g": ("gram", "g_0"),
    "C": ("degC", "coulomb"),
    "F": ("degF", "farad"),
    "lb": ("pound", "lbf"),
    "lbs": ("pound", "lbf"),
    '"': ("inch", "arcsecond"),
}

# Of several MTConnect units for one dimension, the one that the names in the text ask for.
PREFERRED = (
    ("hertz", "HERTZ"),
    ("turn", "REVOLUTION/MINUTE"),
    ("revolution", "REVOLUTION/MINUTE"),
    ("newton", "NEWTON_METER"),
    ("force", "NEWTON_METER"),
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
_ONE_REGISTRY = RLock()  # threads that each built one would hold units of different registries
_LONGEST = 60  # characters; no unit is longer, and no text may keep pint busy


def conversion(from_unit: str, to_unit: str) -> tuple[float, float]:
    """Factor and offset that take a value from one unit to another: ``value * factor + offset``.

    Units are ordinary text (``"mm/min"``, ``"°C"``, ``"rpm"``) or MTConnect's names, ``""`` for
    none.  One that is not known, and two that do not measure the same quantity, are a ValueError.

    >>> conversion("inch/min", "MILLIMETER/SECOND")[0] * 60
    25.4
    >>> conversion("°C", "CELSIUS")
    (1.0, 0.0)
    """
    source, target = _normalised(from_unit), _normalised(to_unit)
    if source == target and source in _KNOWN:
        return 1.0, 0.0
    with _ONE_REGISTRY:
        return _conversion(source, target)


def mtconnect_factor(native: str, units: str, scale: float = 1.0) -> tuple[float, float]:
    """Factor and offset from ``nativeUnits`` to ``units``, with ``scale`` of the logged number."""
    if not (0 < abs(scale) < float("inf")):
        raise ValueError(f"nativeScale {scale} of {native!r} divides nothing: give a finite number")
    factor, offset = conversion(native, units)
    return factor / scale, offset


def mtconnect_unit(unit: str) -> str:
    """MTConnect's unit for the quantity of ``unit``, or itself; ValueError if not known."""
    text = _normalised(unit)
    if text in MTCONNECT_UNITS or not text:
        return text
    if text in AMBIGUOUS:
        either = " or ".join(repr(name) for name in AMBIGUOUS[text])
        raise ValueError(f"unit {text!r} can be {either}: write the one that is meant")
    with _ONE_REGISTRY:
        alike = _alike().get(_dimension(text), [text])
        names = " ".join(_names(_parsed(text)))
    preferred = [choice for word, choice in PREFERRED if word in names and choice in alike]
    return (preferred or alike)[0]


def _normalised(unit: str) -> str:
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
    return [_parsed(name) for name in AMBIGUOUS.get(text, (text,))]


@lru_cache(maxsize=4096)
def _dimension(text: str) -> tuple[tuple[str, Fraction], ...]:
    return tuple(sorted(_parsed(text).dimensionality.items()))


@lru_cache(maxsize=1)
def _alike() -> dict[tuple[tuple[str, Fraction], ...], list[str]]:
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
