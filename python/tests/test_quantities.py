"""Quantities of a field in Python: the same numbers as the program's tables."""

import csv
import pickle
import subprocess
import sys

import numpy as np
import pytest

import quadrille
from conftest import spots


@pytest.fixture
def pair(tmp_path):
    reference, deformed = spots((160, 192)), spots((160, 192), move=(1.7, 0.6))
    for name, image in (("ref", reference), ("def", deformed)):
        (tmp_path / f"{name}.pgm").write_bytes(b"P5 192 160 255\n" + image.tobytes())
    return reference, deformed, tmp_path


ZONES = [{"name": "upper", "roi": [16, 16, 176, 64]}, {"name": "lower", "roi": [16, 80, 176, 144]}]


def test_quantities_are_those_of_the_program(pair):
    reference, deformed, folder = pair
    field = quadrille.Correlator(reference, ZONES, device="cpu").correlate(deformed)
    (folder / "case.toml").write_text(
        "".join(f"[[zone]]\nname = '{zone['name']}'\nroi = {zone['roi']}\n" for zone in ZONES)
        + "[[probe]]\npoint = [50, 40]\n[[line]]\nfrom = [40, 100]\nto = [120, 110]\n[[extensometer]]\nfrom = [40, 100]\n"
        "to = [150, 100]\nwidth_px = 20\n[[region]]\nroi = [40, 90, 150, 130]\n[[opening]]\nzones = ['upper', 'lower']\n"
    )
    images = [str(folder / name) for name in ("ref.pgm", "def.pgm")]
    words = ["correlate", "--case", str(folder / "case.toml"), "--output", str(folder / "out"), "--device", "cpu", "--quiet", *images]
    subprocess.run([sys.executable, "-m", "quadrille", *words], check=True)

    def table(name):
        with open(folder / f"out/quantities/{name}.csv") as text:
            return list(csv.DictReader(line for line in text if not line.startswith("#")))

    def same(found, rows):
        for name, values in found.items():
            cells = [row[name] for row in rows]
            if isinstance(values, list):
                assert values == cells
            else:
                wanted = [float(cell) if cell else np.nan for cell in cells]
                # The store rounds displacements to 32 bits, and model errors to some per cent.
                rough = 5e-2 if name.startswith("model_error") else 1e-5
                np.testing.assert_allclose(np.atleast_1d(values), wanted, rtol=rough, atol=1e-9, err_msg=name)

    same(field.at([50, 40]), table("points"))
    same(field.line([40, 100], [120, 110]), table("lines"))
    same(field.extensometer([40, 100], [150, 100], width_px=20), table("extensometers"))
    same(field.region([40, 90, 150, 130]), table("regions"))
    same(field.opening("upper", "lower"), table("openings"))
    assert field.region("upper")["measured_percent"] == 100
    assert len(field.at(np.array([[50, 40], [60, 50]]))["ux_px"]) == 2
    assert np.isnan(field.at([0, 0])["ux_px"][0])


def test_window_strain_and_model_error_are_quantities_and_a_notebook_shows_a_table(pair):
    reference, deformed, _ = pair
    field = quadrille.Correlator(reference, ZONES, device="cpu", strain_window=3).correlate(deformed)
    assert np.array_equal(field.values("exx_window"), field.window_strain[:, 0], equal_nan=True)
    assert field.values("model_error").shape == (len(field.positions),)
    assert "nodes measured" in field._repr_html_() and len(field._repr_html_()) < 50_000
    assert field.interpolation_bias_px.shape == (2,) and (field.interpolation_bias_px >= 0).all()
    assert np.array_equal(field.values("marks"), field.marks) and field.remarks == []
    with pytest.raises(KeyError, match="exx_window"):
        field.values("ezz")


def test_what_means_nothing_is_refused_and_a_copy_says_what_it_lacks(pair):
    reference, deformed, _ = pair
    field = quadrille.Correlator(reference, ZONES, device="cpu").correlate(deformed)
    with pytest.raises(quadrille.QuadrilleError, match="no zone 'middle'"):
        field.region("middle")
    with pytest.raises(quadrille.QuadrilleError, match="to the same point"):
        field.extensometer([40, 100], [40, 100])
    with pytest.raises(quadrille.OptionError, match="finite"):
        field.at([np.nan, 1])
    copy = pickle.loads(pickle.dumps(field))
    assert copy.status == field.status
    with pytest.raises(quadrille.QuadrilleError, match="correlate again"):
        copy.at([50, 40])


def test_a_frame_says_what_there_is_to_say_of_it(pair):
    reference, deformed, _ = pair
    correlator = quadrille.Correlator(reference, ZONES, device="cpu", noise=6.0)
    field = correlator.correlate(deformed)
    said = [remark["text"] for remark in field.remarks if remark["code"] == "noise-contradicted"]
    assert [zone["name"] in text for zone, text in zip(ZONES, said, strict=True)] == [True, True], field.remarks
    assert "uncertainties are too large" in field._repr_html_()
