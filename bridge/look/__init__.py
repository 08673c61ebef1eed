"""How a volume looks: transfer functions, presets, thumbnails, histogram, window and level, values under the mouse."""
