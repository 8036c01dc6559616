"""A field in other packages, where they are installed."""

import sys

import numpy as np
import pytest

import quadrille

ZONE = [16, 16, 112, 80]


@pytest.fixture(scope="module")
def field(reference, deformed):
    return quadrille.Correlator(reference, ZONE, device="cpu").correlate(deformed)


def test_pandas(field):
    pytest.importorskip("pandas")
    table = field.to_pandas()
    assert len(table) == len(field.positions) and np.array_equal(table["ux_px"], field.displacement[:, 0])


def test_xarray(field):
    pytest.importorskip("xarray")
    data = field.to_xarray()
    assert data.displacement.attrs["units"] == "px" and data.sizes == {
        "node": 35, "component": 2, "strain_component": 3, "element": 24, "corner": 4,
    }
    assert np.array_equal(data.displacement.sel(component="y"), field.displacement[:, 1])


def test_a_run_is_one_dataset(series, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    (tmp_path / "loads.csv").write_text("load_N\n" + "".join(f"{10 * k}\n" for k in range(6)))
    case = tmp_path / "case.toml"
    case.write_text(
        f"[images]\nreference = '{series}/000000.tif'\ndeformed = '{series}/*.tif'\n[[zone]]\nroi = [16, 16, 144, 112]\n[load]\n"
        "file = 'loads.csv'\n[[probe]]\npoint = [40, 40]\n[[probe]]\npoint = [60, 50]\n[[region]]\nroi = [30, 30, 90, 90]\n"
    )
    result = quadrille.run(case, tmp_path / "out", device="cpu")
    data = result.to_xarray()
    assert data.sizes["frame"] == 5 and data.frame[0] == 1 and data.displacement_px.dims == ("frame", "node", "component")
    assert data.load_N.values.tolist() == [10, 20, 30, 40, 50] and data.points_ux_px.dims == ("frame", "point")
    assert np.isfinite(data.regions_exx.sel(region="region1")).all() and data.points_ux_px.sel(point="point2").size == 5
    plain = xarray.open_zarr(str(tmp_path / "out/fields.zarr"), consolidated=False, chunks=None)
    assert np.array_equal(plain.displacement_px, data.displacement_px, equal_nan=True)


def test_matplotlib(field, reference, tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    for quantity in ("u", "uy", "exx", "residual"):
        axes = field.plot(quantity, image=reference)
        drawn = axes.collections[0]
        assert len(drawn.get_paths()) == 24
        axes.get_figure().savefig(tmp_path / "map.png")
        pyplot.close("all")
    with pytest.raises(KeyError, match="no quantity"):
        field.plot("speed")


def test_pyvista(field):
    pytest.importorskip("pyvista")
    grid = field.to_pyvista(scale=1.0)
    assert (grid.n_points, grid.n_cells) == (35, 24)
    assert np.allclose(grid.points[:, :2], field.positions + field.displacement, atol=1e-4)  # float32 of VTK


def test_opencv_and_scikit_image(reference, deformed, field):
    skimage = pytest.importorskip("skimage")
    floats = [skimage.img_as_float(image) for image in (reference, deformed)]
    other = quadrille.Correlator(floats[0], ZONE, device="cpu").correlate(floats[1])
    assert np.abs(other.displacement - field.displacement).max() < 2e-3


def test_progress_says_how_far_it_is(series, tmp_path, capsys):
    quadrille.run(None, tmp_path / "out", images=series / "*.tif", zones=[16, 16, 144, 112], device="cpu", on_event=quadrille.Progress())
    said = capsys.readouterr().err
    assert "5 of 5 frames" in said or "5/5" in said


def test_a_notebook_shows_one_line_that_changes_and_no_bar_is_left(monkeypatch):
    display = pytest.importorskip("IPython.display")
    shown = []

    class Handle:
        update = staticmethod(lambda page: shown.append(page.data))

    monkeypatch.setitem(sys.modules, "ipykernel", display)
    monkeypatch.setattr(display, "display", lambda page, display_id: shown.append(page.data) or Handle())
    progress = quadrille.Progress()
    for event in ({"event": "begun", "total": 2, "before": 0}, {"event": "frame"}, {"event": "frame"}, {"event": "finished"}):
        progress(event)
    bars = [f"<progress max='1' value='{at / 2:.4f}'></progress> {at} of 2 frames" for at in (1, 2)]
    assert shown == [*bars, "2 of 2 frames"]


def test_gauges_of_a_run_are_tables_of_pandas(series, tmp_path):
    pytest.importorskip("pandas")
    gauge = {"name": "a#1", "from": [40, 60], "to": [120, 60]}
    case = {"images": {"deformed": str(series / "*.tif")}, "extensometer": [gauge]}
    result = quadrille.run(case, tmp_path / "out", zones=[16, 16, 144, 112], device="cpu")
    table = result.table("extensometers")
    assert table["frame"].tolist() == [1, 2, 3, 4, 5] and set(table["extensometer"]) == {"a#1"}
    assert (table["sigma_elongation_px"] > 0).all()
    assert "5 of 5 converged" in result._repr_html_()
    with pytest.raises(quadrille.StoreError, match="extensometers"):
        result.table("points")
