"""Keep pytest out of Blender's entry point: the root __init__.py imports bpy and needs the package's own name."""

collect_ignore = ["__init__.py", "operators", "panels", "bridge"]
