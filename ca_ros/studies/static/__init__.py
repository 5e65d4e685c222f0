"""The static study: random wrenches, the errors of each method."""
