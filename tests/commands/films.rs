//! Frames that lie in one file: stacks larger than the memory, and videos, each a frame as a page of a stack.

#![cfg(feature = "cli")]

use crate::program;
use program::process::{end, start};
use program::{Desk, HEIGHT, INSIDE, WIDTH, assert_moved, moved};
use quadrille::imaging::{Image, Levels};
use quadrille::io::images::{Accepted, PagedFile, ReadError};
use quadrille::synth::Translation;
use std::fs;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::time::Duration;

/// Largest error of a node on 8 bit images; see tests/commands/cli.rs.
const ROUNDED: f64 = 0.02;
/// The size of the frames, 4 bytes each.
const SIZE: [[u8; 4]; 2] = [(WIDTH as u32).to_le_bytes(), (HEIGHT as u32).to_le_bytes()];

/// Bytes ahead of the pixels of a page.
const HEAD: u64 = 256;

/// The frames of the films: each moved by a quarter of a pixel more.
fn frames() -> Vec<Vec<u8>> {
    (0..4).map(|k| bytes_of(&moved([0.25 * f64::from(k), 0.0]))).collect()
}

fn bytes_of(image: &Image) -> Vec<u8> {
    match image.pixels() {
        Levels::U8(levels) => levels.to_vec(),
        other => panic!("{other:?}"),
    }
}

/// A BigTIFF file of pages that lie `gap` bytes apart, in a file of `len` bytes that are nowhere on the disk.
fn write_stack(path: &Path, frames: &[Vec<u8>], gap: u64, len: u64) {
    let mut file = fs::File::create(path).unwrap();
    file.write_all(b"II+\0\x08\0\0\0\x10\0\0\0\0\0\0\0").unwrap();
    for (at, frame) in (0..).map(|k| 16 + k * gap).zip(frames) {
        let entries = [
            (256, WIDTH as u64),
            (257, HEIGHT as u64),
            (258, 8),
            (259, 1),
            (262, 1),
            (273, at + HEAD),
            (278, HEIGHT as u64),
            (279, frame.len() as u64),
        ];
        let mut page = (entries.len() as u64).to_le_bytes().to_vec();
        for (tag, value) in entries {
            // A number of 64 bits, one of it.
            page.extend([&u16::to_le_bytes(tag)[..], &[16, 0, 1, 0, 0, 0, 0, 0, 0, 0], &value.to_le_bytes()].concat());
        }
        let is_last = at == 16 + (frames.len() as u64 - 1) * gap;
        page.extend(if is_last { 0 } else { at + gap }.to_le_bytes());
        page.resize(HEAD as usize, 0);
        file.seek(SeekFrom::Start(at)).unwrap();
        file.write_all(&page).unwrap();
        file.write_all(frame).unwrap();
    }
    file.set_len(len).unwrap();
}

#[test]
#[cfg(target_os = "linux")]
fn a_stack_of_sixty_gigabytes_is_measured_in_less_than_two_hundred_megabytes() {
    let desk = Desk::new();
    write_stack(&desk.path("stack.tif"), &frames(), 20 << 30, (60 << 30) + (1 << 20));
    let mut child = start(&desk, &format!("correlate {INSIDE} --threads 2 --output out stack.tif"));
    let mut most_kib = 0;
    while child.try_wait().unwrap().is_none() {
        let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let peak =
            status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse().ok());
        most_kib = most_kib.max(peak.unwrap_or(0));
        std::thread::sleep(Duration::from_millis(1));
    }
    let (code, said) = end(child);
    assert_eq!(code, Some(0), "{said}");
    println!("{most_kib} KiB");
    assert!((1..200_000).contains(&most_kib), "{most_kib} KiB");
    assert_moved(&desk.rows("out/csv/000003.csv"), &Translation([0.75, 0.0]), ROUNDED);
    assert_eq!(desk.json("out/summary.json")["frames"][2]["file"], "stack.tif[3]");
    // The grey levels of a frame are what names its content.
    let mut stack = PagedFile::open(&desk.path("stack.tif")).unwrap();
    let sha256 = stack.read(3, Accepted::default()).unwrap().sha256;
    assert_eq!(sha256, quadrille::io::images::sha256(&frames()[3]));
    assert!(desk.read("out/run.toml").contains(&stack.sha256(0).unwrap()));
}

#[test]
fn a_large_stack_that_ends_early_loses_its_last_page_and_no_other() {
    let desk = Desk::new();
    write_stack(&desk.path("stack.tif"), &frames()[..3], 40 << 20, (80 << 20) + 2000);
    let ran = desk.correlate(&format!("{INSIDE} --output out stack.tif")).incomplete();
    assert_eq!(ran.statuses("out"), ["converged", "unreadable"]);
    assert!(ran.stderr.contains("the TIFF file is cut off: the pixel data end early"), "{ran}");
}

