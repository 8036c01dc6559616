"""Two images: displacement with its uncertainty, strain, a map.

    python pair.py ref.tif deformed.tif
"""

import sys

import numpy as np

import quadrille

reference, deformed = sys.argv[1:3]
correlator = quadrille.Correlator(reference, element_size_px=16)  # the specimen is found in the image
field = correlator.correlate(deformed)
print(field)
print("mean displacement, px:", np.nanmean(field.displacement, axis=0))
print("median standard uncertainty, px:", np.nanmedian(field.sigma, axis=0))
print("mean strain exx, eyy, exy:", np.nanmean(field.element_strain, axis=0))
field.plot("ux", image=reference).get_figure().savefig("ux.png")  # type: ignore[union-attr, unused-ignore]
