"""PX4: parameters, frames, the rules of its interfaces, and the node that speaks with it."""
