"""Wrong values in the log: zeros, spikes, counters that fall back."""

import numpy as np

from pipeline.shop.dirt import spread, zero_places
from pipeline.shop.items import items
from pipeline.shop.ledger import Glitch, Ledger
from pipeline.shop.lines import number_texts
from pipeline.shop.parameters import ShopParameters

SIXTEEN_BITS = 65535.0  # what -1 looks like in an unsigned word
FULL_DISPLAY = 99999.999


def inject(
    numbers: dict[str, np.ndarray], times: np.ndarray, stamps: list[str], p: ShopParameters,
    random: np.random.Generator, ledger: Ledger, native: bool,
) -> None:  # fmt: skip
    """Put wrong values into ``numbers`` (each (P,), as written) and enter them in the ledger."""
    polls, log = times.size, p.log
    zeros = zero_places(log.zero_temperatures, polls, random)
    wrong = [("zero_temperature", "S1temp", k, 0.0) for k in zeros]
    for k in _places(log.feedrate_spikes, polls, random):
        value = random.choice([-1.0, 1.0]) * random.uniform(3e4, 3e5)
        wrong.append(("feedrate_spike", "vpath", k, float(np.round(value, 1))))
    for k in _places(log.speed_spikes, polls, random):
        wrong.append(("speed_spike", "S1n", k, SIXTEEN_BITS))
    for k in _places(log.position_spikes, polls, random):
        wrong.append(("position_spike", f"{random.choice(list('XYZ'))}pos", k, FULL_DISPLAY))
    for k in _places(log.counter_resets, polls, random):
        wrong.append(("counter_reset", str(random.choice(["t_total", "t_auto", "t_cut"])), k, 0.0))
    known = {i.name: i for i in items(p.c_axis)}
    for kind, name, k, value in wrong:
        numbers[name][k] = value
        text = number_texts(np.array([value]), known[name], native)[0]
        ledger.glitches.append(Glitch(kind=kind, item=name, time=stamps[k], value=text))


def _places(mean: float, polls: int, random: np.random.Generator) -> np.ndarray:
    return spread(random.poisson(mean), 3, polls - 3, random)
