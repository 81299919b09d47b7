"""Stage: trial cuts of parts by their programs before and after, on the simulated shop floor."""

import json
from dataclasses import replace
from pathlib import Path

from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.job import shop_part
from pipeline.shop.trial.trials import trials


def trial(written: Path, cut: Path, *, shop: ShopParameters) -> None:
    """Cut the parts of ``written``, before and after, a part for each seed; one JSON for all."""
    known, found = shop_part(shop), {}
    for path in sorted(written.glob("*.json")):
        if path.stem != known.program.name:
            raise ValueError(
                f"{path.stem} is no part of the shop floor, which makes {known.program.name}: take "
                f"{shop.machine} out of fleet.trials"
            )
        before, after = (path.with_suffix(end).read_bytes() for end in (".before.nc", ".nc"))
        limit = json.loads(path.read_text())["limits"].get("load_N", known.limit_load_N)
        job = replace(known.job(shop), limit_load_N=limit)
        found[path.stem] = trials(before, after, job, shop, range(shop.trial_cuts))
    document = {"machine": shop.machine, "origin": "simulated", "parts": found}
    cut.write_text(json.dumps(document, indent=1) + "\n")
