# The vehicle of this folder, for the Makefile.
NAME := {{ name }}
KERNEL := {{ sources | join(' ') | replace('.c', '') }}
# Not empty if the detector of rotor failures is here, too.
DETECTOR := {{ 'yes' if detector }}
# Double precision is for cores that have it in hardware.
CORE := {{ 'M4' if firmware.single else 'M7' }}
# Not empty if the worst wrenches that a search has found are here.
WORST := {{ 'yes' if worst }}
# The function whose memory is measured.
MEASURED := {{ measured }}
