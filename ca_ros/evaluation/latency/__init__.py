"""The latency of the allocator node from command to rotor speeds, beside that of an echo node."""
