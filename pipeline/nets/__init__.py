"""Neural networks on rows of temperature sensors and on windows of signals, and their training.

Rows hold rises above a reference [K], shape (T, N), in the order of the sensors along the machine;
consequent inputs have shape (T, K).  Windows have shape (B, T, C), the newest row last, in the
units of the training data.  ``settings``, ``dcgan_settings`` and ``windows`` import no torch.

Sources: FFNN2015; Feed2025; Sun and Jang 1993 (filters over channels); Golub and Pereyra 1973.
"""

__all__ = [
    "dcgan", "dcgan_settings", "dcgan_training", "diversity", "ffnn", "latent_search", "settings",
    "stored", "training", "tuning", "wear", "window_training", "windows",
]  # fmt: skip
