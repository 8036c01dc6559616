//! What the program meets on shared machines and in files that others made: nobody listens, sockets and locks of
//! others, names of any bytes, headers that claim more than there is. Each of these ended a run, or hung it, before.

#![cfg(all(feature = "cli", target_os = "linux"))]

use crate::program::process::{assert_same, end, results, start, wait_for_frames};
use crate::program::{Desk, HEIGHT, WIDTH, moved, remarks};
use quadrille::imaging::{Image, Pixels};
use quadrille::remark::{About, Code};
use std::fs;
use std::io::Write;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::Gray8;
use tiff::tags::Tag;

const PROGRAM: &str = env!("CARGO_BIN_EXE_quadrille");

/// Runs a line of the shell on the desk, in which `$Q` is the program.
fn shell(desk: &Desk, line: &str) -> Output {
    let mut command = Command::new("bash");
    command.args(["-c", line]).env("Q", PROGRAM).env("QUADRILLE_DEVICE", "cpu").current_dir(desk.path(""));
    command.stdin(Stdio::null()).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_series_goes_on_where_nobody_can_hear_it() {
    let desk = Desk::with_series();
    for (folder, stderr) in [("full", "2>/dev/full"), ("closed", "2>&-")] {
        let line = format!("exec $Q correlate --output {folder} --verbose ref.png a.png b.png c.png {stderr}");
        assert_eq!(shell(&desk, &line).status.code(), Some(0), "{line}");
        assert_eq!(desk.json(&format!("{folder}/summary.json"))["frames"].as_array().unwrap().len(), 3);
    }
}

#[test]
fn a_result_that_cannot_be_written_is_no_success_and_a_reader_that_has_enough_is_no_fault() {
    let desk = Desk::new();
    let lost = shell(&desk, "exec $Q about schema >/dev/full");
    assert!(matches!(lost.status.code(), Some(1 | 2)), "{:?}", lost.status);
    assert!(said(&lost).contains("No space left"), "{}", said(&lost));
    let enough =
        shell(&desk, "set -o pipefail; $Q about devices | true; $Q about devices --json | head -c 1 >/dev/null");
    assert!(!said(&enough).contains("panicked") && enough.status.code() == Some(0), "{}", said(&enough));
}

#[test]
fn no_socket_in_a_folder_of_everybody_is_spoken_to() {
    let desk = Desk::new();
    let listener = std::os::unix::net::UnixListener::bind(desk.path("wayland-0")).unwrap();
    listener.set_nonblocking(true).unwrap();
    let output = Command::new(PROGRAM)
        .args(["about", "devices"])
        .env_remove("XDG_RUNTIME_DIR")
        .env("TMPDIR", desk.path(""))
        .env("WAYLAND_DISPLAY", "wayland-0")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(listener.accept().is_err(), "somebody's socket was asked");
    assert!(!said(&output).contains("XDG_RUNTIME_DIR"), "{}", said(&output));
}

/// A library that makes `flock` what it is on NFS: exclusive locks of files that are open for reading alone are refused
/// (`EBADF`); with `QUADRILLE_TEST_NO_LOCKS` every lock is (`ENOLCK`, as without a lock service).
const NFS: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/file.h>
int flock(int fd, int how) {
    if (getenv("QUADRILLE_TEST_NO_LOCKS")) { errno = ENOLCK; return -1; }
    int mode = fcntl(fd, F_GETFL) & O_ACCMODE;
    if (((how & LOCK_EX) && mode == O_RDONLY) || ((how & LOCK_SH) && mode == O_WRONLY)) { errno = EBADF; return -1; }
    int (*of_system)(int, int) = dlsym(RTLD_NEXT, "flock");
    return of_system(fd, how);
}
"#;

fn nfs(desk: &Desk) -> String {
    desk.write("nfs.c", NFS);
    compiled(desk, &desk.path("nfs.c"))
}

/// Compiles a library with the C compiler that every Rust toolchain links with.
fn compiled(desk: &Desk, source: &Path) -> String {
    let library = desk.path("preloaded.so");
    let source = source.to_path_buf();
    let made =
        Command::new("cc").args(["-shared", "-fPIC", "-o"]).args([&library, &source]).arg("-ldl").output().unwrap();
    assert!(made.status.success(), "{}", said(&made));
    library.to_str().unwrap().to_owned()
}

#[test]
fn locks_keep_a_second_division_of_a_series_away_on_nfs_too() {
    let desk = Desk::with_series();
    let library = nfs(&desk);
    desk.run("correlate --output run --shard 1/3 ref.png a.png b.png c.png").fine();
    // Another process holds the lock of its share, as `flock` of util-linux does on a file opened for writing.
    let lock = fs::read_dir(desk.path("run")).unwrap().flatten().map(|entry| entry.path());
    let folder = lock.into_iter().chain([desk.path("run")]).find(|path| path.join("lock").exists()).unwrap();
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    let shard =
        fs::read_dir(&folder).unwrap().flatten().map(|entry| entry.path()).find(|path| name(path).contains("-of-3"));
    let held = fs::OpenOptions::new().read(true).write(true).open(shard.unwrap()).unwrap();
    held.lock().unwrap();
    let ran = desk.run_with(
        &[("LD_PRELOAD", &library)],
        &["correlate", "--output", "run", "--shard", "1/2", "ref.png", "a.png", "b.png", "c.png"],
    );
    assert_eq!(ran.code, Some(2), "{ran}");
    let status = desk.run_with(&[("LD_PRELOAD", &library)], &["status", "run"]);
    assert!(status.stdout.contains("in work"), "{status}");
    drop(held);
    let ran = desk.run_with(
        &[("LD_PRELOAD", &library)],
        &["correlate", "--output", "run", "--shard", "2/3", "ref.png", "a.png", "b.png", "c.png"],
    );
    ran.fine();
}

#[test]
fn a_file_system_without_a_lock_service_is_warned_of_and_used() {
    let desk = Desk::with_series();
    let library = nfs(&desk);
    let environment = [("LD_PRELOAD", library.as_str()), ("QUADRILLE_TEST_NO_LOCKS", "1")];
    let ran = desk.run_with(&environment, &["correlate", "--output", "run", "ref.png", "a.png"]).fine();
    assert!(ran.stderr.contains("the file system has no locks"), "{ran}");
}

#[test]
fn names_that_are_no_text_are_refused_and_none_is_left_out_in_silence() {
    let desk = Desk::with_series();
    let odd = desk.path("").join(std::ffi::OsStr::from_bytes(b"d\xff.png"));
    fs::copy(desk.path("c.png"), odd).unwrap();
    desk.correlate("--output run --reference ref.png [a-d]*.png").refused(&["UTF-8", "rename"]);
    desk.correlate("--output run --reference ref.png [a-c]*.png").fine();
}

#[test]
fn hidden_files_are_left_out_unless_they_are_asked_for() {
    let desk = Desk::with_series();
    fs::copy(desk.path("a.png"), desk.path("._a.png")).unwrap();
    let n = |folder: &str| desk.json(&format!("{folder}/summary.json"))["frames"].as_array().unwrap().len();
    desk.correlate("--output run --reference ref.png *a.png").fine();
    assert_eq!(n("run"), 1);
    desk.correlate("--output dotted --reference ref.png .*a.png").fine();
    assert_eq!(n("dotted"), 1);
}

/// A PNG file of one bit per pixel and `side`² px that is not there: `filling` bytes stand for the pixels.
fn hollow_png(side: u32, filling: usize) -> Vec<u8> {
    let crc = |bytes: &[u8]| {
        let step = |crc: u32, byte: &u8| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
        };
        !bytes.iter().fold(!0, step)
    };
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |name: &[u8; 4], data: &[u8]| {
        let body = [name.as_slice(), data].concat();
        file.extend((data.len() as u32).to_be_bytes());
        file.extend(&body);
        file.extend(crc(&body).to_be_bytes());
    };
    let header = [side.to_be_bytes().as_slice(), &side.to_be_bytes(), &[1, 3, 0, 0, 0]].concat();
    chunk(b"IHDR", &header);
    chunk(b"PLTE", &[0, 0, 0, 255, 255, 255]);
    chunk(b"IDAT", &vec![0x78; filling]);
    chunk(b"IEND", &[]);
    file
}

