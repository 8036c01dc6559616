"""The first pair in a fresh environment: scripts/wheel.sh. No file is read."""

import time

begin = time.perf_counter()
import quadrille

imported = time.perf_counter() - begin

import numpy as np

rng = np.random.default_rng(1)
speckle = np.kron(rng.integers(40, 215, (256, 256)), np.ones((4, 4)))
speckle = (speckle + np.roll(speckle, 1, 0) + np.roll(speckle, 1, 1) + np.roll(speckle, 2, 1)) / 4
image = speckle.astype(np.uint8)
begin = time.perf_counter()
correlator = quadrille.Correlator(image, [16, 16, 1008, 1008], device="cpu")
field = correlator.correlate(np.roll(image, (2, 3), axis=(0, 1)))
seconds = time.perf_counter() - begin
assert field.status == "converged" and np.abs(field.displacement - [3, 2]).max() < 0.01, field
print(f"quadrille {quadrille.__version__}: import {imported:.3f} s, pair of 1024 x 1024 px {seconds:.3f} s, {len(field.positions)} nodes")
