"""DVC stages, one function each, whose signature is the contract with dvc.yaml.

Positional parameters are paths in the order of the command, keyword-only ones sections of
params.yaml.  Linear algebra, NumPy and torch keep to the instructions of AVX2, so that a stage
computes the same bits on every x86-64 processor of the last ten years.
"""

import os

from pipeline.parallel import SAME_BITS

__all__ = ["__main__", "compose", "correct_programs", "nightly", "optimise", "report", "sections"]

os.environ.update(SAME_BITS)
