/* The constants of the detector of the vehicle {{ name }}. Written by the command firmware of ca_ros. */
#include "{{ name }}_detector.h"

const ca_detector_model {{ name }}_detector = {
{{ model }}
};
