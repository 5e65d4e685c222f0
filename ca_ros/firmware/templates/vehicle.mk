# The vehicle of this folder, for the Makefile.
NAME := $name
DEFINITIONS := $definitions
# Double precision is for cores that have it in hardware.
CORE := $core
