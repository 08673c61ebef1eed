"""Blender's scene as plain data: camera, lights, world, meshes, cutting objects, motion, mist, viewports."""
