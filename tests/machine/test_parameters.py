"""What a control may be set to, and how it reads from params.yaml."""

import dataclasses

import pytest

from pipeline.machine.control.parameters import AuxiliaryParameters, ControlParameters
from pipeline.parameters import ParametersError, structure
from tests.machine.programs import AXIS, axis, control

SECTION = {
    "axes": {"X": AXIS, "Z": AXIS | {"jerk": 5e4}},
    "cutting_filter": [0.012, 0.004],
    "corner": "tolerance",
    "auxiliary": {"tool_change": 4.5, "m_codes": {8: 0.5}, "flying_m_codes": [9]},
}


def test_reads_from_a_section():
    found = structure({"control": SECTION}, "control", ControlParameters)
    assert found == ControlParameters(
        axes={"X": axis(), "Z": axis(jerk=5e4)},
        cutting_filter=(0.012, 0.004),
        corner="tolerance",
        auxiliary=AuxiliaryParameters(tool_change=4.5, m_codes={8: 0.5}, flying_m_codes=(9,)),
    )


def test_unknown_key_is_named_with_its_path():
    section = SECTION | {"axes": {"X": AXIS | {"sped": 1}}}
    with pytest.raises(ParametersError, match=r"\(sped\) @ control\.axes\['X'\]"):
        structure({"control": section}, "control", ControlParameters)


def test_limits_in_si():
    limits = control(letters="XA").limits
    assert limits[:, 0].tolist() == pytest.approx([0.5, 0.25, 5, 2, 1, 1 / 150, float("inf")])
    degree = 3.141592653589793 / 180
    assert limits[:2, 3].tolist() == pytest.approx([500 * degree, 250 * degree])
    assert (limits[:, 1] == float("inf")).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"profile": "s_curve"}, r"profile = 's_curve' needs axes\.X\.jerk: give it"),
        ({"rapid_filter": (0.01, -1)}, "rapid_filter = -1 s must be finite"),
        ({"settle_time": float("nan")}, "settle_time = nan s must be finite and at least 0"),
        ({"interpolation_period": 0}, "interpolation_period = 0 must be finite and positive"),
        ({"tolerance": 0}, "tolerance = 0 must be finite and positive"),
        ({"limits": {"corner_jump": -1}}, "corner_jump = -1 must be finite and at least 0"),
        ({"limits": {"jerk": 0}}, "jerk = 0 must be finite and positive"),
        (
            {"corner": "blend", "cutting_filter": (0.01, 0.0)},
            r"corner = 'blend' .* cutting_filter is \(0.01, 0.0\): leave it out",
        ),
        ({"letters": ""}, r"axes = \[\]: name some of"),
    ],
)
def test_what_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        control(**change)


def test_unknown_axis_is_refused():
    with pytest.raises(ValueError, match=r"axes = \['U'\]: name some of"):
        ControlParameters(axes={"U": axis()})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spindle_acceleration": 0}, r"auxiliary\.spindle_acceleration = 0 must be positive"),
        ({"tools": {3: -1.0}}, r"auxiliary\.tools\[3\] = -1\.0 s must be finite and at least 0"),
        ({"m_codes": {8: float("inf")}}, r"auxiliary\.m_codes\[8\] = inf s must be finite"),
        ({"tool_change": -2}, r"auxiliary\.tool_change = -2 s must be"),
    ],
)
def test_auxiliary_times_that_cannot_be_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        AuxiliaryParameters(**change)


def test_filtered_acceleration_must_fit_the_drive():
    # 2000 + 1000 + 400 / 60 / 0.01 = 3667 mm/s^2 while cutting, 5000 in rapids
    limits = {"acceleration_limit": 5000}
    fits = control(cutting_filter=(0.01, 0.002), limits=limits)
    assert fits.filtered_acceleration("X") == pytest.approx(5000)
    slow = {"rapid_acceleration": 3000, "acceleration_limit": 3600}
    with pytest.raises(ValueError, match=r"axes\.X: .*comes to 3666\.67 mm/s\^2 and passes"):
        control(cutting_filter=(0.01, 0.002), limits=slow)
    longer = control(cutting_filter=(0.012, 0.002), limits=slow)
    with pytest.raises(ValueError, match="comes to 4555"):
        dataclasses.replace(longer, rapid_filter=(0.012, 0.0), rapid_stop="never")
