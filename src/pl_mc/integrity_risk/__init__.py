"""Integrity risk in rooms, each on those before: modes, rare, worst, given_residuals, k_factor, tuning; budget."""
