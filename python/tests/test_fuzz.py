"""Arguments drawn at random: an exception or a field, never an end of the interpreter."""

import random

import numpy as np

import quadrille
from conftest import spots

SEED = 20
VALUES = [
    None, True, -1, 0, 1, 7, 2**40, -(2**70), 0.5, float("inf"), float("nan"), "", "auto", "cubic", "\0", "é" * 999, b"x", [], [[]], [1, 2],
    [1, 2, 3, 4], [8, 8, 40, 40], [[1, 2], [3, 4]], [[8, 8], [40, 8], [40, 40], [8, 40]], {}, {"roi": [8, 8, 40, 40]}, {"name": 3}, {"mask": "none.png"},
    {"roi": [8, 8, 40, 40], "guard_px": -3}, {"polygon": [[8, 8]] * 4}, (), object(), print, np.nan, np.float32(16), np.zeros(3), np.zeros((48, 48), bool),
    np.zeros((48, 48), "M8[s]"), np.zeros((48, 48), [("a", "u1")]), np.ma.masked_array(np.ones((48, 48), np.uint8)),
    np.broadcast_to(np.uint8(3), (48, 48)), np.lib.stride_tricks.as_strided(np.zeros(99, np.uint8), (48, 48), (1, 1)),
]
KEYS = [
    "element_size_px", "elements", "element_share", "interpolation", "tolerance_px", "max_iterations", "brightness", "start", "noise", "noise_correlation",
    "regularisation", "cutoff_px", "poisson", "strain", "strain_window", "sigma_most_px", "drop_textureless", "isa", "threads", "mask", "cracks", "zones", "nonsense",
]


def test_no_argument_ends_the_interpreter(capsys):
    draw = random.Random(SEED)
    image = spots((48, 48))
    n_fields = n_refused = 0
    for _ in range(700):
        options = {key: draw.choice(VALUES) for key in draw.sample(KEYS, draw.randint(0, 2))}
        options.setdefault("zones", [8, 8, 40, 40])
        reference = draw.choice([image] * 99 + VALUES)
        deformed = draw.choice([image] * 99 + VALUES)
        try:
            correlator = quadrille.Correlator(reference, device="cpu", **options)
            correlator.correlate(deformed)
            quadrille.Tracker(correlator).correlate(deformed, draw.choice([None, 1, 3]))
            n_fields += 1
        except (quadrille.QuadrilleError, TypeError, ValueError, OverflowError, UserWarning):
            n_refused += 1
    assert n_fields > 50 and n_refused > 200, (n_fields, n_refused)
