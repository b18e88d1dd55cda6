"""Studies over any knob of a scene: what accuracy costs, what its error consists of, sweeps."""
