"""Documented units of the physics: they parse, every formula has them, its arithmetic keeps them.

A formula is dimensionally homogeneous: with other base units (metres 1.1 times as long, seconds 1.2
times, …) its inputs and its output change by the factors of their documented units.  A wrong unit,
or a unit factor hidden in the code, breaks that.
"""

import ast
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from importlib import import_module
from pkgutil import walk_packages
from types import ModuleType
from typing import Any

import numpy as np
import pint
import pytest

from pipeline.app.json_schema import settings

ROOMS = ("cutting", "machine", "thermal")
REGISTRY = pint.UnitRegistry()
REGISTRY.define("currency = [currency]")
REGISTRY.define("rev = revolution")
SCALES = {
    "[length]": 1.1, "[mass]": 0.9, "[time]": 1.2, "[current]": 0.85, "[temperature]": 1.05,
    "[currency]": 1.15,
}  # fmt: skip
"""Factors by which the base units shrink; near 1, so that ranges of parameters hold."""
BRACKET = re.compile(r"(?<![\w\]])\[([^\[\]\n]+)\]")
UNIT = re.compile(r"(?![A-Z_]{3,})[A-Za-z%µ°][\w µ°%^*/-]*|1(?:/[\w^]+)?")
NUMBERS = re.compile(r"^(float|Floats|ArrayLike|Any)( \| None)?$")
RETURNS = re.compile(
    r"^(float|Floats|Any|Complexes|NDArray\[np\.complex128\]|tuple\[(float|Floats|Any)(, "
    r"(float|Floats|Any))*\])$"
)
WORDS = {" m^m_c": "", " of lag": "", " per unit of the source": "", " per period": ""}
"""Words beside units that change no dimension, and the power of a chip's exponent."""
SYMBOLS = {
    "n": "rev/s", "rated": "W", "base_speed": "rev/s", "cutting": "W", "no_load": "W",
    "torque": "N m", "diameter": "m", "v_c": "m/s", "f_z": "m", "a_p": "m", "times": "s",
    "lasting": "s", "phi_st": "rad", "phi_ex": "rad", "angles": "rad", "lower": "m", "upper": "m",
    "low": "m", "high": "m", "height": "m", "thickness": "m", "depth": "m", "limit": "m",
    "growth": "m", "slope": "rad", "shape": "m", "exponent": "1", "flutes": "1", "m_c": "1",
    "load_factor": "1", "hold": "1", "i_d": "A", "i_q": "A", "u_d": "V", "u_q": "V",
    "speed": "rad/s", "alpha": "V", "beta": "V", "dc_link": "V", "motor_inertia": "kg m^2",
    "load_inertia": "kg m^2", "stiffness": "N m/rad", "torque_constant": "N m/A", "lead": "m/rev",
    "angle": "rad", "filters": "s", "change": "m/s", "acceleration": "m/s^2", "jerk": "m/s^3",
    "rate": "1/s", "source": "K/s", "start": "K", "ambient": "K", "coolant": "K", "dt": "s",
    "body_start": "K", "v_0": "m/s", "v_1": "m/s", "top": "m/s", "a": "m/s^2", "t": "s", "s": "m",
    "length": "m", "distance": "m", "radius": "m", "curvature": "1/m", "drift": "m/s",
    "heat": "1", "feed": "m/s", "spindle": "rev/min", "speeds": "rev/min",
    "jump": "m/s", "v": "m/s", "step": "s", "feedforward": "1",
}  # fmt: skip
"""Units of names that mean the same in all formulas, where a docstring says none."""
ENDINGS = {
    "_rad_s": "rad/s", "_m_min": "m/min", "_rpm": "rev/min", "_kWh": "kW h", "_C": "degC",
    "_Hz": "Hz", "_W": "W", "_mm": "mm", "_um": "um", "_s": "s", "_m": "m",
}  # fmt: skip
"""Units that end a parameter's name."""
ANY = {"x", "y", "cos", "sin", "values", "of_part", "points", "centres", "temperatures", "band",
       "motor", "feeds", "sources"}  # fmt: skip
"""Parameters of any unit, or with columns of several, which the text names."""


@cache
def modules() -> tuple[ModuleType, ...]:
    """Modules of the rooms, and the stored parameters of a drive."""
    found = [import_module("pipeline.schema.drive")]
    for room in ROOMS:
        package = import_module(f"pipeline.{room}")
        found += [package]
        for one in walk_packages(package.__path__, f"{package.__name__}."):
            found.append(import_module(one.name))
    return tuple(found)


