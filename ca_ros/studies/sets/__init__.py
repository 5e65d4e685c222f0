"""Admissible sets: sections, plots, the table of the audit."""
