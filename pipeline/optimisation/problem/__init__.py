"""A part as arrays: what limits each row, and what F and S make of it."""
