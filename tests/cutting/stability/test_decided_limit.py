"""The depth limit that decides, over that of time integration of the delayed equation.

Between 5 % below and 2 % above, at any immersion and in flip lobes.
"""

from dataclasses import dataclass
from math import pi, radians, tan

import numpy as np
import pytest

from pipeline.cutting.engagement.engagement import Immersions
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.margins import stability_table
from pipeline.cutting.stability.semi_discretisation import least_depth
from pipeline.cutting.stability.tip_dynamics import Mode
from pipeline.cutting.tool import Tool
from tests.cutting.chatter import RegenerativeCut, X, integrated_limit

LAW = ForceLaw.linear(K_tc=600.0, K_rc=200.0)
Y922 = Mode(direction="y", natural_frequency_Hz=922.0, damping=0.011, mass_kg=X.mass)
ABOVE, BELOW = 0.02, 0.05
HELIX = 30.0
RANDOM = 40


@dataclass(frozen=True)
class Case:
    """A side cut: immersion a_e / D, sense, speed, teeth, modes, helix [deg], feed [rad]."""

    rpm: float
    immersion: float = 0.1
    down: bool = True
    flutes: int = 2
    modes: tuple[Mode, ...] = (Y922,)
    helix: float = 0.0
    feed: float = 0.0

    @property
    def cut(self) -> RegenerativeCut:
        width = float(np.arccos(1 - 2 * self.immersion))
        entry, exit = (pi - width, pi) if self.down else (0.0, width)
        return RegenerativeCut(
            K_tc=LAW.K_tc, K_rc=LAW.K_rc, flutes=self.flutes, entry=entry, exit=exit,
            feed_direction=self.feed, lag=tan(radians(self.helix)) / 5e-3,
        )  # fmt: skip

    def decided(self, depth: float) -> float:
        """Limit that a station of this cut at ``depth`` [m] has in the table [m]."""
        cut = self.cut
        station = Immersions(
            block=np.zeros(1, np.int32), tool=np.zeros(1, np.int32), depth=np.array([depth]),
            entry=np.array([cut.entry]), exit=np.array([cut.exit]),
            feed_direction=np.array([self.feed]), direction=np.ones(1, np.int8), blocks=1,
            unjudged=np.zeros(1, np.bool_),
        )  # fmt: skip
        tool = Tool(kind="flat", diameter_mm=10.0, flutes=self.flutes, helix_deg=self.helix)
        table = stability_table(station, [self.modes], [LAW], [tool], nodes_rpm=[self.rpm])
        return float(table.margins([self.rpm])[0] + 1.0) * depth

    def ratio(self) -> float:
        """Limit that decides over that of time integration; both looked for up to four times."""
        cut = self.cut
        guess = self.decided(4 * least_depth(self.modes, cut))
        true = integrated_limit(self.modes, cut, self.rpm / 60, guess)
        return self.decided(0.6 * true) / true


SAID = [Case(rpm) for rpm in (12_000.0, 18_500.0, 20_000.0)]
"""Two flutes, 10 % radial immersion, down: zero order is 1.19, 0.79, 1.55 of the true depth."""


def drawn(many: int) -> list[Case]:
    """Immersion 2 to 100 %, up and down, one and two modes, 1 to 6 flutes, helix in a third."""
    rng = np.random.default_rng(12)
    cases = []
    for k in range(many):
        first = Mode(
            direction="y", natural_frequency_Hz=float(rng.uniform(500, 1800)),
            damping=float(rng.uniform(0.01, 0.05)), stiffness_N_m=float(rng.uniform(1e6, 4e7)),
        )  # fmt: skip
        second = Mode(
            direction="x", natural_frequency_Hz=float(rng.uniform(500, 1800)),
            damping=float(rng.uniform(0.01, 0.05)), stiffness_N_m=float(rng.uniform(1e6, 4e7)),
        )  # fmt: skip
        cases.append(
            Case(
                rpm=float(rng.uniform(3000, 24_000)),
                immersion=float(np.exp(rng.uniform(np.log(0.02), 0.0))),
                down=bool(k % 2),
                flutes=1 + k % 6,
                modes=(first, second) if k // 2 % 2 else (first,),
                helix=HELIX if k % 3 == 0 else 0.0,
                feed=float(rng.uniform(0, pi)),
            )
        )
    return cases


FEW = [7, 22]
"""Of the cases drawn that are ordinary tests."""


def assert_right(case: Case) -> float:
    ratio = case.ratio()
    assert 1 - BELOW <= ratio <= 1 + ABOVE, f"{ratio:.4f}: {case}"
    return ratio


@pytest.mark.parametrize(
    "case",
    [*(pytest.param(one, marks=pytest.mark.proof) for one in SAID[:2]), SAID[2]],
    ids=lambda case: f"{case.rpm:g}",
)
def test_ten_percent_immersion(case: Case) -> None:
    assert_right(case)


@pytest.mark.parametrize("k", [k if k in FEW else pytest.param(k, marks=pytest.mark.proof)
                               for k in range(RANDOM)])  # fmt: skip
def test_any_immersion_teeth_and_modes(k: int) -> None:
    assert_right(drawn(RANDOM)[k])
