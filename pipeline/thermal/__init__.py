"""How the machine heats: the network of its spindle."""
