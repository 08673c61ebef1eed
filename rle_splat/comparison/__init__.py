"""The systems that the paper names, each small, each real, on the same scene description, for comparison."""