#[test]
fn a_large_stack_under_one_directory_is_read_image_by_image_or_refused_as_cut_off() {
    let (desk, frames) = (Desk::new(), frames());
    let open = |images: u64| {
        let path = desk.path("one.tif");
        write_stack(&path, &frames[..1], 0, 70 << 20);
        let mut file = fs::OpenOptions::new().write(true).open(&path).unwrap();
        let mut put = |at: u64, data: &[u8]| {
            file.seek(SeekFrom::Start(at)).unwrap();
            file.write_all(data).unwrap();
        };
        // The description takes the place of the rows of a strip, which are all.
        let text = format!("ImageJ=1.54f\nimages={images}\n");
        put(24 + 6 * 20, &[&[14, 1, 2, 0], &(text.len() as u64).to_le_bytes()[..], &208_u64.to_le_bytes()].concat());
        put(208, text.as_bytes());
        put(16 + HEAD + 5000 * frames[1].len() as u64, &frames[1]);
        PagedFile::open(&path)
    };
    let mut stack = open(5001).unwrap();
    assert_eq!(stack.images().unwrap().len(), 5001);
    for (page, frame) in [(5000, &frames[1]), (0, &frames[0])] {
        assert_eq!(&bytes_of(&stack.read(page, Accepted::default()).unwrap().image), frame);
    }
    let error = open(9000).unwrap_err();
    assert!(
        matches!(error, ReadError::Truncated(..)) && error.to_string().contains("9000 images, and holds"),
        "{error}"
    );
}

/// A chunk of an AVI file.
fn chunk(name: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let mut chunk = [&name[..], &(data.len() as u32).to_le_bytes(), data].concat();
    chunk.resize(chunk.len().next_multiple_of(2), 0);
    chunk
}

/// An AVI file of 500 frames per second.
fn avi(packed: &[u8; 4], bits: u8, height: [u8; 4], frames: &[Vec<u8>]) -> Vec<u8> {
    let mut main = vec![0; 56];
    main[16..20].copy_from_slice(&(frames.len() as u32).to_le_bytes());
    let sound = [&b"auds"[..], &[0; 52]].concat();
    let stream = [&b"vids"[..], &[0; 16], &2_u32.to_le_bytes(), &1000_u32.to_le_bytes(), &[0; 28]].concat();
    let bitmap = [&[40, 0, 0, 0], &SIZE[0][..], &height, &[1, 0, bits, 0], packed, &[0; 20]].concat();
    let list = |name: &[u8; 4], data: &[Vec<u8>]| chunk(b"LIST", &[&name[..], &data.concat()].concat());
    let streams = [(&sound, vec![0; 16]), (&stream, bitmap)];
    let streams = streams.map(|(head, format)| list(b"strl", &[chunk(b"strh", head), chunk(b"strf", &format)]));
    let head = list(b"hdrl", &[vec![chunk(b"avih", &main)], streams.to_vec()].concat());
    let sounds = chunk(b"00wb", &[1; 7]);
    let movie: Vec<_> = frames.iter().flat_map(|frame| [sounds.clone(), chunk(b"01db", frame)]).collect();
    chunk(b"RIFF", &[&b"AVI "[..], &head, &list(b"movi", &movie)].concat())
}

/// A film of a Phantom camera of 8 bits, rows from the bottom.
fn cine(frames: &[Vec<u8>]) -> Vec<u8> {
    let n = (frames.len() as u32).to_le_bytes();
    let (bitmap, settings, places) = (44_usize, 84_usize, 84 + 0x163c_usize);
    let mut file = [&b"CI\x2c\0\0\0\x01\0"[..], &[0; 12], &n].concat();
    [bitmap, settings, places].iter().for_each(|place| file.extend((*place as u32).to_le_bytes()));
    file.resize(bitmap, 0);
    file.extend([&[40, 0, 0, 0], &SIZE[0][..], &SIZE[1], &[1, 0, 8, 0], &[0; 24]].concat());
    file.resize(places, 0);
    file[settings + 768..][..4].copy_from_slice(&1000_u32.to_le_bytes());
    let first = places + 8 * frames.len();
    (0..frames.len()).for_each(|k| file.extend(((first + k * (8 + WIDTH * HEIGHT)) as u64).to_le_bytes()));
    for frame in frames {
        file.extend([8_u32, frame.len() as u32].iter().flat_map(|n| n.to_le_bytes()));
        file.extend(upside_down(frame, 1));
    }
    file
}

/// The rows of a frame from the bottom.
fn upside_down(frame: &[u8], bytes: usize) -> Vec<u8> {
    frame.chunks(bytes * WIDTH).rev().flatten().copied().collect()
}

