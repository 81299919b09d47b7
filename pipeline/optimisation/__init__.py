"""Part programs: faster or cheaper inside the limits, with proof of what was changed."""
