"""Meshes: read from files or made of simple shapes, with their groups."""
