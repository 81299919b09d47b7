"""Feed drives: from records of the servo to friction, mass, loops and their intervals."""
