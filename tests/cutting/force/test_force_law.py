"""Force law: textbook numbers and limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.force.force_law import ForceLaw
from tests.cutting.closed_forms import edge_forces


def test_units_of_tables() -> None:
    """2000 N/mm^2 and 30 N/mm on a chip of 0.1 mm: 200 + 30 N for each millimetre."""
    law = ForceLaw.linear(K_tc=2000.0, K_rc=1000.0, K_ac=500.0, K_te=30.0, K_re=20.0, K_ae=10.0)
    assert np.allclose(edge_forces(law, 1e-4) * 1e-3, [230.0, 120.0, 60.0])


@given(st.floats(0.0, 0.6), st.floats(100.0, 4000.0), st.floats(1e-6, 1e-3))
def test_specific_force_falls_with_the_exponent(m_c: float, k_c11: float, h: float) -> None:
    """Twice the chip takes 2^(1 - m_c) the force, and 1 mm takes k_c1.1."""
    law = ForceLaw.kienzle(k_c11=k_c11, m_c=m_c, radial=0.3)
    one, two = edge_forces(law, [h, 2 * h])[0]
    assert two / one == pytest.approx(2 ** (1 - m_c), rel=1e-12)
    assert edge_forces(law, 1e-3)[0] == pytest.approx(k_c11 * 1e3, rel=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"K_tc": float("nan"), "K_rc": 0.0},
            r"force_law\.K_tc = nan must be finite",
        ),
        (
            {"K_tc": 1e9, "K_rc": 0.0, "m_c": 1.0},
            r"force_law\.m_c = 1\.0 must lie from 0",
        ),
        ({"K_tc": -1.0, "K_rc": 0.0}, r"force_law\.K_tc = -1\.0 must be finite and at least 0"),
        ({"K_tc": -1e9, "K_rc": 0.0, "K_te": 1.0}, r"force_law\.K_tc = -1000000000\.0 must be"),
        (
            {"K_tc": 1e9, "K_rc": 0.0, "K_te": -1.0},
            r"force_law\.K_te = -1\.0 must be finite and",
        ),
        ({"K_tc": 0.0, "K_rc": 1e9}, "K_tc and force_law.K_te are both 0"),
    ],
)
def test_impossible_laws_are_named(values: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ForceLaw(**values)
