"""Wear of tools from signals of the cut: flank wear VB [um] of ISO 8688-2, or worn and not worn.

A residual network on windows, a forest and a ridge regression on features of them, and a blend of
these with a baseline that needs no sensor; who serves is decided on training tools left out.  Lives
of tools are cases, and no tool is learnt from and judged on.  Sources: DCGAN2019; ISO 8688-2.
"""

__all__ = ["due", "machine_wear", "model", "submodel"]
