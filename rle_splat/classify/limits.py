"""Largest optical properties and light, chosen so that no product in the pipeline leaves the range of float32.

A voxel record holds extinction * color, at most 2e36 (float32 ends at 3.4e38). Light * coefficient * color is at most
1e33. No visible scene comes near these limits.
"""

BRIGHTEST = 1e9  # largest channel of a color, shaded or not (white is 1); larger values are refused
LEAST_DISTANCE = 1e-26  # smallest world length to which opacity refers; smaller ones are clamped
STRONGEST_LIGHT = 1e18  # largest light on a voxel (1 makes white white); light near a lamp is clamped to it
MOST_REFLECTED = 1e6  # largest coefficient of shading; larger values are refused
