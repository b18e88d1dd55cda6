"""Bodies as a scene tells them: rigid, from a mesh, from a file; markers, interfaces, sections."""
