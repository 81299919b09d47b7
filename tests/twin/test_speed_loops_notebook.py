"""The notebook on speed loops runs, and what it shows is what its room computes."""

from pathlib import Path

import pytest

from tests.test_notebooks import executed, images

NAME = "02_does_a_fuzzy_speed_loop_help.ipynb"
SAID = (
    "[table['cost [mrad s]'].groupby(level=['gains', 'speed loop']).sum().to_list(),"
    " change.loc['error at 1500 mm/min, feed-forward 0 [mm]'].to_list(), 1e3 * fastest]"
)


@pytest.mark.slow
def test_the_notebook_finds_no_difference_once_both_are_tuned(tmp_path: Path) -> None:
    outputs, (costs, lag, fastest) = executed(tmp_path, NAME, SAID)
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]
    assert images(outputs) == 1
    pi, fuzzy, tuned_pi, tuned_fuzzy = costs
    assert tuned_pi < 0.5 * pi and tuned_fuzzy < 0.5 * fuzzy
    assert tuned_fuzzy == pytest.approx(tuned_pi, rel=0.05)
    assert lag == pytest.approx([0, 0], abs=0.2)
    # J w / T_max by hand: 0.003 kg m^2, 104.72 rad/s, 19.1 N m
    assert fastest == pytest.approx(16.45, abs=0.05)
