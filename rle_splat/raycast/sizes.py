"""Memory that single rays take; nothing here loads a compiler."""

AT_ONCE = 4096  # rays between two looks at the user's Esc
RAY = 320  # bytes of a ray that is followed
# Bytes of each pixel: how steep and which they are, where if all of them are, and the picture once more without its
# border.
STEEP_PIXEL = 4 + 1 + 8 + 20
