"""Integrity risk in five rooms: rare events, worst faults, K factors, tuning, each on those before; budgets."""
