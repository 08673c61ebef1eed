"""Truths that share no code with the pipeline they measure: float64 ray integrals, metrics and probes."""
