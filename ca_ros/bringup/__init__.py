"""The bringup script: nodes as processes, a flight, and what came of it."""
