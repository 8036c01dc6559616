"""Joints: the same fit as the program."""

import json

import pytest

import quadrille


@pytest.fixture(scope="module")
def joint(tmp_path_factory, program):
    """A small virtual test with its case files."""
    folder = tmp_path_factory.mktemp("joint") / "test"
    made = program("make", "virtual-test", "--output", folder)
    assert made.returncode == 0, made.stderr
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


def test_cases_that_are_none_are_refused(tmp_path):
    for call in (quadrille.identify, quadrille.simulate, quadrille.tournament):
        with pytest.raises(quadrille.CaseError, match="none.toml"):
            call(tmp_path / "none.toml", tmp_path / "out")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[images]\nreferenc = 'a'\n")
    with pytest.raises(quadrille.CaseError, match="referenc"):
        quadrille.run(wrong, tmp_path / "out")
