"""Reports: tables, figures and sentences made of numbers that were computed elsewhere."""
