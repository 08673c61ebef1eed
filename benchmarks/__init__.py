"""Benchmarks.  Speed is compared as ratios within one run."""
