"""DVC stages, one function each, whose signature is the contract with dvc.yaml.

Positional parameters are paths in the order of the command, keyword-only ones sections of
params.yaml.  Linear algebra, NumPy and torch keep to the instructions of AVX2, so that a stage
computes the same bits on every x86-64 processor of the last ten years.
"""

import os

__all__ = ["compose", "correct_programs", "nightly", "optimise", "report", "sections"]

SAME_BITS = {
    "OMP_NUM_THREADS": "1",  # the same sums in the same order; narrow matrices gain three times
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "ATEN_CPU_CAPABILITY": "avx2",
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    "MKL_CBWR": "COMPATIBLE",
}
"""Variables that the libraries read when they are loaded; workers inherit them."""

os.environ.update(SAME_BITS)
