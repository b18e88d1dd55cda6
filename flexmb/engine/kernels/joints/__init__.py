"""Constraint rows, scalar coordinates, markers on curves, reactions."""
