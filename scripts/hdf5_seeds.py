"""Writes small fields as other programs keep them in HDF5, for the tests and the fuzzer (needs h5py):

    scripts/hdf5_seeds.py fuzz/seeds/fields
"""

import sys

import h5py
import numpy as np

COLUMNS, ROWS, SPACING, UNITS_PER_PX = 12, 8, 7, 0.05
# MATLAB keeps columns together: its files have them as the first axis.
COLUMN, ROW = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS), indexing="ij")
X, Y = COLUMN * (SPACING + 1.0), ROW * (SPACING + 1.0)
U, V = 0.25 + 1e-4 * X, -0.5 + 0.01 * Y
HOLE = (COLUMN == 0) & (ROW == 0)
PACKED = {"chunks": (COLUMNS, ROWS), "compression": "gzip"}


def put(group, name, values, kind="double", **options):
    dataset = group.create_dataset(name, data=values, **options)
    dataset.attrs["MATLAB_class"] = np.bytes_(kind)
    return dataset


def of_matlab(path, fill):
    """A file with the block of 512 bytes before HDF5 in which MATLAB says what it is."""
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def ncorr(n_images):
    """What Ncorr saves of `n_images`: a structure, or a list of structures as references."""

    def fill(file):
        analysis = file.create_group("data_dic_save")
        about, fields = analysis.create_group("dispinfo"), analysis.create_group("displacements")
        put(about, "spacing", np.array([[float(SPACING)]]))
        put(about, "pixtounits", np.array([[UNITS_PER_PX]]))
        held = file.create_group("#refs#") if n_images > 1 else None
        for name, field in (("u", U), ("v", V)):
            key = f"plot_{name}_ref_formatted"
            images = [np.where(HOLE, 0.0, (k + 1) / n_images * field * UNITS_PER_PX) for k in range(n_images)]
            if held is None:
                put(fields, key, images[0], **PACKED)
                continue
            listed = fields.create_dataset(key, (n_images, 1), dtype=h5py.ref_dtype)
            for k, image in enumerate(images):
                listed[k, 0] = put(held, f"{name}{k}", image, **PACKED).ref

    return fill


def vic(file):
    """Columns of VIC-2D, a point not measured."""
    for name, values in (("x", X), ("y", Y), ("u", U), ("v", V), ("sigma", np.where(HOLE, -1.0, 0.02))):
        put(file, name, values, **PACKED)


def exchange(path):
    """Two time steps behind the reference, mm, y up; a point not measured in the first."""
    steps = [np.stack([(X + k * U / 2) * 0.05, -(Y + k * V / 2) * 0.05, 0 * X], -1).reshape(-1, 3) for k in range(3)]
    steps[1][5] = np.nan
    with h5py.File(path, "w") as file:
        file["vector/coordinates"] = np.array(steps)
        file["vector/strains"] = 0 * np.array(steps)
        file["scalar/time"] = file["scalar/force"] = np.arange(3.0)
        file["mesh"] = np.zeros((1, 3), dtype="int64")
        file.attrs["version"] = "0.1"


if __name__ == "__main__":
    folder = sys.argv[1]
    of_matlab(f"{folder}/ncorr-one.mat", ncorr(1))
    of_matlab(f"{folder}/ncorr.mat", ncorr(2))
    of_matlab(f"{folder}/vic73.mat", vic)
    exchange(f"{folder}/exchange.h5")
