"""What is wrong or suspicious about a mesh, a model or a basis, and how good a basis is."""
