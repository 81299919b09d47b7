"""Records -> parameters, each with how well the records determine it."""