/// A TIFF file of 8 x 8 px whose list of strips claims 2^28 entries.
fn endless_tiff() -> Vec<u8> {
    let entries: [(u16, u16, u32, u32); 9] = [
        (256, 3, 1, 8),
        (257, 3, 1, 8),
        (258, 3, 1, 8),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (273, 4, 1 << 28, 8),
        (277, 3, 1, 1),
        (278, 3, 1, 8),
        (279, 4, 1 << 28, 8),
    ];
    let mut file = b"II*\0\x08\0\0\0".to_vec();
    file.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        file.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
        file.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
    }
    file.resize(471, 0);
    file
}

#[test]
fn what_a_header_claims_is_not_made_room_for() {
    let desk = Desk::with_series();
    let size = quadrille::io::images::read_image(&desk.path("ref.png"), 0).unwrap().image;
    desk.write("huge.png", hollow_png(30_000, 250_000));
    desk.write("endless.tif", endless_tiff());
    // 4 GB of address space: what these claim would need 5 and 8 GB.
    let ran =
        shell(&desk, "ulimit -v 4000000; exec $Q correlate --output run ref.png a.png huge.png endless.tif b.png");
    assert_eq!(ran.status.code(), Some(1), "{}", said(&ran));
    let frames = desk.json("run/summary.json")["frames"].as_array().unwrap().clone();
    let statuses: Vec<_> = frames.iter().map(|frame| frame["status"].as_str().unwrap()).collect();
    assert_eq!(statuses, ["converged", "unreadable", "unreadable", "converged"], "{}", said(&ran));
    let text = said(&ran);
    let wanted =
        format!("huge.png: the image is 30000 x 30000 px, the reference {} x {} px", size.width(), size.height());
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(words(&text).contains(&wanted), "{text}");
}

