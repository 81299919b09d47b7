"""Residual following error beyond the drives' model, predicted by networks on windows.

Two uses that are kept apart: prediction before the motion, from commands and states of the drives'
model, for the twin and for corrected commands; estimation, with measurements that are older than a
horizon.  Following errors are commanded less measured position, in metres inside and um in scores.

Sources: Feed2025 (residual of a mechanism model by CNN-LSTM-attention, where the network saw the
measured position: a leak, which the windows refuse here).
"""

__all__ = ["model", "submodel"]