@cache
def functions() -> dict[str, Callable[..., Any]]:
    """Public functions by module and name, those that are compiled as they are in Python."""
    found = {}
    for module in modules():
        for name, value in vars(module).items():
            plain = getattr(value, "py_func", value)
            own = inspect.isfunction(plain) and plain.__module__ == module.__name__
            if own and not name.startswith("_"):
                found[f"{module.__name__.removeprefix('pipeline.')}.{name}"] = plain
    return found


def public(name: str) -> Any:
    """The function or class of that name in one of the rooms."""
    for module in modules():
        value = vars(module).get(name)
        if value is not None and getattr(value, "__module__", "") == module.__name__:
            return getattr(value, "py_func", value)
    raise AssertionError(f"no room holds {name}: correct the example of tests/test_units.py")


def text(documented: object) -> str:
    """Docstring without its examples."""
    return re.split(r"\nExamples\n-+\n", inspect.getdoc(documented) or "")[0]


def units_in(words: str) -> list[str]:
    """Units in brackets, in their order; subscripts and lists of numbers are none."""
    lists = [one.split(", ") for one in BRACKET.findall(words)]
    return [unit for every in lists if all(map(UNIT.fullmatch, every)) for unit in every]


def parsed(unit: str) -> pint.Unit:
    """The unit as pint reads it; a blank multiplies."""
    for word, meaning in WORDS.items():
        unit = unit.replace(word, meaning)
    return REGISTRY.Unit("" if unit == "1" else re.sub(r"(?<=\w) +(?=\w)", "*", unit))


def factor(unit: str) -> float:
    """By what a number of this unit grows with the other base units."""
    found = 1.0
    for base, power in parsed(unit).dimensionality.items():
        found *= SCALES[base] ** float(power)
    return found


