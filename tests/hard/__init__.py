"""Scenes that are hard for numbers, each with what must hold, for every method that can do them."""
