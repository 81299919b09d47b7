"""Cutter radius compensation against LinuxCNC's own interpreter."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.gcode.compensation import CompensationError, compensate
from tests.gcode.compensated_contours import RS274, SCALE, random_contour, rows_of, rs274

pytestmark = pytest.mark.skipif(not Path(RS274).exists(), reason=f"{RS274} is not installed")

PRINTED = 1.1e-4
"""rs274 prints four decimals [mm]; in contours of metres that is 1e-7 mm of a contour in mm."""
STRICTER = (
    "would run backwards",  # rs274 does not look at a line whose next element is an arc
    "no arc can follow",  # rs274 then arrives backwards, around a circle on the other side
)


@pytest.mark.parametrize("plane", [17, 18])
@pytest.mark.parametrize("block", range(4))
def test_path_is_rs274s(plane, block, tmp_path):
    same = 0
    for seed in range(50):
        rng = np.random.default_rng([plane, block, seed])
        contour = random_contour(rng, plane)
        side, radius = int(rng.choice([1, -1])), round(rng.uniform(0.05, 3) * SCALE, 9)
        rows, error = rs274(contour, side, radius, tmp_path)
        try:
            path = compensate(contour.elements, side=side, radius=radius, dialect="linuxcnc")
        except CompensationError as refused:
            assert error or any(why in str(refused) for why in STRICTER), (seed, str(refused))
            continue
        if error is None:
            np.testing.assert_allclose(rows_of(path), rows, atol=PRINTED, rtol=0, err_msg=seed)
            same += 1
    assert same > 30
