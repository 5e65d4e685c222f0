"""The bringup script: nodes as processes, a flight, and its record."""
