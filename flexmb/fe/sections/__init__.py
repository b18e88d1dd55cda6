"""Sections: what a mesh does not say of its elements, by group."""
