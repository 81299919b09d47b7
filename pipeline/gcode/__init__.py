"""What the machine was told: part programs (ISO 6983) to moves and back."""
