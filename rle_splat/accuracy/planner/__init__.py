"""From a wish in levels to a plan: features of a volume and a view, a model of error and time, the cheapest plan that
keeps the wish, and what to do when a measurement says that it does not (algorithm.md 2.4)."""
