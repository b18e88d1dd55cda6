"""Functions of time and of channels."""
