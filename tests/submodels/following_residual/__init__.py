"""Following errors that the drives' model leaves over."""
