"""Scene files in and out: sections, references between entries, schema."""
