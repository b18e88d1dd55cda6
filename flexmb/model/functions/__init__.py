"""Functions of time and of channels: expressions, named forms, tables, their derivatives."""
