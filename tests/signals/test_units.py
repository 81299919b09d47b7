"""Units against textbook numbers, which are independent of the library that computes them."""

import math
import subprocess
import sys

import pint
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.signals.columns import COLUMNS
from pipeline.signals.units import (
    MTCONNECT_UNITS,
    NATIVE_UNITS,
    conversion,
    mtconnect_factor,
    mtconnect_unit,
)

# Definitions: 1 inch = 25.4 mm, 1 lb = 0.45359237 kg, g_n = 9.80665 m/s² (exact, 1959 and CGPM
# 1901); 1 US gallon = 231 inch³; 1 atm = 101325 Pa = 760 torr; 1 mmHg = 133.322387415 Pa.
POUND_FORCE = 0.45359237 * 9.80665
TEXTBOOK = [
    ("INCH", "MILLIMETER", 25.4), ("FOOT", "MILLIMETER", 304.8),
    ("FOOT_3D", "MILLIMETER_3D", 304.8), ("INCH_3D", "MILLIMETER_3D", 25.4),
    ("x:METER", "MILLIMETER", 1000), ("MICROMETER", "MILLIMETER", 0.001),
    ("INCH/MINUTE", "MILLIMETER/SECOND", 25.4 / 60), ("INCH/SECOND", "MILLIMETER/SECOND", 25.4),
    ("INCH/SECOND^2", "MILLIMETER/SECOND^2", 25.4),
    ("INCH/REVOLUTION", "MILLIMETER/REVOLUTION", 25.4), ("FOOT/MINUTE", "MILLIMETER/SECOND", 5.08),
    ("FOOT/SECOND", "MILLIMETER/SECOND", 304.8), ("FOOT/SECOND^2", "MILLIMETER/SECOND^2", 304.8),
    ("MILLIMETER/MINUTE", "MILLIMETER/SECOND", 1 / 60),
    ("METER/SECOND^2", "MILLIMETER/SECOND^2", 1000),
    ("GRAVITATIONAL_ACCELERATION", "METER/SECOND^2", 9.80665),
    ("GRAVITATIONAL_FORCE", "NEWTON", 9.80665e-3), ("DEGREE/MINUTE", "DEGREE/SECOND", 1 / 60),
    ("RADIAN", "DEGREE", 180 / math.pi), ("RADIAN/SECOND", "DEGREE/SECOND", 180 / math.pi),
    ("RADIAN/MINUTE", "DEGREE/SECOND", 3 / math.pi),
    ("RADIAN/SECOND^2", "DEGREE/SECOND^2", 180 / math.pi),
    ("RADIANS PER SECOND", "DEGREE/SECOND", 180 / math.pi),
    ("MICRO_RADIAN", "DEGREE", 180e-6 / math.pi), ("REVOLUTION/SECOND", "REVOLUTION/MINUTE", 60),
    ("REVOLUTION/SECOND^2", "DEGREE/SECOND^2", 360), ("REVOLUTION/MINUTE", "DEGREE/SECOND", 6),
    ("HERTZ", "REVOLUTION/MINUTE", 60), ("MINUTE", "SECOND", 60), ("HOUR", "SECOND", 3600),
    ("KILOWATT", "WATT", 1000), ("KILOWATT_HOUR", "JOULE", 3.6e6),
    ("KILOWATT_HOUR", "WATT_SECOND", 3.6e6), ("AMPERE_HOUR", "COULOMB", 3600),
    ("KILOAMPERE", "AMPERE", 1000), ("POUND", "KILOGRAM", 0.45359237), ("GRAM", "KILOGRAM", 0.001),
    ("MILLIGRAM", "GRAM", 0.001), ("MILLIGRAM/CUBIC_MILLIMETER", "GRAM/CUBIC_METER", 1e6),
    ("INCH_POUND", "NEWTON_METER", POUND_FORCE * 0.0254),
    ("POUND/INCH^2", "PASCAL", POUND_FORCE / 0.0254**2), ("BAR", "PASCAL", 1e5),
    ("TORR", "PASCAL", 101325 / 760), ("MICROTORR", "PASCAL", 101325 / 760e6),
    ("MILLIMETER_MERCURY", "PASCAL", 133.322387415), ("PASCAL/MINUTE", "PASCAL/SECOND", 1 / 60),
    ("CENTIPOISE", "PASCAL_SECOND", 0.001), ("GALLON/MINUTE", "LITER/SECOND", 231 * 0.254**3 / 60),
    ("LITER/MINUTE", "LITER/SECOND", 1 / 60), ("CUBIC_FOOT", "LITER", 3.048**3),
    ("CUBIC_FOOT/MINUTE", "LITER/SECOND", 3.048**3 / 60),
    ("CUBIC_FOOT/HOUR", "LITER/SECOND", 3.048**3 / 3600), ("CUBIC_METER", "LITER", 1000),
    ("CUBIC_MILLIMETER", "MILLILITER", 0.001), ("CUBIC_MILLIMETER/SECOND", "LITER/SECOND", 1e-6),
    ("SQUARE_INCH", "SQUARE_MILLIMETER", 645.16), ("PERCENT", "", 0.01), ("UNIT_VECTOR_3D", "", 1),
    ("mm/min", "MILLIMETER/SECOND", 1 / 60), ("MM/MIN", "MILLIMETER/SECOND", 1 / 60),
    ("MM/S", "MILLIMETER/SECOND", 1), ("Inch/Min", "MILLIMETER/SECOND", 25.4 / 60),
    ("ipm", "MILLIMETER/SECOND", 25.4 / 60), ("km/h", "MILLIMETER/SECOND", 1e6 / 3600),
    ("inches", "MILLIMETER", 25.4), ("in", "MILLIMETER", 25.4), ('"', "MILLIMETER", 25.4),
    ("µm", "MILLIMETER", 0.001), ("μm", "MILLIMETER", 0.001), ("um", "MILLIMETER", 0.001),
    ("m/s²", "MILLIMETER/SECOND^2", 1000), ("m/s2", "MILLIMETER/SECOND^2", 1000),
    ("m s^-2", "MILLIMETER/SECOND^2", 1000), ("g", "MILLIMETER/SECOND^2", 9806.65),
    ("g", "KILOGRAM", 0.001), ("U/min", "REVOLUTION/MINUTE", 1), ("min-1", "REVOLUTION/MINUTE", 1),
    ("rev/min", "REVOLUTION/MINUTE", 1), ("kN", "NEWTON", 1000), ("lbf", "NEWTON", POUND_FORCE),
    ("lb", "NEWTON", POUND_FORCE), ("kgf", "NEWTON", 9.80665), ("Ncm", "NEWTON_METER", 0.01),
    ("kNm", "NEWTON_METER", 1000), ("ft-lb", "NEWTON_METER", POUND_FORCE * 0.3048),
    ("kW", "WATT", 1000), ("KW", "WATT", 1000), ("hp", "WATT", 550 * 0.3048 * POUND_FORCE),
    ("bar", "PASCAL", 1e5), ("MPa", "PASCAL", 1e6), ("N/mm^2", "PASCAL", 1e6),
    ("psi", "PASCAL", POUND_FORCE / 0.0254**2), ("mA", "AMPERE", 0.001),
    ("kVA", "VOLT_AMPERE", 1000), ("kvar", "VOLT_AMPERE_REACTIVE", 1000),
    ("l/min", "LITER/SECOND", 1 / 60), ("ms", "SECOND", 0.001), ("µε", "PERCENT", 1e-4),
    ("degC/min", "K/s", 1 / 60), ("°F/min", "degC/min", 5 / 9), ("W/(m K)", "W/m/K", 1),
]  # fmt: skip


