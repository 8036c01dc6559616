"""Reads a .vtu file with meshio and prints what it holds as JSON, for tests/commands/exports.rs.

    python3 scripts/check_vtu.py FILE.vtu     the mesh and its data as JSON
                                              (a float as the integer of its bits: JSON readers round);
                                              with PyVista the number of elements that VTK draws
    python3 scripts/check_vtu.py --available  exit status 0 when meshio can be imported
"""

import json
import sys


def exact(values):
    """Nested lists of integers; floats as their bits."""
    bits = {"f4": "u4", "f8": "u8"}.get(values.dtype.str[1:])
    return (values.view(bits) if bits else values).tolist()


def main() -> int:
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    import meshio

    if sys.argv[1] == "--available":
        return 0
    mesh = meshio.read(sys.argv[1])
    [block] = mesh.cells  # one kind of element
    content = {
        "cell_type": block.type,
        "points": exact(mesh.points),
        "cells": exact(block.data),
        "point_data": {name: exact(values) for name, values in mesh.point_data.items()},
        # meshio holds cell data as one array per block of cells
        "cell_data": {name: exact(values) for name, [values] in mesh.cell_data.items()},
        "field_data": {name: exact(values) for name, values in mesh.field_data.items()},
        "type_of_cells": str(block.data.dtype),
        "type_of_measured": str(mesh.point_data["measured"].dtype),
    }
    try:
        import pyvista
    except ImportError:
        pass
    else:
        # The surface is what is drawn: hidden cells are not in it.
        content["visible_in_vtk"] = int(pyvista.read(sys.argv[1]).extract_surface().n_cells)
    json.dump(content, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
