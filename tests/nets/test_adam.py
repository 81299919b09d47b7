"""Adam on one vector of weights: torch's own as the oracle, and no compiler is imported."""

import subprocess
import sys

import pytest
import torch
from torch import nn

from pipeline.nets.descent import Adam


def network() -> nn.Module:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.Linear(8, 1)).double()


@pytest.mark.parametrize(("l2", "decay"), [(0.0, 0.0), (0.02, 0.0), (0.0, 0.05)])
def test_its_steps_are_those_of_torch(l2: float, decay: float) -> None:
    mine, theirs = network(), network()
    x, y = torch.randn(20, 3, dtype=torch.float64), torch.randn(20, 1, dtype=torch.float64)
    weights = list(mine.parameters())
    adam = Adam(weights, 0.03, betas=(0.8, 0.99), l2=[l2] * len(weights), decay=decay)
    kind = torch.optim.AdamW if decay else torch.optim.Adam
    oracle = kind(theirs.parameters(), lr=0.03, betas=(0.8, 0.99), weight_decay=decay or 2.0 * l2)
    for k in range(30):
        adam.rate = oracle.param_groups[0]["lr"] = 0.03 / (1 + k)
        adam.step((mine(x) - y).square().mean())
        oracle.zero_grad()
        (theirs(x) - y).square().mean().backward()
        oracle.step()
    for one, other in zip(mine.parameters(), theirs.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-12)  # of sums in another order


def test_a_weight_that_the_loss_does_not_see_stays() -> None:
    seen, unseen = nn.Parameter(torch.ones(2)), nn.Parameter(torch.ones(3))
    Adam([seen, unseen], 0.1).step(seen.sum())
    assert (seen < 1).all() and (unseen == 1).all()


def test_a_training_imports_no_compiler() -> None:
    """It takes a second, in each process of a stage."""
    said = (
        "import sys, torch\n"
        "from pipeline.nets.descent import Adam\n"
        "from pipeline.nets.training import reproducible\n"
        "weight = torch.nn.Parameter(torch.ones(2))\n"
        "with reproducible():\n"
        "    Adam([weight], 0.1).step(weight.sum())\n"
        "print('torch._dynamo' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
