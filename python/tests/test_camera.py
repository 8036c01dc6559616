"""The camera: read, written, and places in mm with what is unknown of it."""

import numpy as np
import pytest

import quadrille

KEYS = {
    "image_size_px": [1024, 768],
    "distortion": [0.01, -0.002],
    "tilt_per_px": [2e-5, -1e-5],
    "distortion_std": [1e-3],
    "pixel_size_mm": 0.05,
    "pixel_size_relative_std": 1e-3,
}
PX = [[10.0, 20.0], [511.5, 383.5], [1000.0, 700.0]]


def test_places_in_mm_lead_back_and_y_is_up():
    camera = quadrille.Camera(**KEYS)
    mm = camera.to_mm(PX)
    assert mm.shape == (3, 2) and (np.diff(mm[:, 0]) > 0).all() and (np.diff(mm[:, 1]) < 0).all()
    assert np.abs(camera.to_px(mm) - PX).max() < 1e-6
    assert camera.to_mm(PX[0]).shape == (2,)


def test_what_is_written_is_read(tmp_path):
    camera = quadrille.Camera(**KEYS)
    camera.write(tmp_path / "camera.toml")
    again = quadrille.Camera.read(tmp_path / "camera.toml")
    assert again.keys == camera.keys and again.keys["pixel_size_mm"] == 0.05
    assert np.array_equal(again.to_mm(PX), camera.to_mm(PX))
    assert "1024 x 768" in repr(again)


def test_uncertainties_are_what_other_cameras_give():
    camera = quadrille.Camera(**KEYS)
    terms = camera.terms_mm(PX)
    assert terms.shape == (2, 3, 2)
    longer = quadrille.Camera(**{**KEYS, "pixel_size_mm": 0.05 * 1.001})
    assert np.allclose(longer.to_mm(PX) - camera.to_mm(PX), terms[1], rtol=1e-6)
    other = quadrille.Camera(**{**KEYS, "distortion": [0.011, -0.002]})
    # To first order of a change of 1e-3.
    assert np.allclose(other.to_mm(PX) - camera.to_mm(PX), terms[0], rtol=0.03, atol=1e-6)
    assert np.allclose(camera.sigma_mm(PX) ** 2, (terms**2).sum(axis=0))


def test_displacements_in_mm_take_the_lens_off():
    camera = quadrille.Camera(**KEYS)
    moved = camera.to_px(camera.to_mm(PX) + [0.5, -0.25]) - PX
    displacement, sigma = camera.displacement_mm(PX, moved)
    assert np.abs(displacement - [0.5, -0.25]).max() < 1e-7 and (sigma > 0).all() and (sigma < 0.01).all()


def test_strains_of_a_correlator_are_those_of_its_camera(reference, deformed, tmp_path):
    zone, size = [16, 16, 112, 80], [128, 96]
    camera = quadrille.Camera(image_size_px=size, tilt_per_px=[1e-3, 0.0], exact=True)
    camera.write(tmp_path / "camera.toml")
    raw = quadrille.Correlator(reference, zone, device="cpu").correlate(deformed)
    seen = [
        quadrille.Correlator(reference, zone, device="cpu", camera=given).correlate(deformed)
        for given in (camera, tmp_path / "camera.toml")
    ]
    assert np.array_equal(seen[0].strain, seen[1].strain) and np.array_equal(seen[0].displacement, raw.displacement)
    assert np.abs(seen[0].strain - raw.strain).max() > 1e-4
    with pytest.raises(quadrille.QuadrilleError, match="100 x 100 px, these have 128 x 96"):
        quadrille.Correlator(reference, zone, device="cpu", camera=quadrille.Camera(image_size_px=[100, 100], distortion=[0.01]))


def test_what_is_no_camera_is_said(tmp_path):
    with pytest.raises(quadrille.OptionError, match="image_size_px"):
        quadrille.Camera(distortion=[0.01])
    with pytest.raises(quadrille.CaseError, match="folds"):
        quadrille.Camera(image_size_px=[640, 480], distortion=[-0.7])
    with pytest.raises(quadrille.QuadrilleError, match="lense"):
        quadrille.Camera(lense=1)
    with pytest.raises(quadrille.CaseError, match="no such camera file"):
        quadrille.Camera.read(tmp_path / "no.toml")
    bare = quadrille.Camera(image_size_px=[640, 480], distortion=[0.01])
    with pytest.raises(quadrille.OptionError, match="pixel_size_mm"):
        bare.to_mm([1, 2])
    camera = quadrille.Camera(**KEYS)
    for wrong in ([1.0, 2.0, 3.0], 1.0, "x", [[1.0], [2.0]]):
        with pytest.raises(quadrille.OptionError, match="px"):
            camera.to_mm(wrong)
    with pytest.raises(quadrille.OptionError, match="one for each place"):
        camera.displacement_mm(PX, PX[:2])


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    """A specimen at rest, moved across and along, as files."""
    folder = tmp_path_factory.mktemp("moved")
    for name, shift in (("a", "0,0"), ("b", "32,1"), ("c", "-2,28")):
        words = f"make images translation --size 320x256 --shift={shift} --noise 1 --output"
        quadrille.command([*words.split(), folder / name])
    return [folder / name / "000001.tif" for name in "abc"]


def test_a_camera_is_found_from_a_specimen_that_was_moved_as_by_the_program(moved, tmp_path, program):
    events = []
    found = quadrille.calibrate(moved, tmp_path / "python", lengths=[[40, 128, 240, 128, 10]], device="cpu", on_event=events.append)
    told = program("calibrate", "--device", "cpu", "--length", "40,128,240,128,10", "--output", tmp_path / "program", *moved)
    assert told.returncode == 0, told.stderr
    assert found.camera.keys == quadrille.Camera.read(tmp_path / "program/camera.toml").keys
    assert found.camera.keys["pixel_size_mm"] == pytest.approx(0.05, rel=2e-3)
    assert " ".join(told.stdout.split()) == " ".join(" ".join(found.said).split())
    assert [event["event"] for event in events].count("frame") == 2
    mm, sigma = found.camera.displacement_mm([160.0, 128.0], [20.0, 0.0])
    assert abs(mm[0] - 1.0) < 4 * sigma[0] + 2e-3


def test_images_that_determine_no_camera_are_refused_with_what_is_missing(moved, tmp_path):
    with pytest.raises(quadrille.CalibrationError, match="move the specimen"):
        quadrille.calibrate([moved[0].with_name("000000.tif"), moved[0]], tmp_path / "still", device="cpu")
    with pytest.raises(quadrille.ImageError, match="inner corners"):
        quadrille.calibrate(moved[:1], tmp_path / "board", chessboard=(9, 6), pitch_mm=5.0)
    with pytest.raises(quadrille.OptionError, match="pitch"):
        quadrille.calibrate(moved[:1], tmp_path / "board", chessboard=(9, 6))
    with pytest.raises(quadrille.ImageError, match="none.tif"):
        quadrille.calibrate("none.tif", tmp_path / "none", lengths=[[0, 0, 10, 0, 1]])