def parameter_units(function: Callable[..., Any]) -> dict[str, str]:
    """Unit of each parameter: of the docstring's section, else of the symbol."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?=\n\n\S[^\n]*\n-{3,}|\Z)", text(function),
                        re.M | re.S)  # fmt: skip
    found = {}
    for entry in re.split(r"\n(?=\S)", section[1]) if section else ():
        names, _, words = entry.partition("\n")
        several = [one.strip() for one in names.partition(" : ")[0].split(",")]
        units = units_in(words)
        for place, name in enumerate(several):
            if len(units) == len(several):
                found[name] = units[place]
            elif units and (len(units) == 1 or len(several) == 1):
                found[name] = units[0]  # columns of several units: the first of them
    names = inspect.signature(function).parameters
    ended = {name: unit for name in names for end, unit in reversed(ENDINGS.items())
             if name.endswith(end)}  # fmt: skip
    known = SYMBOLS | ended | found
    return {name: known[name] for name in names if name in known}


def return_units(function: Callable[..., Any]) -> list[str]:
    """Units of what a function returns: of the section, else the first of the text before it."""
    words = text(function)
    section = re.search(r"^Returns\n-+\n(.*?)(?=\n\n\S[^\n]*\n-{3,}|\Z)", words, re.M | re.S)
    head = re.split(r"\n\n\S[^\n]*\n-{3,}\n", words)[0]
    return (units_in(section[1]) if section else []) or units_in(head)[:1]


def annotations(function: Callable[..., Any]) -> dict[str, str]:
    """Annotations as they are written."""
    tree = ast.parse(inspect.cleandoc("\n" + inspect.getsource(function)))
    (node,) = (n for n in tree.body if isinstance(n, ast.FunctionDef))
    every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    hints = {one.arg: ast.unparse(one.annotation) for one in every if one.annotation}
    return hints | ({"return": ast.unparse(node.returns)} if node.returns else {})


def formulas() -> Iterator[str]:
    """Public functions of numbers that return numbers."""
    for name, function in functions().items():
        if RETURNS.match(annotations(function).get("return", "")):
            yield name


MIXED = {
    "basis": "columns of several units", "profile_basis": "columns of several units",
    "bin_middles": "sines and cosines", "block_loads": "unit of the values",
    "chisel_thrust": "for each coefficient",
    "design": "columns of several units", "drive_row": "columns of several units",
    "edge_elements": "columns of several units", "edge_shape": "columns of several units",
    "fuzzy_c_means": "unit of the points", "harmonic_matrices": "as mean_matrix",
    "heat_sources": "columns of several units", "lag": "unit of the values",
    "laws_lines": "as local_lines", "life_price": "currency of the tool table",
    "limited": "volts, as the parameters",
    "objective": "unit of the points, squared", "published": "columns of several units",
    "rotated": "unit of the vector", "samples": "unit of the values",
    "sensor_groups": "weights", "settling_time": "as the time",
    "tool_limits": "unit of the limit", "unit_heat": "columns of several units",
    "unit_responses": "as its heat", "first_order": "unit of the start",
    "fuzzy_rules": "columns of several units",
}  # fmt: skip
"""Formulas without one unit of what they return, and why."""


@pytest.mark.parametrize("module", modules(), ids=lambda one: one.__name__)
def test_every_documented_unit_parses(module: ModuleType) -> None:
    said = []
    for value in vars(module).values():
        plain = getattr(value, "py_func", value)
        if getattr(plain, "__module__", "") != module.__name__:
            continue
        if inspect.isfunction(plain) or inspect.isclass(plain):
            said += [(plain.__name__, unit) for unit in units_in(text(plain))]
        if inspect.isclass(plain) and is_dataclass(plain):
            said += [(f"{plain.__name__}.{key.name}", unit)
                     for key in settings(plain) for unit in units_in(key.meaning)]  # fmt: skip
    for name, unit in said:
        try:
            parsed(unit)
        except (pint.UndefinedUnitError, pint.DefinitionSyntaxError, AttributeError) as error:
            pytest.fail(f"{module.__name__}.{name}: [{unit}] is no unit ({error})")


@pytest.mark.parametrize("name", list(formulas()))
def test_a_formula_has_a_unit_for_every_parameter_and_what_it_returns(name: str) -> None:
    function = functions()[name]
    hints, known = annotations(function), parameter_units(function)
    numbers = {key for key, hint in hints.items() if NUMBERS.match(hint) and key != "return"}
    assert numbers <= set(known) | ANY, f"{name} says no unit of {numbers - set(known) - ANY}"
    assert return_units(function) or function.__name__ in MIXED, f"{name} returns no unit"


def friction() -> Any:
    side = public("DirectionFriction")
    return public("FrictionParameters")(
        positive=side(coulomb=300.0, static=400.0, stribeck_velocity=0.05, viscous=2e3),
        negative=side(coulomb=320.0, static=450.0, stribeck_velocity=0.05, viscous=1e3),
    )


def drive() -> Any:
    return public("SpindleDrive")(
        rated_power_kW=15.0, base_speed_rpm=2500.0, top_speed_rpm=12000.0, efficiency=0.88,
        minimum_speed_rpm=300.0, no_load_W=(60.0, 2.0, 0.03),
    )  # fmt: skip


def winding() -> Any:
    return public("MotorParameters")(
        resistance=0.5, inductance_d=4e-3, inductance_q=6e-3, flux=0.2, pole_pairs=4, inertia=2e-3
    )


def law() -> Any:
    return public("ForceLaw")(K_tc=9e8, K_rc=3e8, K_te=1.2e4, K_re=1.4e4)


def tip() -> Any:
    return [public("Mode")(direction="x", natural_frequency_Hz=922.0, damping=0.02,
                           stiffness_N_m=1.3e6)]  # fmt: skip


def spindle() -> Any:
    return public("SpindleThermalParameters")(
        cooling_rate=1e-4, coupling_rate=3e-3, capacity_ratio=0.1, body_cooling_rate=2e-4,
        coolant_rate=1e-4,
    )  # fmt: skip


EXAMPLES: dict[str, dict[str, Any]] = {
    "power_curve": {"n": [10.0, 60.0], "rated": 15e3, "base_speed": 40.0},
    "available_power": {"n": [10.0, 60.0], "drive": drive},
    "shaft_power": {"cutting": 900.0, "no_load": 80.0, "drive": drive},
    "motor_power": {"torque": 12.0, "n": 50.0, "drive": drive},
    "spindle_supply": {"cutting": 900.0, "no_load": 80.0, "drive": drive},
    "cutting_power": {"torque": 12.0, "n": 50.0},
    "stiffness": {"law": law, "thickness": 5e-5},
    "modal_receptance": {"modes": tip, "frequency_Hz": np.array([300.0, 900.0])},
    "induced_voltages": {"i_d": -1.0, "i_q": 8.0, "speed": 150.0, "motor": winding},
    "current_rates": {"i_d": -1.0, "i_q": 8.0, "u_d": 20.0, "u_q": 150.0, "speed": 150.0,
                      "motor": winding},
    "torque": {"i_d": -1.0, "i_q": 8.0, "motor": winding},
    "copper_loss": {"i_d": -1.0, "i_q": 8.0, "motor": winding},
    "quasi_steady_body": {"start": 35.0, "ambient": 20.0, "coolant": 18.0, "parameters": spindle},
    "cutting_speed": {"diameter": 0.012, "n": 80.0},
    "margin": {"depth": [1e-3, 2e-3], "limit": [1.5e-3, 1e-3]},
    "regressors": {"flutes": 3, "f_z": 8e-5, "a_p": 2e-3, "phi_st": 0.3, "phi_ex": 2.0},
    "twist_torque": {"angle": 2e-3, "speed": 0.1, "stiffness": 9e3, "damping": 4.0},
    "resonance": {"motor_inertia": 2e-3, "load_inertia": 5e-3, "stiffness": 9e3},
    "force_constant": {"torque_constant": 1.26, "lead": 0.016},
    "friction_force": {"v": [-0.1, 0.002, 0.3], "friction": friction},
    "input_power": {"i_d": -1.0, "i_q": 8.0, "u_d": 20.0, "u_q": 150.0},
    "leg_voltage": {"a": 0.7, "b": 0.2, "c": 0.4, "dc_link": 560.0},
    "duty": {"alpha": 100.0, "beta": -80.0, "dc_link": 560.0},
    "limited": {"alpha": 400.0, "beta": -80.0, "dc_link": 560.0, "overmodulation": False},
    "mean_deviation": {"filters": np.array([[0.012, 0.02]])},
    "variance": {"filters": np.array([[0.012, 0.02]])},
    "ramp_time": {"change": [0.1, 1.0], "acceleration": 2.0, "jerk": 20.0},
    "rest_to_rest": {"distance": [0.01, 1.0], "speed": 0.5, "acceleration": 2.0, "jerk": 20.0},
    "run_up_time": {"speed": np.array([3e3, -9e3]), "acceleration": 4e3, "base_speed": 2500.0},
    "ramp_duration": {"change": 0.4, "a": 2.0, "jerk": 20.0},
    "block_speed": {"curvature": 50.0, "change": 0.2, "length": 2e-3, "acceleration": 2.0,
                    "jump": 0.02, "drift": 0.01},
    "chord": {"distance": 3e-3, "radius": 6e-3},
}  # fmt: skip
"""Arguments of formulas; a function makes those that are parameters of a machine."""


@cache
def _units_of(cls: type) -> dict[str, str]:
    return {one.name: one.unit for one in settings(cls)}


def in_other_units(value: Any, unit: str) -> Any:
    """The same quantity with the other base units; parameters by the units of their fields."""
    if is_dataclass(value) and not isinstance(value, type):
        units = _units_of(type(value))
        changed = {one.name: in_other_units(getattr(value, one.name), units[one.name])
                   for one in fields(value)}  # fmt: skip
        return replace(value, **changed)
    if isinstance(value, tuple | list):
        units = unit.split(", ") if ", " in unit else [unit] * len(value)
        return type(value)(map(in_other_units, value, units))
    if isinstance(value, float | np.ndarray):
        return value * factor(unit or "1")
    return value


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_formula_keeps_its_units(name: str) -> None:
    function, units = public(name), parameter_units(public(name))
    given = {key: value() if callable(value) else value for key, value in EXAMPLES[name].items()}
    changed = {key: in_other_units(value, units.get(key, "")) for key, value in given.items()}
    before, after = function(**given), function(**changed)
    returned = return_units(function) or [units[next(iter(units))]]
    befores, afters = (one if isinstance(one, tuple) else (one,) for one in (before, after))
    for place, (old, new) in enumerate(zip(befores, afters, strict=True)):
        own = [returned[place]] if len(returned) == len(befores) else returned
        if len(befores) > 1 or np.ndim(old) == 0:
            own = own[:1]
        columns = np.size(old, -1) // len(own) if len(own) > 1 else 1  # of each unit
        factors = np.repeat([factor(unit) for unit in own], columns)
        np.testing.assert_allclose(new, np.asarray(old) * factors, rtol=1e-9, atol=1e-18,
                                   err_msg=f"{name} in {own}")  # fmt: skip


def test_a_wrong_unit_and_a_hidden_factor_are_found() -> None:
    assert factor("m/s") == pytest.approx(1.1 / 1.2)
    assert factor("rev/min") == pytest.approx(1 / 1.2)
    assert factor("N/m^2") == pytest.approx(0.9 / 1.1 / 1.2**2) and factor("1") == 1.0
    words = "Rates [1/s] of y[k + 1], shares [0, 1], units [DISPLAY] and arms [m], [rad]."
    assert units_in(words) == ["1/s", "m", "rad"]
    with pytest.raises(pint.UndefinedUnitError):
        parsed("N/furrow")
