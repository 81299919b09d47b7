"""The direct solution: blocks, stretches of S, groups of F."""
