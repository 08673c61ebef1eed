"""Blender's scene as plain data: camera, lights, world, meshes, clip objects, motion, mist, viewports."""
