"""Contribution of effects of flexible bodies, included or omitted in a run, to its sensors."""
