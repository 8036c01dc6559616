//! What the program meets on shared machines and in files that others made: nobody listens, sockets and locks of others, names of
//! any bytes, headers that claim more than there is. Each of these ended a run, or hung it, before.

#![cfg(all(feature = "cli", target_os = "linux"))]

use crate::program::{Desk, moved};
use std::fs;
use std::io::Write;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

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
    let lost = shell(&desk, "exec $Q schema >/dev/full");
    assert!(matches!(lost.status.code(), Some(1 | 2)), "{:?}", lost.status);
    assert!(said(&lost).contains("No space left"), "{}", said(&lost));
    let enough = shell(&desk, "set -o pipefail; $Q devices | true; $Q devices --json | head -c 1 >/dev/null");
    assert!(!said(&enough).contains("panicked") && enough.status.code() == Some(0), "{}", said(&enough));
}

#[test]
fn no_socket_in_a_folder_of_everybody_is_spoken_to() {
    let desk = Desk::new();
    let listener = std::os::unix::net::UnixListener::bind(desk.path("wayland-0")).unwrap();
    listener.set_nonblocking(true).unwrap();
    let output = Command::new(PROGRAM)
        .arg("devices")
        .env_remove("XDG_RUNTIME_DIR")
        .env("TMPDIR", desk.path(""))
        .env("WAYLAND_DISPLAY", "wayland-0")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(listener.accept().is_err(), "somebody's socket was asked");
    assert!(!said(&output).contains("XDG_RUNTIME_DIR"), "{}", said(&output));
}

/// A library that makes `flock` what it is on NFS: exclusive locks of files that are open for reading alone are refused (`EBADF`);
/// with `QUADRILLE_TEST_NO_LOCKS` every lock is (`ENOLCK`, as without a lock service).
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

/// Compiles it with the C compiler that every Rust toolchain links with.
fn nfs(desk: &Desk) -> String {
    desk.write("nfs.c", NFS);
    let library = desk.path("nfs.so");
    let source = desk.path("nfs.c");
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