#[test]
fn how_large_an_image_may_be_is_asked_for() {
    let desk = Desk::new();
    desk.image("ref.png", &moved([0.0; 2]));
    desk.write("huge.png", hollow_png(40_000, 250_000));
    desk.correlate("--output run --reference huge.png ref.png").refused(&["40000 x 40000 px", "--max-image-mpx"]);
    desk.correlate("--output run --max-image-mpx 0 --reference ref.png ref.png").refused(&["give 1 to 2147"]);
    // Allowed, it is found out to be empty, or to be too large for this machine; nothing aborts.
    let ran = shell(
        &desk,
        "ulimit -v 4000000; exec $Q correlate --output run --max-image-mpx 2000 --reference huge.png ref.png",
    );
    assert_eq!(ran.status.code(), Some(2), "{}", said(&ran));
    assert!(said(&ran).contains("GB of memory"), "{}", said(&ran));
}

#[test]
fn names_cannot_put_lines_into_scripts_and_tables() {
    let desk = Desk::with_series();
    let case = "[images]\nreference = \"ref.png\"\ndeformed = [\"a.png\"]\n";
    desk.write("case.toml", case);
    desk.write("two\nlines.toml", case);
    desk.run_words(&["slurm", "two\nlines.toml", "--output", "run", "--array", "2"])
        .refused(&["two\\nlines", "rename"]);
    for (flag, wrong) in [("--partition", "a b"), ("--account", "x\n#SBATCH --mem=0"), ("--sbatch", "qos=long")] {
        desk.run_words(&["slurm", "case.toml", "--output", "run", "--array", "2", flag, wrong]).refused(&[flag]);
    }
    desk.write("site.sh", "module load mesa\n");
    let line =
        "slurm case.toml --output run --array 2 --sbatch=--qos=long --sbatch=--constraint=avx512 --prologue site.sh";
    desk.run(line).printed();
    for script in ["case-array.sbatch", "case-check.sbatch"] {
        let script = desk.read(script);
        assert!(script.contains("\n#SBATCH --qos=long\n#SBATCH --constraint=avx512\n"), "{script}");
        let prologue = script.find("module load mesa").unwrap();
        assert!(prologue < script.find("correlate --case").or(script.find(" status ")).unwrap(), "{script}");
        let mut bash = Command::new("bash").args(["-n"]).stdin(Stdio::piped()).spawn().unwrap();
        bash.stdin.take().unwrap().write_all(script.as_bytes()).unwrap();
        assert!(bash.wait().unwrap().success(), "{script}");
    }
    desk.write("names.toml", "[images]\nreference = \"ref.png\"\ndeformed = [\"a.png\"]\n[[zone]]\nname = \"a\\nb\"\nroi = [16, 16, 64, 64]\n");
    desk.correlate("--output run --case names.toml").refused(&["control character"]);
}

