"""Where a body takes loads and joints: groups of nodes tied to reference points."""
