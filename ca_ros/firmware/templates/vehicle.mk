# The vehicle of this folder, for the Makefile.
NAME := $name
DEFINITIONS := $definitions
KERNEL := $kernel
# Not empty if the detector of rotor failures is here, too.
DETECTOR := $detector
# Double precision is for cores that have it in hardware.
CORE := $core
# The function whose memory is measured.
MEASURED := $measured
