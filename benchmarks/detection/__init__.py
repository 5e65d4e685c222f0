"""The detector of failures on a plant that was written without knowledge of it."""
