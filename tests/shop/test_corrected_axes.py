"""A corrected command on the shop floor's own axes, which are more than the twin's one mass."""

import numpy as np
import pytest

from pipeline.shop.drives.axis import follow
from pipeline.shop.parameters import ShopParameters
from pipeline.twin.correction import corrected_command
from pipeline.twin.program_axes import between
from tests.twin.shop_drives import shop_drives
from tests.twin.test_correction import CIRCLE, STROKE, T, reference, rms

MACHINE = ShopParameters(machine="mill77")
DRIVES = shop_drives(MACHINE.drives)


@pytest.mark.parametrize("letter", DRIVES)
@pytest.mark.parametrize("text", [STROKE, CIRCLE], ids=["stroke", "circle"])
def test_a_corrected_command_takes_the_following_error_of_a_machine_away(
    letter, text, record_property
):
    wanted, axis = reference(text), MACHINE.drives.axes[letter]
    ticks = round(axis.cascade.position_frequency * T)

    def error(command):
        """Of the scale and of the carriage, with torsion, cogging, bristles and quantisation."""
        found = follow(axis, between(command, ticks), np.random.default_rng(0))
        return wanted - found.measured[::ticks], wanted - found.carriage[::ticks]

    corrected = corrected_command(letter, wanted, T, DRIVES[letter]).corrected
    for name, before, after in zip(("scale", "carriage"), error(wanted), error(corrected),
                                   strict=True):  # fmt: skip
        record_property(f"{name}_um", f"{rms(before) * 1e6:.1f} -> {rms(after) * 1e6:.1f}")
        assert rms(after) < 0.015 * rms(before)
        assert np.abs(after).max() < 0.04 * np.abs(before).max()