#[test]
fn films_of_cameras_and_uncompressed_videos_hold_the_pixels_of_their_frames() {
    let (desk, frames) = (Desk::new(), frames());
    let each = |of: &dyn Fn(&Vec<u8>) -> Vec<u8>| frames.iter().map(of).collect::<Vec<_>>();
    let colours = each(&|frame| upside_down(&frame.iter().flat_map(|&v| [v, v, v]).collect::<Vec<_>>(), 3));
    desk.write("grey.avi", avi(&[0; 4], 8, SIZE[1], &each(&|frame| upside_down(frame, 1))));
    desk.write("top.avi", avi(b"Y800", 8, SIZE[1], &frames));
    desk.write("colours.avi", avi(&[0; 4], 24, SIZE[1], &colours));
    desk.write("shot.cine", cine(&frames));
    let about = |bits: u8| {
        format!(
            "#Camera Information Header\r\nDate : 2026/11/29\r\nRecord Rate(fps) : 2000\r\nTotal Frame : 4\r\n\
             Image Width : {WIDTH}\r\nImage Height : {HEIGHT}\r\nColor Type : Mono\r\nColor Bit : {bits}\r\n\
             EffectiveBit Depth : 12\r\nEffectiveBit Side : Lower\r\n"
        )
    };
    desk.write("a.cih", about(8));
    desk.write("a.mraw", frames.concat());
    // Two numbers of 12 bits in three bytes, the first bits first.
    let packed = each(&|frame| frame.chunks(2).flat_map(|v| [v[0], v[1] >> 4, v[1] << 4]).collect());
    let packed: Vec<u8> = packed.concat().chunks(3).flat_map(|v| [v[0], v[1], v[2]]).collect();
    desk.write("b.mraw", packed);
    desk.write("b.cihx", format!(
        "\x01\x02<cih><frameInfo><totalFrame>4</totalFrame></frameInfo><recordInfo><recordRate>2000</recordRate></recordInfo>\
         <imageDataInfo><resolution><width>{WIDTH}</width><height>{HEIGHT}</height></resolution><colorInfo><type>Mono</type>\
         <bit>12</bit></colorInfo><effectiveBit><depth>12</depth><side>Lower</side></effectiveBit></imageDataInfo></cih>"
    ));
    for (name, rate) in [
        ("grey.avi", 500.0),
        ("top.avi", 500.0),
        ("colours.avi", 500.0),
        ("shot.cine", 1000.0),
        ("a.mraw", 2000.0),
        ("a.cih", 2000.0),
        ("b.mraw", 2000.0),
        ("b.cihx", 2000.0),
    ] {
        let mut film = PagedFile::open(&desk.path(name)).unwrap();
        assert_eq!(film.images().unwrap(), [0, 1, 2, 3], "{name}");
        for page in [3, 0, 2] {
            let loaded = film.read(page, Accepted::default()).unwrap();
            assert_eq!(loaded.time_s, Some(page as f64 / rate), "{name}");
            match loaded.image.pixels() {
                Levels::U8(levels) => assert!(levels == frames[page], "{name} {page}"),
                Levels::U16(levels) => {
                    assert!(levels.iter().zip(&frames[page]).all(|(&v, &w)| v == 16 * u16::from(w)), "{name} {page}");
                    assert_eq!(loaded.white, 4095.0);
                }
                Levels::F32(_) => panic!("{name}"),
            }
        }
        assert!(matches!(film.read(4, Accepted::default()), Err(ReadError::NoSuchPage { pages: 4, .. })), "{name}");
        let other = film.read(0, Accepted::default().of_size(64, 64)).unwrap_err();
        assert!(matches!(other, ReadError::OtherSize { .. }), "{other}");
        // Cut off anywhere it is no film with fewer frames.
        let whole = desk.bytes(name);
        if whole.len() > 4000 {
            fs::write(desk.path(&format!("cut-{name}")), &whole[..whole.len() - 100]).unwrap();
            for about in ["a.cih", "b.cihx"] {
                fs::copy(desk.path(about), desk.path(&format!("cut-{about}"))).unwrap();
            }
            let error = PagedFile::open(&desk.path(&format!("cut-{name}"))).unwrap_err();
            assert!(matches!(error, ReadError::Truncated(..)), "{name}: {error}");
        }
    }
    desk.write("c.cih", about(8));
    let error = PagedFile::open(&desk.path("c.cih")).unwrap_err().to_string();
    assert!(error.contains("the film that it describes is not beside it") && error.contains("c.mraw"), "{error}");
}

