"""What the engine costs; run by hand: `python -m tests.benchmarks`."""
