"""From a tolerance to a plan (algorithm.md 2.4): features of a volume and a view, a model of error and time, the
quickest plan that keeps the tolerance, and a better one where the measured error exceeds it."""
