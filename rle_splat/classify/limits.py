"""The largest numbers a look may hold: within them no product on the road leaves the range of float32.

A voxel's record is extinction * colour, 2e36 at most where float32 ends at 3.4e38; what falls on a voxel is light *
coefficient * colour, 1e33 at most.  Nothing that can be seen comes near any of them.
"""

from __future__ import annotations

BRIGHTEST = 1e9  # any channel of a colour, shaded or not, 1 being white; more is refused
LEAST_DISTANCE = 1e-26  # world lengths that opacity refers to; what refers to less is taken as this dense, and opaque
STRONGEST_LIGHT = 1e18  # light on a voxel, 1 making white white; nearer to a light it does not grow any more
MOST_REFLECTED = 1e6  # a coefficient of shading; more is refused
