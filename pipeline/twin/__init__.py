"""The twin: where what the machine said meets the physics of its parts."""
