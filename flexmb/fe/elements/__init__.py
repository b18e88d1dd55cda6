"""The element families: matrices of all elements of one kind at once."""
