"""The paper's tables and figures, and the same of one's own vehicle and methods."""
