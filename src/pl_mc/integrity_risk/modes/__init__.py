"""Fault modes with their priors, which budgets and proofs of levels share."""
