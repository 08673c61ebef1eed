"""F12: the volume over each rendered frame, the compositor, shadows on meshes, files of an animation."""
