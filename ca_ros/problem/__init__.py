"""The control allocation problem: its data, the admissible set, priorities, the audit."""
