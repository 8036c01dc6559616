"""Reads what quadrille wrote with the libraries of others, for tests/commands/store.rs.

    python3 scripts/read_store.py zarr DIR/fields.zarr   the arrays and attributes of a store (zarr-python 3)
    python3 scripts/read_store.py npz FILE.npz           the arrays of a NumPy archive
    python3 scripts/read_store.py mat FILE.mat           the variables of a MATLAB file (SciPy)
    python3 scripts/read_store.py --available            exit status 0 when zarr 3, numpy and scipy can be imported,
                                                         3 when this Python is too old for zarr 3

Prints JSON: name -> {"type", "shape", "values"}, the values in the order of C; a float as the integer of its bits
(JSON readers round, and JSON has no NaN).
"""

import json
import sys


def exact(array):
    bits = {"f4": "<u4", "f8": "<u8"}.get(array.dtype.str[1:])
    values = array.ravel(order="C")
    return {
        "type": array.dtype.name,
        "shape": list(array.shape),
        "values": (values.view(bits) if bits else values).tolist(),
    }


def zarr_content(path):
    import zarr

    group = zarr.open_group(path, mode="r")
    content = {"attributes": dict(group.attrs)}
    for name, array in group.arrays():
        content[name] = exact(array[:]) | {
            "attributes": dict(array.attrs),
            "dimensions": list(array.metadata.dimension_names),
            "chunks": list(array.chunks),
        }
    return content


def npz_content(path):
    import numpy

    with numpy.load(path, allow_pickle=False) as arrays:
        return {name: exact(arrays[name]) for name in arrays.files}


def mat_content(path):
    import numpy
    import scipy.io

    content = {}
    for name, value in scipy.io.loadmat(path).items():
        if name.startswith("__"):
            continue
        if value.dtype == object:  # a cell array of texts
            texts = ["".join(cell.item() if cell.size else "") for cell in value.ravel()]
            value = numpy.array(texts, dtype=str).reshape(value.shape)
        content[name] = exact(value)
    return content


def main() -> int:
    if sys.argv[1:] == ["--available"]:
        if sys.version_info < (3, 11):
            print("zarr 3 needs Python 3.11", file=sys.stderr)
            return 3
        import numpy  # noqa: F401
        import scipy.io  # noqa: F401
        import zarr

        return 0 if int(zarr.__version__.split(".")[0]) >= 3 else 1
    kinds = {"zarr": zarr_content, "npz": npz_content, "mat": mat_content}
    if len(sys.argv) != 3 or sys.argv[1] not in kinds:
        print(__doc__, file=sys.stderr)
        return 2
    json.dump(kinds[sys.argv[1]](sys.argv[2]), sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
