"""Bodies of a scene: rigid, from a mesh, from a file; markers, interfaces, sections."""
