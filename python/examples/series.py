"""A folder of images into a store, with a progress bar; the same command continues after Ctrl-C.

    python series.py 'images/*.tif' out
"""

import sys

import numpy as np

import quadrille

images, output = sys.argv[1:3]
ran = quadrille.run(None, output, images=images, on_event=quadrille.Progress())
print(ran.outcome, {frame["number"]: frame["status"] for frame in ran.record["frames"]})
store = ran.open_store()  # read lazily: pip install 'quadrille[store]'
uy = np.asarray(store["displacement_px"][-1])[:, 1]  # type: ignore[index, unused-ignore]
print("last frame, vertical displacement from", np.nanmin(uy), "to", np.nanmax(uy), "px")
