"""Frames spread over the processes of a Dask cluster, each on its own: the same bits as in one process.

    python dask_frames.py 'images/*.tif' [ADDRESS OF A SCHEDULER]

Without an address it starts a cluster of two processes on this machine. For a series that is written to disk anyway,
`quadrille slurm` or `quadrille.run(..., shard="2/4")` need no scheduler.
"""

import glob
import sys
from functools import lru_cache
from typing import Any

import numpy as np
from distributed import Client
from numpy.typing import NDArray

import quadrille


@lru_cache(maxsize=1)
def correlator(reference: str) -> quadrille.Correlator:
    """The prepared reference of this process: made once, used for all its frames."""
    return quadrille.Correlator(reference, device="cpu", threads=1)


def displacement(reference: str, image: str) -> NDArray[np.float64]:
    """Displacement of the nodes in one image, (n, 2), px."""
    return correlator(reference).correlate(image).displacement


def main(pattern: str, **cluster: Any) -> NDArray[np.float64]:
    """Displacement of the nodes in all images but the first, (frames, n, 2), px."""
    reference, *images = sorted(glob.glob(pattern))
    with Client(**cluster) as client:  # type: ignore[no-untyped-call, unused-ignore]
        tasks = client.map(displacement, [reference] * len(images), images)
        return np.stack(client.gather(tasks))


if __name__ == "__main__":
    asked: dict[str, Any] = {"address": sys.argv[2]} if len(sys.argv) > 2 else {"n_workers": 2, "threads_per_worker": 1}
    found = main(sys.argv[1], **asked)
    print(found.shape, "frames, nodes, components; mean of each frame, px:")
    print(np.nanmean(found, axis=1))
