"""The studies: tables and plots."""
