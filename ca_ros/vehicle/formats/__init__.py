"""Files of other programs, read for a vehicle or written from one."""
