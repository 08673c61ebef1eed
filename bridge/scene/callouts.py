"""Marks of lettering that is objects."""

# Custom properties of lettering that is objects.
MARK = "rle_splat_letters"  # the name of the volume that it is for
SEGMENT = "rle_splat_segment"  # of the names of segments: the number of theirs
POINT = "rle_splat_point"  # of labels: the point that they are for, in the space of the volume's object
