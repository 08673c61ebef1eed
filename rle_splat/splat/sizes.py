"""Memory of intermediate images; nothing here loads a compiler."""

SHEET_PIXEL = 20  # bytes of a pixel of an intermediate image: color, transmittance and half depth
