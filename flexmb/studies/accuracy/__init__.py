"""Accuracy against cost: errors against a reference and processor time over combinations of
knobs."""
