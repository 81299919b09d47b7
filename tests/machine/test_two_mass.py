"""Two masses on a shaft: stiffness in series and eigenfrequencies from the matrices."""

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from pipeline.machine.two_mass import (
    TransmissionParameters,
    antiresonance,
    resonance,
    twist_torque,
)

SCREW = TransmissionParameters(
    lead=0.01, mass=300, screw_inertia=2e-3, coupling_stiffness=2e4, screw_stiffness=1e4,
    axial_stiffness=3e8,
)  # fmt: skip
inertias = st.floats(1e-5, 1e-1)
stiffnesses = st.floats(1, 1e6)


def test_parts_in_series_by_their_deflections() -> None:
    """The twist under 1 N m is the sum of the parts' own; the nut gives way along the axis."""
    force = 1 / SCREW.ratio
    along = force / SCREW.axial_stiffness
    twist = 1 / 2e4 + 1 / 1e4 + along / SCREW.ratio
    assert 1 / SCREW.stiffness == pytest.approx(twist, rel=1e-14)


def test_rigid_parts_drop_out() -> None:
    assert replace(SCREW, coupling_stiffness=inf, axial_stiffness=inf).stiffness == 1e4
    whole = replace(SCREW, coupling_stiffness=inf, axial_stiffness=inf, screw_stiffness=inf)
    assert whole.stiffness == inf


def test_load_inertia_has_the_kinetic_energy_of_screw_and_table() -> None:
    speed = 37.0
    v = speed * 0.01 / (2 * pi)
    energy = (2e-3 * speed**2 + 300 * v**2) / 2
    assert SCREW.load_inertia * speed**2 / 2 == pytest.approx(energy, rel=1e-14)


@given(inertias, inertias, stiffnesses)
def test_eigenfrequencies_are_those_of_the_matrices(
    motor: float, load: float, stiffness: float
) -> None:
    """Matrix from the shaft's own torque on unit angles: free, and with the motor held."""
    column = [twist_torque(a - b, 0.0, stiffness, 0.0) for a, b in ((1, 0), (0, 1))]
    matrix = np.array([column, [-c for c in column]])
    squares = eigh(matrix, np.diag([motor, load]), eigvals_only=True)
    top = resonance(motor, load, stiffness) ** 2
    assert squares == pytest.approx([0, top], abs=1e-9 * top)
    held = matrix[1, 1] / load
    assert antiresonance(load, stiffness) ** 2 == pytest.approx(held, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("lead", 0.0),
        ("mass", float("nan")),
        ("screw_inertia", -1.0),
        ("load_damping", float("inf")),
        ("internal_damping", -0.1),
        ("coupling_stiffness", 0.0),
        ("axial_stiffness", float("nan")),
    ],
)
def test_values_out_of_range_are_named(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"transmission\.{name} = {value}"):
        replace(SCREW, **{name: value})
