"""A vehicle: its geometry and rotors, the control allocation matrix, its parameter files."""
