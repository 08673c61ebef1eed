"""Memory that meshes take; nothing here loads a compiler."""

SAMPLES = 16  # rays per pixel on which meshes are searched for
# Bytes of a pixel's depths on these rays, of its layers, and of what finding those takes; of what is left afterwards.
MESH_PIXEL, MESH_LAYERS = 4 * SAMPLES + 12 + 9, 12
