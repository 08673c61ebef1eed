"""The command line: one module for each command, the option groups they share, and the writers of their output."""
