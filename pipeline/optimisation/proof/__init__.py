"""The proof that nothing but F and S changed; it shares no code with the writer."""
