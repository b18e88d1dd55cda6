"""From a finite-element model to a few modal coordinates."""
