"""The command line: one module a command, the option groups they share, and the writers of what comes out."""
