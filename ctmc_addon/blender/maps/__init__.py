# SPDX-License-Identifier: GPL-3.0-or-later
"""Store maps on a mesh and show them: values on the vertices of a surface, such as the thickness of a wall."""

from .shown import (
    delete_map as delete_map,
    drop_missing as drop_missing,
    forget_maps as forget_maps,
    hide_map as hide_map,
    recolor_map as recolor_map,
    show_map as show_map,
    shown_map as shown_map,
    shown_name as shown_name,
)
from .stored import (
    StoredMap as StoredMap,
    change_map as change_map,
    map_values as map_values,
    read_map as read_map,
    remove_map as remove_map,
    stored_map as stored_map,
    stored_maps as stored_maps,
    write_map as write_map,
)