@pytest.mark.parametrize(("source", "target", "factor"), TEXTBOOK)
def test_factor_is_the_textbooks(source: str, target: str, factor: float) -> None:
    found, offset = conversion(source, target)
    # One rounding of the exact fraction here, at most three in the expression above.
    assert found == pytest.approx(factor, rel=4e-16 * 4)
    assert offset == 0


@pytest.mark.parametrize(
    ("source", "target", "points"),
    [
        ("FAHRENHEIT", "CELSIUS", [(32, 0), (212, 100), (-40, -40)]),
        ("°F", "degC", [(32, 0), (212, 100)]),
        ("KELVIN", "CELSIUS", [(273.15, 0), (0, -273.15)]),
        ("RANKINE", "CELSIUS", [(491.67, 0), (0, -273.15)]),
        ("C", "CELSIUS", [(20, 20)]),
        ("degC", "K", [(0, 273.15), (26.85, 300)]),
    ],
)
def test_temperatures_are_affine(
    source: str, target: str, points: list[tuple[float, float]]
) -> None:
    factor, offset = conversion(source, target)
    for value, expected in points:
        # 300 K has a spacing of 6e-14 in float64; two roundings.
        assert value * factor + offset == pytest.approx(expected, abs=2e-13)


def test_every_unit_of_mtconnect_is_known() -> None:
    for unit in (*MTCONNECT_UNITS, *NATIVE_UNITS):
        assert conversion(unit, unit) == (1.0, 0.0)
        factor, _ = conversion(unit, mtconnect_unit(unit))
        assert factor > 0


