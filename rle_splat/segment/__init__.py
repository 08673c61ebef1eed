"""Segments made from values and from other segments: masks, the body without the table, and label maps of them."""
