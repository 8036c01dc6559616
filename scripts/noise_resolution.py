#!/usr/bin/env python3
"""What other elements, or other ways of reading the field of bilinear ones, would bring: noise times resolution, computed.

    scripts/noise_resolution.py          needs NumPy (.venv/bin/python after `make test`)

Along one axis, elements of length 1, white noise and texture everywhere: a field is projected onto the functions of the elements, as image
correlation does (docs/correlation.md), and read at a place. Resolution is the period from which a wave with its crest there comes out at 90 %; the
noise of a value is that of the sum it is. In the plane the noise of both axes multiplies; a line of points meets all places between nodes
across it, so that the root mean square stands for that axis. Printed for places from a node (0) to the middle between two (0.5):
period, noise, and their product with the other axis, whose ideal (a filter that lets all longer waves pass and no shorter one) is 2.
"""

import numpy as np

ELEMENTS, SAMPLES = 41, 60
MIDDLE = ELEMENTS // 2
X = (np.arange(ELEMENTS * SAMPLES) + 0.5) / SAMPLES
PLACES = np.linspace(0.0, 0.5, 9)
PERIODS = np.linspace(1.2, 12.0, 2000)


def hat(t):
    return np.maximum(0.0, 1.0 - np.abs(t))


def cubic(t):
    t = np.abs(t)
    return np.where(t < 1, 2 / 3 - t * t + t**3 / 2, np.where(t < 2, np.maximum(2 - t, 0) ** 3 / 6, 0.0))


def b_spline(degree):
    """The B-spline of any degree, by its recursion."""

    def at(t, degree=degree):
        t = np.asarray(t, dtype=float)
        if degree == 0:
            return np.where((t >= -0.5) & (t < 0.5), 1.0, 0.0)
        reach = (degree + 1) / 2
        return ((reach + t) * at(t + 0.5, degree - 1) + (reach - t) * at(t - 0.5, degree - 1)) / degree

    return at


def kept(t):
    """The spline as it is kept: by its values at nodes half as far apart as the knots, bilinear between."""
    nodes = np.linspace(-2.0, 2.0, 9)
    return np.interp(t, nodes, cubic(nodes), left=0.0, right=0.0)


def values_of_kept(elements):
    """Values at points of such splines: the filter at their nodes, cubic interpolation between."""

    def at_node(at):
        return (elements.shape(at - 0.5) + 10 * elements.shape(at) + elements.shape(at + 0.5)) / 12

    def reading(at):
        node = np.floor(2 * at + 1e-9)
        s = 2 * at - node
        weights = (-s * (1 - s) * (2 - s) / 6, (1 - s * s) * (2 - s) / 2, s * (1 + s) * (2 - s) / 2, -s * (1 - s * s) / 6)
        return sum(w * at_node((node - 1 + k) / 2) for k, w in enumerate(weights))

    return reading


class Elements:
    """Functions with these middles; coefficients of a projection, and their covariance."""

    def __init__(self, function, middles):
        self.function, self.middles = function, middles
        basis = np.stack([function(X - at) for at in middles], axis=1)
        self.covariance = np.linalg.inv(basis.T @ basis / SAMPLES)
        self.projection = self.covariance @ basis.T / SAMPLES

    def shape(self, at):
        """The field itself, at a place."""
        return np.array([self.function(np.array(at - middle)) for middle in self.middles], dtype=float)

    def right_to(self, degree, taps):
        """The sum over the nearest coefficients with the least noise that is right for polynomials."""

        def reading(at):
            first = int(np.ceil(at - taps / 2 + 1e-9))
            near = np.arange(first, first + taps)
            powers = np.array([(self.projection @ (X - at) ** k)[near] for k in range(degree + 1)])
            inverse = np.linalg.inv(self.covariance[np.ix_(near, near)])
            weights = np.zeros(len(self.middles))
            weights[near] = inverse @ powers.T @ np.linalg.solve(powers @ inverse @ powers.T, np.eye(degree + 1)[0])
            return weights

        return reading


def judged(name, elements, reading):
    periods, noises = [], []
    for place in PLACES:
        at = MIDDLE + place
        weights = reading(at)
        noises.append(np.sqrt(weights @ elements.covariance @ weights))
        over_samples = weights @ elements.projection
        amplitudes = np.array([over_samples @ np.cos(2 * np.pi * (X - at) / period) for period in PERIODS])
        periods.append(PERIODS[np.flatnonzero(amplitudes < 0.9)[-1] + 1])
    periods, noises = np.array(periods), np.array(noises)
    share = np.r_[0.5, np.ones(len(PLACES) - 2), 0.5] / (len(PLACES) - 1)
    products = periods * noises * np.sqrt(share @ noises**2)
    ends = lambda v: f"{v[0]:.2f} to {v[-1]:.2f}"
    print(f"| {name} | {ends(periods)} | {ends(noises)} | {share @ products:.2f} | {products.max():.2f} |")


def main():
    bilinear = Elements(hat, np.arange(ELEMENTS + 1))
    splines = Elements(cubic, np.arange(-1, ELEMENTS + 2))
    print("| field, and how it is read | period at 90 %, elements | noise | product, mean | worst |\n| --- | --- | --- | --- | --- |")
    judged("bilinear: the field (`displacement_px`)", bilinear, bilinear.shape)
    judged("bilinear: values at points (`displacement_point_px`)", bilinear, bilinear.right_to(3, 4))
    judged("bilinear: ten coefficients, right to the seventh degree", bilinear, bilinear.right_to(7, 10))
    judged("cubic splines: the field", splines, splines.shape)
    judged("cubic splines: eight coefficients, right to the seventh degree", splines, splines.right_to(7, 8))
    for degree in (5, 7):
        beyond = degree // 2
        higher = Elements(b_spline(degree), np.arange(-beyond, ELEMENTS + beyond + 1))
        judged(f"splines of degree {degree}: the field", higher, higher.shape)
    on_mesh = Elements(kept, splines.middles)
    judged("`--elements cubic-spline`: the field (`displacement_px`)", on_mesh, on_mesh.shape)
    judged("`--elements cubic-spline`: values at points (`displacement_point_px`)", on_mesh, values_of_kept(on_mesh))


if __name__ == "__main__":
    main()
