"""The control's rates, accelerations and waiting times from logs of its line numbers."""
