"""Our pictures as images of the .blend: files beside it, backdrops, figures, and which pictures are out of date."""
