"""Neural networks on rows of temperature sensors, and the training loop that they share.

Temperatures come as rises above a reference [K], shape (T, N), in the order of the sensors along
the machine; consequent inputs, shape (T, K), are whatever the output is taken to be linear in.  The
only room that imports torch.  ``settings`` imports none, so that a stage that trains no network
starts without it.

Sources: FFNN2015; Sun and Jang 1993 (filters over channels); Golub and Pereyra 1973.
"""

__all__ = [
    "ffnn", "sequence_settings", "settings", "trained", "training", "tuning",
    "window_model", "window_training", "windows",
]  # fmt: skip
