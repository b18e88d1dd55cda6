"""What sensors read, and forces over it."""
