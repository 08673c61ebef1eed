"""Memory of ray intervals; nothing here loads a compiler."""

INTERVALS = 40  # bytes of where a sheet pixel's ray begins and ends, and of what finding that takes
