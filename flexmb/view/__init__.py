"""Pictures of mechanisms and plots of time histories; VTK and matplotlib are loaded when needed."""