#[test]
fn memory_that_ends_is_an_error_and_no_crash() {
    let desk = Desk::with_series();
    // At each limit it is another piece that does not fit.
    let mut kib = 420_000.0;
    while kib > 90_000.0 {
        let line =
            format!("ulimit -v {kib:.0}; exec $Q correlate --threads 1 --output run{kib:.0} ref.png a.png b.png c.png");
        let ran = shell(&desk, &line);
        assert!(matches!(ran.status.code(), Some(0..=2)), "{kib:.0} KiB: {:?}: {}", ran.status, said(&ran));
        // Rust's own start of a thread may find no room for the stack of its signals: nothing of the program has run in
        // that thread yet.
        let panics = |line: &&str| line.contains("panicked") && !line.contains("sys/pal/unix/stack_overflow.rs");
        assert_eq!(said(&ran).lines().find(panics), None, "{kib:.0} KiB: {}", said(&ran));
        kib *= 0.85;
    }
}

#[test]
fn a_mask_of_another_size_is_refused_before_it_is_unpacked() {
    let desk = Desk::with_series();
    desk.write("huge.png", hollow_png(30_000, 250_000));
    desk.correlate("--output run --reference ref.png --mask huge.png a.png")
        .refused(&["the mask is 30000 x 30000 px, the reference image 128 x 96 px"]);
}

/// A library that writes down how the memory of a process is mapped when it ends.
const MAPS: &str = r#"
#include <stdio.h>
#include <stdlib.h>
__attribute__((destructor)) static void end(void) {
    FILE *from = fopen("/proc/self/smaps", "r"), *to = fopen(getenv("QUADRILLE_TEST_MAPS"), "w");
    for (int c; from && to && (c = fgetc(from)) != EOF;) fputc(c, to);
    if (to) fclose(to);
}
"#;

#[test]
fn memory_is_asked_for_in_large_pages() {
    if !Path::new("/sys/kernel/mm/transparent_hugepage").exists() {
        eprintln!("not tested: this kernel has no large pages");
        return;
    }
    let desk = Desk::new();
    desk.run("make images translation --size 768x768 --frames 1 --output s").fine();
    desk.write("maps.c", MAPS);
    let library = compiled(&desk, &desk.path("maps.c"));
    let line = "correlate --device cpu --threads 2 --export none --no-report --output run s/000000.tif s/000001.tif";
    let environment = [("LD_PRELOAD", library.as_str()), ("QUADRILLE_TEST_MAPS", "maps")];
    desk.run_with(&environment, &line.split_whitespace().collect::<Vec<_>>()).fine();
    // What is the process's own, kB, all in all and where large pages were asked for.
    let (mut all, mut asked, mut here) = (0, 0, 0);
    for line in desk.read("maps").lines() {
        if let Some(kilobytes) = line.strip_prefix("Anonymous:") {
            here = kilobytes.trim().trim_end_matches(" kB").parse().unwrap();
        } else if let Some(flags) = line.strip_prefix("VmFlags:") {
            all += here;
            asked += if flags.split_whitespace().any(|flag| flag == "hg") { here } else { 0 };
        }
    }
    // What is left are stacks, and what the program and its libraries begin with.
    assert!(all > 20_000 && all - asked < 5_000, "{asked} of {all} kB");
}

#[test]
fn a_joint_of_more_squares_than_anybody_solves_is_refused_and_asks_for_no_memory() {
    let desk = Desk::new();
    let sizes = |n: &str| format!("[mesh]\nelement_size_mm = 1\ncolumns = {n}\nrows = {n}\ngap_mm = 0.1\n");
    let rest = "[groups]\nwall = \"y = min\"\n[[support]]\ngroup = \"wall\"\nu_x_mm = 0.0\nu_y_mm = 0.0\n[substrate]\n\
                model = \"linear-elastic\"\nE_MPa = 7e4\nnu = 0.3\n[cohesive]\nphi_n_N_per_mm = 1.0\ndelta_n_mm = 0.005\n\
                delta_t_mm = 0.05\nr = 4.0\n";
    for n in ["100000", "9000000000000000000"] {
        desk.write("case.toml", sizes(n) + rest);
        desk.run("simulate case.toml --output run").refused(&["at most 16 million nodes"]);
    }
}

