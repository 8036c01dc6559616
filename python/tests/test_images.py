"""Arrays that go in: every kind gives the same field, or says what is wrong with it."""

import os
import re
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import quadrille
from conftest import spots

ZONE = [16, 16, 112, 80]


def found(reference, deformed):
    return quadrille.Correlator(reference, ZONE, device="cpu").correlate(deformed)


def test_a_shift_is_measured_within_its_uncertainty(reference, deformed):
    field = found(reference, deformed)
    assert field.status == "converged"
    assert field.positions.shape == field.displacement.shape == field.sigma.shape == (35, 2)
    assert field.elements.shape == (24, 4) and field.strain.shape == (35, 3) and field.residual.shape == (24,)
    error = field.displacement - [0.4, -0.3]
    assert np.abs(error).max() < 0.03  # the rounding to 8 bits and the interpolation
    assert np.sqrt((error**2).mean()) < 4 * field.sigma.mean()
    assert np.abs(field.strain).max() < 0.01


@pytest.mark.parametrize("kind", ["F", "step", "flip", "view", "one more axis", "list"])
def test_the_layout_of_an_array_changes_no_bit(reference, deformed, kind):
    def laid(image):
        match kind:
            case "F":
                return np.asfortranarray(image)
            case "step":
                wide = np.zeros((image.shape[0] * 2, image.shape[1] * 3), image.dtype)
                wide[::2, ::3] = image
                return wide[::2, ::3]
            case "flip":
                return image[::-1, ::-1].copy()[::-1, ::-1]
            case "view":
                return np.pad(image, 5)[5:-5, 5:-5]
            case "one more axis":
                return image[:, :, None]
            case _:
                return memoryview(image)

    want, have = found(reference, deformed), found(laid(reference), laid(deformed))
    assert np.array_equal(want.displacement, have.displacement) and np.array_equal(want.sigma, have.sigma)


@pytest.mark.parametrize("dtype", ["<u2", ">u2", "<f4", ">f4", "<f8", "f2"])
def test_every_depth_gives_the_same_field(reference, deformed, dtype):
    want, have = found(reference, deformed), found(reference.astype(dtype), deformed.astype(dtype))
    # Of floats it is not known that they were rounded to whole grey levels; of the rest, and of fields, nothing else differs.
    assert np.abs(want.displacement - have.displacement).max() < 2e-3


def test_an_array_that_is_read_only_is_read(reference, deformed):
    reference, deformed = reference.copy(), deformed.copy()
    reference.flags.writeable = deformed.flags.writeable = False
    assert found(reference, deformed).status == "converged"


@pytest.mark.parametrize(
    ("wrong", "error", "says"),
    [
        (np.zeros((96, 128)), quadrille.ImageError, "grey level 0"),
        (np.zeros((96, 128, 3), np.uint8), quadrille.ImageError, "colour image"),
        (np.zeros(96, np.uint8), quadrille.ImageError, r"shape \[96\]"),
        (np.zeros((0, 128), np.uint8), quadrille.ImageError, "no pixel"),
        (np.zeros((90, 128), np.uint8), quadrille.ImageError, "128 x 90 px, the reference 128 x 96 px"),
        (np.zeros((96, 128), object), quadrille.ImageError, "object"),
        (np.full((96, 128), 255, np.int32), quadrille.ImageError, "int32.*255: image.astype\\(numpy.uint8\\)"),
        (np.full((96, 128), 256, np.uint64), quadrille.ImageError, "uint64.*256: image.astype\\(numpy.uint16\\)"),
        (np.full((96, 128), -1, np.int64), quadrille.ImageError, "int64.*-1 to 0: .*float32"),
        (np.zeros((96, 128), bool), quadrille.ImageError, "bool|b1"),
        (np.zeros((96, 128), complex), quadrille.ImageError, "complex|c16"),
        (np.full((96, 128), np.nan, np.float32), quadrille.ImageError, r"\(0, 0\) px is NaN"),
        (np.full((96, 128), "a"), quadrille.ImageError, "U1"),
        (None, quadrille.ImageError, "shape"),
        ("no such file.tif", quadrille.ImageError, "no such file"),
    ],
)
def test_what_is_no_image_is_said_so(reference, wrong, error, says):
    correlator = quadrille.Correlator(reference, ZONE, device="cpu")
    with pytest.raises(error, match=says):
        correlator.correlate(wrong)


