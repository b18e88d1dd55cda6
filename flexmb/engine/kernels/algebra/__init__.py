"""Rotations, small vectors, blocks and the factorisation."""
