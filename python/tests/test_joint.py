"""Joints: the same fit as the program."""

import json

import pytest

import quadrille


@pytest.fixture(scope="module")
def joint(tmp_path_factory):
    """A virtual test with its case file."""
    folder = tmp_path_factory.mktemp("joint") / "test"
    made = quadrille.virtual_test(folder)
    assert made.outcome == "fine" and made.record == json.loads((folder / "truth.json").read_text())
    return folder


def without_times(record):
    """A record without what differs from run to run."""
    if isinstance(record, dict):
        return {key: without_times(value) for key, value in record.items() if not key.startswith("seconds") and key not in ("case", "threads")}
    return [without_times(item) for item in record] if isinstance(record, list) else record


def test_a_run_from_images_to_the_law_is_that_of_the_program(joint, program, tmp_path):
    events = []
    ran = quadrille.run(joint / "case.toml", tmp_path / "python", device="cpu", on_event=events.append)
    told = program("run", joint / "case.toml", "--device", "cpu", "--output", tmp_path / "program", "--quiet")
    assert {"fine": 0, "incomplete": 1}[ran.outcome] == told.returncode, told.stderr
    want = json.loads((tmp_path / "program/fit.json").read_text())
    assert without_times(ran.record) == without_times(want)
    kinds = {event["event"] for event in events}
    assert {"frame", "fitting", "identified", "reported"} <= kinds
    assert (tmp_path / "python/report.html").exists()
    shown = ran._repr_html_()
    assert "phi_n" in shown and "image/png" in shown and len(repr(ran)) < 300
    pandas = pytest.importorskip("pandas")
    law = ran.table("law")
    assert isinstance(law, pandas.DataFrame) and (law["low95_MPa"] <= law["high95_MPa"]).all() and set(law["mode"]) == {1, 2}
    with pytest.raises(quadrille.StoreError, match="budget"):
        ran.table("none")


def test_a_virtual_test_is_that_of_the_program(joint, program, tmp_path):
    words = ["--instants", 2, "--seed", 3, "--depth", 16, "--mixity", "opening"]
    made = program("make", "virtual-test", *words, "--output", tmp_path / "program")
    assert made.returncode == 0, made.stderr
    quadrille.virtual_test(tmp_path / "python", instants=2, seed=3, depth=16, mixity="opening")
    files = [sorted(path for path in (tmp_path / name).rglob("*") if path.is_file()) for name in ("program", "python")]
    assert [path.read_bytes() for path in files[0]] == [path.read_bytes() for path in files[1]] and len(files[0]) > 8
    with pytest.raises(quadrille.FolderError, match="virtual test"):
        quadrille.virtual_test(joint)
    for wrong in ({"depth": 12}, {"mixity": "both"}, {"kinematics": "large"}, {"instants": 0}, {"law": "none"}):
        with pytest.raises(quadrille.OptionError):
            quadrille.virtual_test(tmp_path / "wrong", **wrong)


def test_cases_that_are_none_are_refused(tmp_path):
    for call in (quadrille.identify, quadrille.simulate, quadrille.tournament):
        with pytest.raises(quadrille.CaseError, match="none.toml"):
            call(tmp_path / "none.toml", tmp_path / "out")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[images]\nreferenc = 'a'\n")
    with pytest.raises(quadrille.CaseError, match="referenc"):
        quadrille.run(wrong, tmp_path / "out")


def test_a_test_of_the_standards_is_reduced_as_the_program_does(program, tmp_path):
    rows = [f"{20 * k},{0.02 * k + (0.0002 * k**2 if k > 5 else 0)}" for k in range(1, 12)]
    (tmp_path / "series.csv").write_text("load_N,displacement_mm\n" + "\n".join(rows) + "\n")
    (tmp_path / "dcb.toml").write_text(
        "[reduction]\nlayout = 'dcb'\ntable = 'series.csv'\nwidth_mm = 20.0\narm_mm = 3.0\ncrack_mm = 40.0\n"
    )
    found = quadrille.reduce(tmp_path / "dcb.toml", tmp_path / "python")
    program("reduce", "dcb.toml", "--output", "program", cwd=tmp_path)
    assert found.record == json.loads((tmp_path / "program/reduction.json").read_text()) | {"case": found.record["case"]}
    assert any(result["name"].startswith("CBBM") for result in found.record["results"])
    (tmp_path / "none.toml").write_text("[images]\n")
    with pytest.raises(quadrille.QuadrilleError, match="no table .reduction."):
        quadrille.reduce(tmp_path / "none.toml", tmp_path / "wrong")