@pytest.mark.parametrize(
    ("zones", "options", "error", "says"),
    [
        ([200, 16, 300, 80], {}, quadrille.ZoneError, "outside|image"),
        ([112, 16, 16, 80], {}, quadrille.ZoneError, "rectangle"),
        ([[16, 16], [100, 16]], {}, quadrille.ZoneError, "corners|polygon"),
        ([16, 16, float("nan"), 80], {}, quadrille.OptionError, "finite"),
        ([], {}, quadrille.OptionError, "no zone"),
        (ZONE, {"element_size_px": 2}, quadrille.ZoneError, "4 to 128"),
        (ZONE, {"element_size": 16}, quadrille.CaseError, "element_size"),
        (ZONE, {"tolerance_px": -1.0}, quadrille.OptionError, "tolerance"),
        (ZONE, {"brightness": "bright"}, quadrille.CaseError, "bright"),
        (ZONE, {"noise": object()}, quadrille.OptionError, "object"),
        (ZONE, {"device": "no such device"}, quadrille.DeviceError, "no such device|no graphics device"),
        (ZONE, {"threads": 0}, quadrille.OptionError, "threads is 0"),
        (ZONE, {"isa": "mmx"}, quadrille.OptionError, "mmx"),
        (ZONE, {"update_reference": "residual"}, quadrille.OptionError, "series"),
    ],
)
def test_what_is_no_option_is_said_so(reference, zones, options, error, says):
    with pytest.raises(error, match=says):
        quadrille.Correlator(reference, zones, **{"device": "cpu", **options})


def test_a_reference_without_texture_is_refused(reference):
    flat = np.full((96, 128), 100, np.uint8)
    flat[::7, ::9] += 1
    with pytest.raises(quadrille.TextureError):
        quadrille.Correlator(flat, ZONE, device="cpu")


def test_the_specimen_is_found_and_a_warning_says_where(reference, deformed):
    framed = np.pad(reference, 40, constant_values=20), np.pad(deformed, 40, constant_values=20)
    with pytest.warns(UserWarning, match="zone found"):
        correlator = quadrille.Correlator(framed[0], device="cpu")
    assert correlator.zones == ["specimen"] and correlator.remarks[0]["code"] == "zones-found"
    assert correlator.correlate(framed[1]).status == "converged"


def test_a_mask_holds_for_the_whole_image(reference, deformed):
    mask = np.zeros(reference.shape, bool)
    mask[16:80, 16:112] = True
    field = quadrille.Correlator(reference, mask=mask, device="cpu").correlate(deformed)
    assert field.positions[:, 0].min() >= 0 and field.status == "converged"
    with pytest.raises(quadrille.OptionError, match="mask is"):
        quadrille.Correlator(reference, mask=mask[1:], device="cpu")
    with pytest.raises(TypeError, match="array of bool"):
        quadrille.Correlator(reference, mask=mask.astype(np.uint8), device="cpu")


def test_images_are_not_copied_by_python():
    image = spots((512, 512)).astype(np.float32)
    correlator = quadrille.Correlator(image, [16, 16, 496, 496], element_size_px=32, device="cpu")
    tracemalloc.start()
    field = correlator.correlate(image)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # Arrays of the field, 8 bytes for each number of it, and none of the image, which has a megabyte.
    assert peak < 40 * 8 * len(field.positions) + 65536 < image.nbytes / 4


@pytest.mark.skipif(not os.path.exists("/proc/self/clear_refs"), reason="Linux says the peak of the memory")
def test_grey_levels_that_lie_row_by_row_are_looked_at_where_they_are():
    def peak_bytes(image):
        """How much the memory of this process rises for a moment while `image` is correlated."""
        said = lambda what: int(re.search(rf"{what}:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) * 1024
        correlator.correlate(image)
        Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
        before = said("VmRSS")
        correlator.correlate(image)
        return said("VmHWM") - before

    image = np.tile(spots((256, 256)), (6, 6)).astype(np.float32)
    image += np.linspace(0, 9, image.shape[1], dtype=np.float32)
    correlator = quadrille.Correlator(image, [16, 16, 1500, 1500], element_size_px=64, device="cpu", threads=1)
    columns = np.asfortranarray(image)
    references = sys.getrefcount(image)
    straight, turned = peak_bytes(image), peak_bytes(columns)
    # The same grey levels, column by column, have to be brought in order and take room once more (some of it is there from before).
    said = f"{straight} and {turned} bytes for an image of {image.nbytes}"
    assert straight < 0.1 * image.nbytes and turned > 0.4 * image.nbytes, said
    # Nothing keeps the array after the call.
    assert sys.getrefcount(image) == references


def test_a_file_is_read_in_its_depth(series):
    image = quadrille.read_image(series / "000000.tif")
    assert image.dtype in (np.uint8, np.uint16) and image.shape == (128, 160)
    with pytest.raises(quadrille.ImageError, match="no page 7"):
        quadrille.read_image(series / "000000.tif", page=7)
    with pytest.raises(quadrille.ImageError, match="folder"):
        quadrille.read_image(series)