def test_columns_agree_with_conversion() -> None:
    si = {"CELSIUS": "K", "DEGREE": "rad", "DEGREE/SECOND": "rad/s", "MILLIMETER": "m",
          "MILLIMETER/SECOND": "m/s", "PERCENT": "", "REVOLUTION/MINUTE": "rad/s",
          "SECOND": "s", "": ""}  # fmt: skip
    for column in COLUMNS.values():
        expected = (column.factor, column.offset)
        assert conversion(column.unit, si[column.unit]) == pytest.approx(expected, rel=4e-16)


@given(st.sampled_from([(a, b) for a, b, _ in TEXTBOOK]), st.floats(-1e6, 1e6, allow_nan=False))
def test_there_and_back(pair: tuple[str, str], value: float) -> None:
    there, back = conversion(*pair), conversion(*reversed(pair))
    again = (value * there[0] + there[1]) * back[0] + back[1]
    assert again == pytest.approx(value, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize(
    ("source", "target"),
    [
        ("rpm", "PERCENT"), ("DEGREE", "PERCENT"), ("COUNT", "PERCENT"), ("DECIBEL", "PERCENT"),
        ("PH", ""), ("VOLT_AMPERE", "WATT"), ("VOLT_AMPERE_REACTIVE", "VOLT_AMPERE"),
        ("mm", "mm/s"), ("CELSIUS", "PERCENT"), ("MILLIMETER/REVOLUTION", "MILLIMETER"),
    ],
)  # fmt: skip
def test_different_quantities_are_refused(source: str, target: str) -> None:
    with pytest.raises(ValueError, match="different quantities"):
        conversion(source, target)


@pytest.mark.parametrize(
    "text",
    ["FOO", "OTHER", "9**9**9", "mm/", "/", "(mm", "2 mm", "nan", "__import__('os')", "mm" * 40,
     "lambda x: x", "mm**0.5", "\x00", "1e9"],
)  # fmt: skip
def test_unknown_text_is_named(text: str) -> None:
    with pytest.raises(ValueError, match="is not known") as error:
        conversion(text, text)
    assert repr(text[:40])[1:-1] in str(error.value)
    assert "MTConnect" in str(error.value)


def test_both_units_stand_in_the_message() -> None:
    with pytest.raises(ValueError, match="'bar' cannot become 'MILLIMETER'"):
        conversion("bar", "mm")


@example("ำ")
@example("¼")
@example("%fNp")
@given(st.text(max_size=30))
def test_any_text_is_a_unit_or_a_value_error(text: str) -> None:
    try:
        factor, offset = conversion(text, text)
    except ValueError:
        return
    assert (factor, offset) == (1.0, 0.0)


def test_native_scale_divides() -> None:
    """MTConnect part 2: the value reported is the measured one times nativeScale."""
    assert mtconnect_factor("PERCENT", "PERCENT", 100) == (0.01, 0.0)
    factor, offset = mtconnect_factor("FAHRENHEIT", "CELSIUS", 10)
    assert 2120 * factor + offset == pytest.approx(100, abs=1e-13)
    with pytest.raises(ValueError, match="nativeScale 0"):
        mtconnect_factor("PERCENT", "PERCENT", 0)


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("µm", "MILLIMETER"), ("kWh", "JOULE"), ("Ncm", "NEWTON_METER"), ("ft-lb", "NEWTON_METER"),
        ("kHz", "HERTZ"), ("rev/s", "REVOLUTION/MINUTE"), ("rad/s", "DEGREE/SECOND"),
        ("kN", "NEWTON"), ("°F", "CELSIUS"), ("", ""), ("V/s", "V/s"), ("GRAM", "GRAM"),
    ],
)  # fmt: skip
def test_unit_on_disk(unit: str, expected: str) -> None:
    assert mtconnect_unit(unit) == expected


