"""Effects of flexible bodies that a run has or leaves out: what each contributes to its sensors."""
