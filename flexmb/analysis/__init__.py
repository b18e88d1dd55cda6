"""Analyses of a compiled system, one file each: assembly of the first state, dynamics."""