def test_a_letter_for_two_units_is_refused() -> None:
    with pytest.raises(ValueError, match="'gram' or 'g_0'"):
        mtconnect_unit("g")


def test_the_identity_does_not_wait_for_pint() -> None:
    code = (
        "import sys; from pipeline.signals.units import conversion as c\n"
        "for a, b in [('degC', 'CELSIUS'), ('rpm', 'REVOLUTION/MINUTE'), ('mm', 'MILLIMETER'),"
        " ('%', 'PERCENT'), ('MILLIMETER_3D', 'MILLIMETER_3D'), ('', '')]:\n"
        "    assert c(a, b) == (1.0, 0.0)\n"
        "sys.exit('pint' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_threads_that_begin_together_share_their_units() -> None:
    """Each would build a registry of its own, whose units no other one takes."""
    program = """
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
sys.setswitchinterval(1e-6)
from pipeline.signals.units import conversion, mtconnect_unit
units = ["um", "inch", "foot", "degF", "bar", "lbf", "kW", "min"]
together = Barrier(len(units))
def own(unit):
    together.wait()
    return conversion(unit, mtconnect_unit(unit))[0]
with ThreadPoolExecutor(len(units)) as pool:
    print(*(round(one, 4) for one in pool.map(own, units)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split() == [
        "0.001", "25.4", "304.8", "0.5556", "100000.0", "4.4482", "1000.0", "60.0",
    ], done.stderr  # fmt: skip


def test_every_column_agrees_with_pint() -> None:
    pint_itself = pint.UnitRegistry()
    names = {
        "": "dimensionless", "CELSIUS": "degC", "PERCENT": "percent", "SECOND": "second",
        "MILLIMETER": "millimeter", "MILLIMETER/SECOND": "millimeter/second",
        "DEGREE": "degree", "DEGREE/SECOND": "degree/second",
        "REVOLUTION/MINUTE": "revolution/minute",
    }  # fmt: skip
    for column in COLUMNS.values():
        unit = names[column.unit]
        zero = pint_itself.Quantity(0.0, unit).to_base_units().magnitude
        one = pint_itself.Quantity(1.0, unit).to_base_units().magnitude
        # 274.15 - 273.15 loses the last digits of 273.15: 6e-14.
        assert column.factor == pytest.approx(one - zero, rel=1e-12), column.name
        assert column.offset == pytest.approx(zero, abs=1e-12), column.name
