"""The engine beside the program: the same bits; threads, memory, time."""

import gc
import subprocess
import sys
import threading

import numpy as np
import pytest

import quadrille
from conftest import spots

ZONE = [16, 16, 144, 112]


def files(folder):
    """The numbers of a store."""
    store = folder / "fields.zarr"
    inside = sorted(path for path in store.rglob("*") if path.is_file() and path.name != "zarr.json")
    return {path.relative_to(store).as_posix(): path.read_bytes() for path in inside}


@pytest.fixture(scope="module")
def of_program(series, program, tmp_path_factory):
    folder = tmp_path_factory.mktemp("program") / "out"
    ran = program("correlate", "--roi", "16,16,144,112", "--device", "cpu", "--threads", "2", "--output", folder, series / "*.tif")
    assert ran.returncode == 0, ran.stderr
    return folder


def test_a_run_writes_the_bits_of_the_program(series, of_program, tmp_path):
    events = []
    ran = quadrille.run(None, tmp_path / "out", images=series / "*.tif", zones=ZONE, device="cpu", on_event=events.append)
    assert (ran.outcome, len(ran.record["frames"])) == ("fine", 5)
    assert files(tmp_path / "out") == files(of_program) and len(files(of_program)) > 10
    kinds = [event["event"] for event in events]
    assert kinds.index("begun") < kinds.index("frame") < kinds.index("finished")
    assert kinds.count("frame") == 5
    assert [event["number"] for event in events if event["event"] == "frame"] == [1, 2, 3, 4, 5]


def test_a_case_file_and_its_sections_are_the_same_run(series, of_program, tmp_path):
    case = tmp_path / "case.toml"
    case.write_text(f'[images]\ndeformed = "{series}/*.tif"\n[[zone]]\nroi = {ZONE}\n[correlation]\nelement_size_px = 16\n')
    assert quadrille.run(case, tmp_path / "file", device="cpu").outcome == "fine"
    sections = {"images": {"deformed": f"{series}/*.tif"}, "zone": [{"roi": ZONE}]}
    assert quadrille.run(sections, tmp_path / "sections", device="cpu").outcome == "fine"
    assert files(tmp_path / "file") == files(tmp_path / "sections") == files(of_program)


class Enough(Exception):
    pass


@pytest.mark.parametrize("wish", [Enough, KeyboardInterrupt])
def test_a_run_that_is_stopped_goes_on_to_the_same_bits(series, of_program, tmp_path, wish):
    def stop(event):
        if event["event"] == "frame" and event["number"] == 1:
            raise wish

    asked = {"images": series / "*.tif", "zones": ZONE, "device": "cpu"}
    with pytest.raises(wish):
        quadrille.run(None, tmp_path / "out", on_event=stop, **asked)
    begun = []
    assert quadrille.run(None, tmp_path / "out", on_event=begun.append, **asked).outcome == "fine"
    assert next(event for event in begun if event["event"] == "begun")["before"] >= 1
    assert files(tmp_path / "out") == files(of_program)


