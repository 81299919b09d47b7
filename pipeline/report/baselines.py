"""Baselines that the judge compares a model with, in words for the pages."""

BASELINES = {
    "persistence": "persistence (an earlier value, kept)",
    "plain": "a plain guess",
    "mechanics": "the mechanics alone",
    "physics": "the physics alone",
    "day_mean": "the mean of the day",
    "constant_level": "one constant level",
    "speed_over_loop_gain": "speed divided by the gain of the position loop",
    "rigid_shaft": "a rigid shaft",
    "linear": "linear regression",
    "linear_static": "linear regression, temperatures only",
    "linear_sensors": "linear regression, every sensor with lags",
    "two_nodes": "a thermal network of two nodes",
    "expansion": "lagged thermal expansion",
    "hybrid": "lagged expansion and linear regression of the rest",
    "bp_7_paper": "a sigmoid network of 7 nodes, inputs of the literature",
    "bp_7": "a sigmoid network of 7 nodes",
    "bp_16": "a sigmoid network of 16 nodes",
    "ffnn_classic": "a classic fuzzy network",
    "ffnn_paper": "a fuzzy network, genetic, inputs of the literature",
    "ffnn_genetic": "a fuzzy network, genetic",
    "ffnn_adam": "a fuzzy network by gradient",
    "ffnn_projection": "a fuzzy network by least squares and gradient",
}


def baseline_words(name: str) -> str:
    """A baseline in words; its own name, without underscores, where it is not listed here."""
    return BASELINES.get(name, name.replace("_", " "))
