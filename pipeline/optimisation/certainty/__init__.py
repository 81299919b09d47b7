"""How sure a part is of its load limit: what is drawn, and what comes of it."""
