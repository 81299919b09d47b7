"""Small cases from outside, each with its right value."""
