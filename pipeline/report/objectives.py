"""Objectives of an optimised program in words."""

AIMS = {
    "time": ("least time", "time_percent", "less time"),
    "cost": ("least cost", "cost_percent", "less cost"),
    "energy": ("least energy", "energy_percent", "less energy"),
    "wear": ("least wear of tools", "tool_life_percent", "less wear"),
}
"""Each objective in words, its gain, and the word for less."""
