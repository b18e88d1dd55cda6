"""How single values of a scene are read and written: numbers with units, axes, tables."""
