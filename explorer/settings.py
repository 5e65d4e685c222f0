"""The settings that the page checks, as JSON: build.mjs puts them into the page."""

import json

from ca_ros.allocation.settings import AllocatedVehicleSettings
from ca_ros.control.controller_settings import ControllerSettings
from ca_ros.setting_names import RENAMED
from ca_ros.settings import LARGEST, REQUIRED, SMALLEST, table
from ca_ros.vehicle.settings import MovingBodySettings


def settings():
    """Return the settings that the page checks, and their old names, for the page's build."""
    known = {
        **table(AllocatedVehicleSettings), **table(MovingBodySettings, 'vehicle.'),
        **table(ControllerSettings, 'controller.'),
    }
    fields = {
        name: {
            'words': str in field.kinds, 'whole': int in field.kinds, 'array': field.array,
            'minimum': SMALLEST if field.positive else max(field.minimum, -LARGEST),
            'maximum': min(field.maximum, LARGEST), 'choices': list(field.choices),
            'sizes': list(field.sizes) or None, 'range': field.range(),
            'default': None if field.default is REQUIRED else field.default,
            'description': field.description,
        }
        for name, field in known.items()
    }
    return {'fields': fields, 'renamed': {old: new for old, (new, _) in RENAMED.items()}}


if __name__ == '__main__':
    print(json.dumps(settings()))
