"""MTConnect logs as agents and adapters write them (SHDR)."""
