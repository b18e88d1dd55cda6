"""The same mechanisms in flexmb and in Exudyn; run by hand: `python -m tests.peers`."""
