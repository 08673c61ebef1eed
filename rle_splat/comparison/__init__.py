"""The other methods that the paper names, each a small working implementation, for comparison on the same scenes."""