#[test]
fn a_video_is_a_series_of_frames_with_their_times() {
    let (desk, frames) = (Desk::new(), frames());
    let mut packed = Vec::new();
    for frame in &frames {
        let mut jpeg = Vec::new();
        let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 98);
        encoder.encode(frame, WIDTH as u32, HEIGHT as u32, image::ExtendedColorType::L8).unwrap();
        packed.push(jpeg);
    }
    packed.insert(2, Vec::new()); // a frame that was dropped is the one before
    desk.write("shot.avi", avi(b"MJPG", 24, SIZE[1], &packed));
    let ran = desk.correlate(&format!("{INSIDE} --output out shot.avi")).fine();
    assert_moved(&desk.rows("out/csv/000002.csv"), &Translation([0.25, 0.0]), 2.0 * ROUNDED);
    assert_moved(&desk.rows("out/csv/000004.csv"), &Translation([0.75, 0.0]), 2.0 * ROUNDED);
    let last = &ran.frames("out")[3];
    assert_eq!((&last["file"], &last["time_s"]), (&"shot.avi[4]".into(), &0.008.into()));
    // The same again goes on where it was; beside one image the video is what is measured.
    desk.correlate(&format!("{INSIDE} --output out shot.avi")).fine();
    desk.image("zero.png", &moved([0.0, 0.0]));
    desk.correlate(&format!("{INSIDE} --output two zero.png shot.avi")).fine();
    assert_moved(&desk.rows("two/csv/000005.csv"), &Translation([0.75, 0.0]), 2.0 * ROUNDED);
}

#[test]
#[cfg(unix)]
fn other_videos_come_from_ffmpeg_or_it_is_named() {
    use std::os::unix::fs::PermissionsExt;
    let (desk, frames) = (Desk::new(), frames());
    desk.write("shot.mp4", [&b"\0\0\0\x20ftypisom"[..], &[0; 100]].concat());
    let line = format!("correlate {INSIDE} --threads 2 --output out shot.mp4");
    let words: Vec<&str> = line.split_whitespace().collect();
    let nothing = desk.path("nothing").display().to_string();
    let ran = desk.run_with(&[("PATH", &nothing)], &words);
    ran.refused(&["this is a video (MP4 or MOV)", "ffmpeg is needed", "ffmpeg -i shot.mp4 -pix_fmt gray"]);
    // A program that does what ffmpeg does with ten frames per second, as far as it is asked.
    for (k, frame) in frames.iter().enumerate() {
        desk.write(&format!("{k}.pgm"), [format!("P5\n{WIDTH} {HEIGHT}\n255\n").as_bytes(), frame].concat());
    }
    let script = "#!/bin/sh\n\
         echo \"$@\" >> asked\n\
         case \"$*\" in\n\
         *framecrc*) echo 'ffmpeg version 9.0' >&2; echo '  Stream #0:0: Video: h264, yuv420p(tv), 128x96' >&2\n\
         echo '#tb 0: 1/10'; for k in 2 0 1 3; do echo \"0, $k, $k, 1, 100, 0x0\"; done;;\n\
         *'-ss 0.05'*) cat 1.pgm 2.pgm 3.pgm;;\n\
         *'-ss 0.15'*) cat 2.pgm 3.pgm;;\n\
         *-ss*) exit 1;;\n\
         *) cat 0.pgm 1.pgm 2.pgm 3.pgm;;\n\
         esac\n";
    fs::create_dir(desk.path("bin")).unwrap();
    desk.write("bin/ffmpeg", script);
    fs::set_permissions(desk.path("bin/ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", desk.path("bin").display(), std::env::var("PATH").unwrap());
    let ran = desk.run_with(&[("PATH", &path)], &words).fine();
    assert_moved(&desk.rows("out/csv/000003.csv"), &Translation([0.75, 0.0]), ROUNDED);
    assert_eq!(ran.frames("out")[2]["time_s"], 0.3);
    let asked = desk.read("asked");
    assert!(asked.contains("-i file:shot.mp4 -map 0:v:0") && asked.contains("-fps_mode passthrough"), "{asked}");
    // It stops within a frame, and it finds nothing.
    desk.write("3.pgm", "P5\n128 96\n255\nabc");
    let again: Vec<&str> = words.iter().copied().chain(["--overwrite"]).collect();
    let ran = desk.run_with(&[("PATH", &path)], &again).incomplete();
    assert!(ran.stderr.contains("what ffmpeg sends ends within a frame"), "{ran}");
    desk.write("bin/ffmpeg", "#!/bin/sh\necho 'moov atom not found' >&2\nexit 1\n");
    let ran = desk.run_with(&[("PATH", &path)], &again);
    ran.refused(&["no frame of it can be read: ffmpeg: moov atom not found"]);
}
