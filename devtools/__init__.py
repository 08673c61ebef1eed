"""What dev.py does: environments, tests, the extension zips, the sample, the demo.  Standard library only,
but for the few scripts that are run inside an environment made here (named so in their first line)."""
