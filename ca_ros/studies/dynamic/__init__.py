"""The dynamic study: flights with each method, and their metrics."""