fn full_disk(desk: &Desk) -> String {
    compiled(desk, &Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/full_disk.c"))
}

/// A disk that takes no more at some of the writes of `line`, which writes into disk/out, and then has room again: an
/// error that says so, and the same results as ever. `scripts/soak.py` has every write.
#[track_caller]
fn full_at_some(desk: &Desk, line: &str, n_moments: usize) {
    let library = full_disk(desk);
    let run = |more: &[(&str, &str)]| {
        let environment = [&[("LD_PRELOAD", library.as_str()), ("QUADRILLE_TEST_COUNT", "count")], more].concat();
        desk.run_with(&environment, &line.split_whitespace().collect::<Vec<_>>())
    };
    run(&[]).fine();
    let whole = results(desk, "disk/out");
    let n: usize = desk.read("count").trim().parse().unwrap();
    assert!(n > 50, "{n} writes: are they seen?");
    for moment in 0..n_moments {
        // The last one too.
        let at = (n - moment * n / n_moments).to_string();
        fs::remove_dir_all(desk.path("disk/out")).unwrap();
        let once: &[(&str, &str)] = &[("QUADRILLE_TEST_FULL_AT", &at), ("QUADRILLE_TEST_ONCE", "1")];
        let ran = run(if moment % 2 == 0 { &once[..1] } else { once });
        assert!(matches!(ran.code, Some(1 | 2)) && ran.stderr.contains("No space left"), "write {at} of {n}: {ran}");
        run(&[]).fine();
        assert_same(&whole, &results(desk, "disk/out"), &format!("write {at} of {n}"));
    }
}

#[test]
fn a_disk_that_is_full_at_any_write_is_told_and_gone_on_from() {
    let desk = Desk::with_series();
    fs::create_dir(desk.path("disk")).unwrap();
    full_at_some(&desk, "correlate --quiet --output disk/out --reference ref.png a.png b.png c.png", 20);
}

#[test]
fn what_a_start_left_out_of_the_store_is_made_by_the_next() {
    let desk = Desk::with_series();
    let line = "correlate --output run --reference ref.png a.png b.png";
    desk.run(line).fine();
    let whole = results(&desk, "run");
    fs::remove_dir_all(desk.path("run/fields.zarr/gradient_noise")).unwrap();
    desk.run(line).fine();
    assert_same(&whole, &results(&desk, "run"), "without the noise of the gradient");
}

#[test]
fn a_frame_that_a_machine_lost_is_found_although_its_clock_went_back() {
    let desk = Desk::with_series();
    let line = "correlate --output run --reference ref.png a.png b.png c.png";
    desk.run(line).fine();
    let whole = results(&desk, "run");
    // Done before the clock went back by a day; the last frame after it, and its blocks never reached the disk.
    let ahead = std::time::SystemTime::now() + std::time::Duration::from_secs(86_400);
    for number in 0..2 {
        let file =
            fs::File::options().write(true).open(desk.path(&format!("run/fields.zarr/status/c.{number}"))).unwrap();
        file.set_modified(ahead).unwrap();
    }
    let lost = desk.path("run/fields.zarr/displacement_px/c.2.0.0");
    fs::write(&lost, vec![0; fs::metadata(&lost).unwrap().len() as usize]).unwrap();
    let ran = desk.run(line).fine();
    assert!(ran.stderr.contains("incomplete and will be recomputed: 3"), "{ran}");
    assert_same(&whole, &results(&desk, "run"), "after a lost frame");
}

#[test]
fn a_folder_that_vanishes_or_may_not_be_written_to_ends_a_run_with_a_word() {
    let desk = Desk::with_series();
    for k in 0..300 {
        fs::hard_link(desk.path(["a.png", "b.png"][k % 2]), desk.path(&format!("many_{k:03}.png"))).unwrap();
    }
    let child = start(&desk, "correlate --export none --threads 1 --output gone --reference ref.png many_*.png");
    wait_for_frames(&desk, "gone", 3);
    // What is written meanwhile may come back into it.
    while fs::remove_dir_all(desk.path("gone")).is_err() {}
    let (code, said) = end(child);
    assert!(matches!(code, Some(0..=2)) && !said.contains("panicked"), "{code:?} {said}");
    let there = desk.path("gone/summary.json").exists();
    assert!(code == Some(2) || there, "{code:?} without results: {said}");
    // Nobody may write into /proc, not even root.
    let ran = desk.run("correlate --output /proc/out --reference ref.png a.png");
    assert_eq!(ran.code, Some(2), "{ran}");
    assert!(ran.stderr.contains("/proc/out"), "{ran}");
}

#[test]
fn frames_that_a_camera_dropped_doubled_swapped_or_tore_are_named_and_pull_no_other() {
    let desk = Desk::new();
    let at = |k: f64| moved([0.8 * k, -0.5 * k]);
    desk.image("s/t_00.png", &at(0.0));
    let torn = |above: &Image, below: Option<&Image>| {
        let grey = |k: usize| match (k / WIDTH < HEIGHT / 2, below) {
            (true, _) => above.grey(k % WIDTH, k / WIDTH) as u8,
            (false, Some(below)) => below.grey(k % WIDTH, k / WIDTH) as u8,
            (false, None) => 0,
        };
        Image::new(WIDTH, HEIGHT, Pixels::U8((0..WIDTH * HEIGHT).map(grey).collect())).unwrap()
    };
    for k in 1..=14 {
        let name = format!("s/t_{k:02}.png");
        match k {
            4 => continue,                                                         // dropped
            6 => desk.write(&name, desk.bytes("s/t_05.png")),                      // doubled
            8 => desk.image(&name, &at(11.0)),                                     // swapped with
            11 => desk.image(&name, &at(8.0)),                                     // each other
            9 => desk.image(&name, &torn(&at(9.0), None)),                         // half black
            10 => desk.image(&name, &torn(&at(10.0), Some(&moved([40.0, 30.0])))), // torn
            12 => desk.write(&name, "not whole"),
            _ => desk.image(&name, &at(f64::from(k))),
        }
    }
    let ran = desk.correlate("--output run --roi 16,16,104,80 --element-size 8 --reference s/t_00.png s/t_*.png");
    assert_eq!(ran.code, Some(1), "{ran}");
    let summary = desk.json("run/summary.json");
    let missing = &remarks(&summary, Code::FramesMissing)[0];
    assert_eq!((missing.number("missing"), &missing.values["first_after"]), (Some(1.0), &"s/t_03.png".into()));
    assert_eq!(remarks(&summary, Code::FramesCopied)[0].about, About::Frames(vec![4, 5]));
    assert_eq!(remarks(&summary, Code::ImageIncomplete).len(), 1, "{summary:#}");
    for frame in summary["frames"].as_array().unwrap() {
        let file = frame["file"].as_str().unwrap();
        let k: f64 = file[4..6].parse().unwrap();
        match k as u32 {
            12 => assert_eq!(frame["status"], "unreadable"),
            9 | 10 => (), // what is left of them may be measured or not
            _ => {
                let place = match k as u32 {
                    6 => 5.0,
                    8 => 11.0,
                    11 => 8.0,
                    _ => k,
                };
                assert_eq!(frame["status"], "converged", "{file}: {ran}");
                let moved = frame["rigid_motion"]["translation_px"].as_array().unwrap();
                // A frame beside a lost one is as right as any: noise of 8 bits over some thousand pixels.
                for (component, wanted) in moved.iter().zip([0.8 * place, -0.5 * place]) {
                    assert!((component.as_f64().unwrap() - wanted).abs() < 0.02, "{file}: {moved:?}");
                }
            }
        }
    }
}

/// The 8-bit image `name` with the time of the page as a TIFF file, written by another program than this one's.
fn stamped_tiff(desk: &Desk, name: &str, image: &Image, time: &str) {
    let grey: Vec<u8> = (0..WIDTH * HEIGHT).map(|k| image.grey(k % WIDTH, k / WIDTH) as u8).collect();
    let mut file = TiffEncoder::new(fs::File::create(desk.path(name)).unwrap()).unwrap();
    let mut page = file.new_image::<Gray8>(WIDTH as u32, HEIGHT as u32).unwrap();
    page.encoder().write_tag(Tag::DateTime, time).unwrap();
    page.write_data(&grey).unwrap();
}

#[test]
fn frames_whose_files_say_that_they_were_taken_at_another_time_are_named() {
    let desk = Desk::new();
    fs::create_dir(desk.path("s")).unwrap();
    // The motion is that of the times.
    for k in 0..7 {
        let second = if k == 4 { 2 } else { 2 * k };
        let image = moved([0.3 * f64::from(second), 0.0]);
        stamped_tiff(&desk, &format!("s/t_{k}.tif"), &image, &format!("2024:05:01 10:11:{second:02}"));
    }
    let line = "correlate --export none --element-size 8 --reference s/t_0.tif s/t_*.tif --output run";
    desk.run(line).fine();
    let summary = desk.json("run/summary.json");
    let said = &remarks(&summary, Code::TimesOutOfOrder)[0];
    assert_eq!((&said.about, &said.values["first_taken"]), (&About::Frames(vec![4]), &"2024-05-01T10:11:02".into()));
    assert!(said.text.contains("and frame 3, which stands before it, at 2024-05-01T10:11:06"), "{said:?}");
    assert_eq!(summary["frames"][5]["taken"], "2024-05-01T10:11:12");
    // Times that the motion contradicts are those of a conversion.
    stamped_tiff(&desk, "s/t_4.tif", &moved([0.3 * 8.0, 0.0]), "2024:05:01 10:11:02");
    desk.run(&format!("{line} --overwrite")).fine();
    assert_eq!(desk.remarks("run", Code::TimesOutOfOrder), []);
    // In the order of its times nothing is said; nor of files that have none.
    fs::remove_file(desk.path("s/t_4.tif")).unwrap();
    desk.run(&format!("{line} --overwrite")).fine();
    assert_eq!(desk.remarks("run", Code::TimesOutOfOrder), []);
    // A camera of the same day, and of a month before.
    desk.run("calibrate s/t_0.tif --length 10,10,60,10,5 --output cal").printed();
    let camera = desk.read("cal/camera.toml");
    assert!(camera.contains("taken = \"2024-05-01T10:11:00\""), "{camera}");
    let others = |camera: &str| {
        desk.write("camera.toml", camera);
        desk.run(&format!("{line} --camera camera.toml --overwrite")).fine();
        desk.remarks("run", Code::CameraOtherDay)
    };
    assert_eq!(others(&camera), []);
    let before = others(&camera.replace("2024-05-01", "2024-04-01"));
    assert!(before.len() == 1 && before[0].text.contains("30 days after"), "{before:?}");
}

#[test]
fn shells_and_man_are_told_of_every_command() {
    let desk = Desk::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let text = desk.run(&format!("about completions {shell}")).printed();
        for there in ["correlate", "max-image-mpx", "tournament"] {
            assert!(text.contains(there), "{shell}: {there}");
        }
    }
    desk.run("about manual --output man");
    let page = String::from_utf8(desk.bytes("man/quadrille-correlate.1")).unwrap();
    assert!(page.starts_with(".ie") && page.contains("reference"), "{page}");
    let whole = String::from_utf8(desk.bytes("man/quadrille.1")).unwrap();
    for page in desk.all_files("man").iter().filter(|name| name.len() > "quadrille.1".len()) {
        let command = page.trim_start_matches("quadrille-").trim_end_matches(".1").split('-').next().unwrap();
        assert!(whole.contains(command), "{command}");
    }
    assert!(desk.read("man/quadrille-make-images.1").contains("wavelength"));
}

#[test]
fn the_licences_of_others_are_in_the_program() {
    let desk = Desk::new();
    for word in ["licences", "licenses"] {
        let text = desk.run(&format!("about {word}")).printed();
        for there in [
            "zarrs 0.",
            "Permission is hereby granted, free of charge",
            "Bitstream Vera",
            "Redistributions in binary form",
        ] {
            assert!(text.contains(there), "{there}");
        }
    }
}
