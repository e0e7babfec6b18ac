"""Integrity risk: the probability of dangerous events, from the worst fault to the whole budget."""
