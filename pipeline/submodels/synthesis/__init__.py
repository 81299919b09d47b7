"""Signals of wear as a sub-model: a conditional DCGAN makes windows at a given wear and conditions.

Windows have shape (N, C, L), in the units of the recordings; wear is flank wear VB [um], or 1 worn
and 0 not.  Cases are lives of tools, whole: what is judged on tools that were held out is whether a
judge, which takes no part in the training, reads from generated windows the wear that was asked
for, whether a learner that saw generated windows only reads recorded ones, spectra, spread, and
whether training windows were copied.  Source: DCGAN2019.
"""

__all__ = ["model", "samples", "submodel"]
