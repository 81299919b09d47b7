"""Milliseconds that an iteration of fuzzy c-means takes on one core."""

import time

import numpy as np
import pytest

from pipeline.thermal.cluster_kernel import BLOCK, fuzzy_pass
from pipeline.thermal.clusters import _in_blocks

POINTS, DIMENSIONS, CLUSTERS = 100_000, 9, 3


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize(("fuzzifier", "most"), [(2.0, 2.5e-3), (1.7, 25e-3)])
def test_an_iteration(benchmark, fuzzifier: float, most: float) -> None:
    points = np.random.default_rng(0).normal(size=(POINTS, DIMENSIONS))
    blocks, last = _in_blocks(points)
    centres = points[:CLUSTERS].copy()
    work = np.empty((CLUSTERS, BLOCK)), np.empty(BLOCK), np.empty(BLOCK)
    sums = np.empty((CLUSTERS, DIMENSIONS + 1, BLOCK))
    exponent = 1 / (fuzzifier - 1)
    benchmark(fuzzy_pass, blocks, last, centres, exponent, fuzzifier, BLOCK, *work, sums)
    assert benchmark.stats["min"] < most