@pytest.mark.skipif(sys.platform == "win32", reason="a signal to a process")
def test_ctrl_c_stops_a_run(series, tmp_path):
    script = f"""
import os, signal, quadrille
# What starts the tests in the background ignores the signal.
signal.signal(signal.SIGINT, signal.default_int_handler)
def press(event):
    if event["event"] == "frame":
        os.kill(os.getpid(), signal.SIGINT)
try:
    quadrille.run(None, {str(tmp_path / "out")!r}, images={str(series / "*.tif")!r}, zones={ZONE}, device="cpu", on_event=press)
except KeyboardInterrupt:
    print("stopped")
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert ran.stdout == "stopped\n", ran.stderr


def test_the_folder_of_another_run_is_refused(series, tmp_path):
    asked = {"images": series / "*.tif", "device": "cpu", "export": "none"}
    quadrille.run(None, tmp_path / "out", zones=ZONE, **asked)
    with pytest.raises(quadrille.FolderError, match="results of another run"):
        quadrille.run(None, tmp_path / "out", zones=[16, 16, 128, 112], **asked)
    assert quadrille.run(None, tmp_path / "out", zones=[16, 16, 128, 112], overwrite=True, **asked).outcome == "fine"


def test_a_tracker_finds_what_a_run_stores(series, of_program):
    zarr = pytest.importorskip("zarr")
    assert zarr
    store = quadrille.open_store(of_program)
    tracker = quadrille.Tracker(quadrille.Correlator(series / "000000.tif", ZONE, device="cpu"))
    for at in range(5):
        field = tracker.correlate(quadrille.read_image(series / f"{at + 1:06}.tif"))
        assert np.array_equal(field.displacement, store["displacement_px"][at])
        assert np.array_equal(field.sigma.astype(np.float32), store["sigma_px"][at])  # stored so
    with pytest.raises(quadrille.OptionError, match="must rise"):
        tracker.correlate(series / "000001.tif", 3)
    with pytest.raises(quadrille.StoreError, match="no store"):
        quadrille.open_store(series)


def test_two_threads_correlate_at_once_to_the_same_bits(reference, deformed):
    correlator = quadrille.Correlator(reference, [16, 16, 112, 80], device="cpu")
    images = [spots(move=(0.1 * k, 0.05 * k)) for k in range(6)]
    want = [correlator.correlate(image).displacement for image in images]
    have = [[None] * len(images) for _ in range(2)]

    def work(mine):
        for at, image in enumerate(images):
            have[mine][at] = correlator.correlate(image).displacement

    threads = [threading.Thread(target=work, args=(mine,)) for mine in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(a, b) for mine in have for a, b in zip(want, mine, strict=True))


def test_the_interpreter_is_free_while_an_image_is_correlated():
    image = spots((512, 512))
    correlator = quadrille.Correlator(image, [16, 16, 496, 496], device="cpu", threads=1)
    ticks, done = [0], threading.Event()

    def tick():
        while not done.is_set():
            ticks[0] += 1

    thread = threading.Thread(target=tick)
    thread.start()
    before = ticks[0]
    sys.setswitchinterval(10)  # nobody gets the interpreter but who is given it
    try:
        correlator.correlate(image)
    finally:
        sys.setswitchinterval(0.005)
        done.set()
        thread.join()
    assert ticks[0] - before > 100


def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_ten_thousand_calls_leak_nothing(tmp_path):
    image = spots((32, 48))
    correlator = quadrille.Correlator(image, [8, 8, 40, 24], element_size_px=16, device="cpu", threads=1)

    def calls(n):
        for _ in range(n):
            correlator.correlate(image)
            try:
                correlator.correlate(image[1:])
            except quadrille.ImageError:
                pass
        gc.collect()

    calls(1000)
    before = resident()
    calls(5000)
    # One leaked image would be 1536 bytes a call, 7.7 MB; an array of the field 48 bytes and its object 112.
    assert resident() - before < 1_000_000


def test_importing_takes_a_fifth_of_a_second_at_most():
    # Time of the processor: what else the machine does is not ours.
    script = "import time; a = time.process_time(); import quadrille; print(time.process_time() - a)"
    times = [float(subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout) for _ in range(5)]
    assert min(times) < 0.2


def test_a_process_that_was_forked_has_threads_of_its_own(reference, deformed):
    if not hasattr(__import__("os"), "fork"):
        pytest.skip("no fork here")
    script = f"""
import os, sys
sys.path.insert(0, {str(__file__.rsplit("/", 1)[0])!r})
import quadrille
from conftest import spots
image = spots()
quadrille.Correlator(image, [16, 16, 112, 80], device="cpu").correlate(image)
child = os.fork()
if child == 0:
    field = quadrille.Correlator(image, [16, 16, 112, 80], device="cpu").correlate(image)
    os._exit(0 if field.status == "converged" else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    ran = subprocess.run([sys.executable, "-W", "ignore", "-c", script], capture_output=True, text=True, timeout=60)
    assert ran.stdout == "0\n", ran.stderr


def test_the_program_of_the_wheel_is_the_program(program):
    assert program("--version").stdout == f"quadrille {quadrille.__version__}\n"
    wrong = program("correlate", "--outptu", "x")
    assert wrong.returncode == 2 and wrong.stderr.startswith("quadrille: ")
    assert "MIT" in program("about", "licences").stdout


def test_a_command_gives_what_the_program_says_or_its_reason(series, of_program):
    assert "5 of 5 frames done" in quadrille.command(["status", of_program])
    assert quadrille.command("--version") == f"quadrille {quadrille.__version__}\n"
    with pytest.raises(quadrille.QuadrilleError, match="^no such|none"):
        quadrille.command(f"status '{series}/none'")


def test_metrology_of_arrays(reference):
    found = quadrille.metrology(spots((160, 160)), noise=1.0, element_sizes=[16])
    assert found["sizes"][0]["element_size_px"] == 16
    with pytest.raises(quadrille.ImageError):
        quadrille.metrology(np.full((64, 64), 3, np.uint8))
