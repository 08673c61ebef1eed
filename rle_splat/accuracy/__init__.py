"""Truths that share no code with the road they judge: float64 ray integrals, closed forms, metrics and probes."""
