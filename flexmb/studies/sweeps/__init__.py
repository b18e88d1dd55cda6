"""Sweeps: samples of the knobs, their runs, statistics, answers to a designer's questions."""
