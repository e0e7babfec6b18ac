"""Experiments: files that say what to compute, checked as a whole, run into a results folder."""
