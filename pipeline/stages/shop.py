"""Stage: let the simulated shop floor write a machine's records."""

from pathlib import Path

from pipeline.shop.parameters import ShopParameters
from pipeline.shop.simulate import simulate


def shop(raw: Path, truth: Path, *, shop: ShopParameters) -> None:
    """Write the records into ``raw`` and what is true of them into ``truth``."""
    simulate(raw, truth, shop, compute="processes")
