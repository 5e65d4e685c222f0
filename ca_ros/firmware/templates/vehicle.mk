# The vehicle of this folder, for the Makefile.
NAME := {{ name }}
KERNEL := {{ 'vectored vectored_newton vectored_priorities' if tilting else 'exact least_norm priorities priorities_wide facet explanation' }}
# Not empty if the detector of rotor failures is here, too.
DETECTOR := {{ 'yes' if detector }}
# Double precision is for cores that have it in hardware.
CORE := {{ 'M4' if firmware.single else 'M7' }}
# Not empty if the worst wrenches that a search has found are here.
WORST := {{ 'yes' if worst }}
# The function whose memory is measured.
MEASURED := {{ measured }}
