//! What the program says: a wrong word on the command line or in a case file is told with what to write instead, tables
//! fit a terminal, what wants a look comes first and has colour there, the short help is one screen.

#![cfg(feature = "cli")]

use crate::program;
use program::{Desk, INSIDE, moved};

/// Columns of a terminal that nobody has made wider.
const COLUMNS: usize = 80;
/// Lines of the short help of a command: one screen.
const SCREEN: usize = 45;

/// What the program says of `line` on its way to exit status 2.
#[track_caller]
fn refused(desk: &Desk, line: &str, wanted: &[&str]) {
    let ran = desk.run(line);
    assert_eq!(ran.code, Some(2), "{ran}");
    for wanted in wanted {
        assert!(ran.stderr.contains(wanted), "'{wanted}' is not said: {ran}");
    }
    for misleading in ["invalid digit", "invalid float", "expected `inf`", "non-zero type", "os error"] {
        assert!(!ran.stderr.contains(misleading), "'{misleading}': {ran}");
    }
}

#[test]
fn a_number_that_is_none_is_told_with_the_number_to_write() {
    let desk = Desk::with_series();
    let correlate = |rest: &str| format!("correlate --output out {rest} ref.png a.png");
    refused(&desk, &correlate("--element-size 16.5"), &["--element-size '16.5': give a whole number, such as 17"]);
    refused(&desk, &correlate("--pixel-size 0,05"), &["--pixel-size '0,05'", "decimal point, no comma: 0.05"]);
    refused(&desk, &correlate("--tolerance small"), &["--tolerance 'small': this is not a number"]);
    refused(&desk, &correlate("--roi 60 60 340 400"), &["as one word", "--roi 60,60,340,400"]);
    refused(&desk, &correlate("--roi 60, 60, 340, 400"), &["as one word", "--roi 60,60,340,400"]);
    refused(&desk, "probe out --point 10 20", &["--point 10,20"]);
    refused(&desk, "slurm case.toml --output out --array 0", &["--array '0': give 1 or more"]);
    refused(&desk, "slurm case.toml --output out --array 2 --time 4h", &["--time", "04:00:00", "minutes (240)"]);
    refused(&desk, "identify case.toml --output out --max-seconds -1", &["--max-seconds", "0.001 to a year"]);
    refused(&desk, "identify case.toml --output out --max-evaluations 0", &["--max-evaluations '0': give 1 or more"]);
}

#[test]
fn a_flag_of_one_letter_and_an_output_that_is_a_file_are_told_with_what_is_meant() {
    let desk = Desk::with_series();
    desk.run("correlate -o out --export none ref.png a.png").fine();
    assert!(desk.path("out/summary.json").exists(), "-o is --output");
    refused(&desk, "correlate -r ref.png a.png", &["there is no flag -r; did you mean --r"]);
    refused(&desk, "correlate -x out ref.png a.png", &["there is no flag -x"]);
    desk.write("notes", "something");
    refused(
        &desk,
        "correlate --output notes ref.png a.png",
        &["notes: cannot be written, it is a file", "a folder", "another --output folder"],
    );
    assert_eq!(desk.read("notes"), "something");
}

/// In whatever way a command is asked for by the name that it once had.
#[test]
fn a_command_that_has_another_name_now_is_told_with_it() {
    let desk = Desk::new();
    for (before, now) in [
        ("sweep", "identify --sweep"),
        ("tournament", "identify --tournament"),
        ("synth", "make images"),
        ("virtual", "make virtual-test"),
        ("specimen", "make specimen"),
        ("draw", "make page"),
        ("devices", "about devices"),
        ("schema", "about schema"),
        ("completions", "about completions"),
        ("manual", "about manual"),
        ("licences", "about licences"),
        ("licenses", "about licences"),
    ] {
        for line in [before.to_owned(), format!("{before} --help"), format!("help {before}")] {
            refused(&desk, &line, &[&format!("{before} is now `quadrille {now}`")]);
        }
        let words = now.split(" --").next().unwrap();
        assert!(desk.run(&format!("{words} --help")).stdout.contains(now.split(' ').next_back().unwrap()), "{now}");
    }
    for (before, now) in [("bench", "devices"), ("paper", "paper")] {
        refused(&desk, before, &[&format!("`cargo run --release -p quadrille-testbed -- {now}` in its sources")]);
    }
    refused(&desk, "sweeep", &["unrecognized subcommand 'sweeep'"]);
}

#[test]
fn a_case_file_that_is_no_toml_is_told_with_the_line_to_write() {
    let desk = Desk::with_series();
    let refuse = |text: &str, wanted: &[&str]| {
        desk.write("case.toml", text);
        refused(&desk, "correlate --case case.toml --output out", wanted);
    };
    refuse("[images]\npixel_size_mm = 0,05\n", &["case.toml, line 2", "no comma: pixel_size_mm = 0.05"]);
    refuse("[images]\ndeformed = imgs/*.tiff\n", &["line 2", "a text without quotes: write deformed = 'imgs/*.tiff'"]);
    refuse("[images]\ndeformed = *.tiff # all\n", &["line 2", "deformed = '*.tiff'"]);
    refuse("[zone]\nroi = [1, 2, 3, 4]\n", &["line 1", "write [[zone]] instead of [zone]"]);
    refuse(
        "[images]\ndeformed = '*.png'\n[interface]\nzones = ['lower']\n",
        &["line 4", "has 1 entry", "two names [\"lower\", \"upper\"]", "[[zone]]"],
    );
}

#[test]
fn what_takes_the_texture_away_is_named_and_a_text_among_the_images_is_left_out() {
    let desk = Desk::with_series();
    let correlate = |rest: &str| format!("correlate {INSIDE} --output out {rest} ref.png a.png");
    refused(&desk, &correlate("--noise 1000"), &["the noise is 1000", "less than the brightest"]);
    refused(&desk, &correlate("--noise 100"), &["follows from the noise given, 100 grey levels"]);
    refused(&desk, &correlate("--guard 30"), &["the guard of 30 px leaves no pixel of the elements of 16 px"]);
    desk.write("all/Notes.txt", "first of all");
    desk.image("all/a.png", &moved([0.0, 0.0]));
    desk.image("all/b.png", &moved([0.25, 0.0]));
    let ran = desk.run("correlate --output out all/*").fine();
    assert!(ran.stderr.contains("all/Notes.txt is not an image and is left out"), "{ran}");
    // One that was named is not guessed at.
    let ran = desk.run("correlate --output out --reference all/Notes.txt all/b.png");
    assert!(ran.code == Some(2) && !ran.stderr.contains("taken for"), "{ran}");
}

/// Asserts that no line of `text` is wider than a terminal; escapes of colour have no width.
#[track_caller]
fn fits(text: &str, what: &str) {
    for line in text.lines() {
        let plain = without_colour(line);
        let n = plain.chars().count();
        assert!(n <= COLUMNS, "{what}: {n} columns: {plain}");
    }
}

fn without_colour(text: &str) -> String {
    let mut parts = text.split('\x1b');
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |plain, part| plain + part.split_once('m').map_or("", |(_, rest)| rest))
}

/// The lines of the closing table of a series.
fn table(said: &str) -> Vec<&str> {
    let lines: Vec<&str> = said.lines().collect();
    let at = lines.iter().position(|line| line.starts_with("frame status")).expect("a table");
    let end = lines[at..].iter().position(|line| line.contains(" frames in ") || line.contains("misfit, most"));
    lines[at..at + end.expect("an end")].to_vec()
}

#[test]
fn tables_fit_a_terminal_and_frames_that_failed_come_first() {
    let desk = Desk::with_series();
    desk.write("bad.png", "no image");
    let ran = desk.correlate(&format!("{INSIDE} --output out ref.png a.png b.png bad.png c.png"));
    assert_eq!(ran.code, Some(1), "{ran}");
    let rows = table(&ran.stderr);
    fits(&rows.join("\n"), "correlate");
    let numbers: Vec<&str> = rows[2..].iter().map(|row| row.split_whitespace().next().unwrap()).collect();
    assert_eq!(numbers, ["3", "1", "2", "4"], "{ran}");
    assert!(rows[2].contains("unreadable"), "{ran}");
    for line in ["status out", "about devices", "metrology ref.png --element-sizes 8,16"] {
        fits(&desk.run(line).stdout, line);
    }
}

#[test]
fn statuses_have_colour_on_a_terminal_or_when_it_is_asked_for() {
    let desk = Desk::with_series();
    desk.write("bad.png", "no image");
    let line = format!("{INSIDE} ref.png a.png bad.png");
    let escape = |ran: &program::Ran<'_>| ran.stderr.contains('\x1b') || ran.stdout.contains('\x1b');
    // No terminal here.
    assert!(!escape(&desk.correlate(&format!("--output plain {line}"))));
    let ran = desk.correlate(&format!("--color always --output out {line}"));
    let row = |status: &str| table(&ran.stderr).into_iter().find(|row| row.contains(status)).unwrap().to_owned();
    assert!(row("converged").contains("\x1b[32mconverged\x1b[0m"), "{ran}");
    assert!(row("unreadable").contains("\x1b[31munreadable\x1b[0m"), "{ran}");
    fits(&table(&ran.stderr).join("\n"), "coloured");
    assert!(escape(&desk.run("status out --color always")) && !escape(&desk.run("status out")));
    let words = ["status", "out", "--color", "never"];
    assert!(!escape(&desk.run_with(&[("NO_COLOR", "1")], &words)));
}

#[test]
fn the_short_help_of_every_command_is_one_screen_in_groups_and_the_long_one_has_examples() {
    let desk = Desk::new();
    let commands = desk.run("-h").stdout;
    fits(&commands, "-h");
    let names = commands.lines().skip_while(|line| *line != "Commands:").skip(1);
    let names = names.take_while(|line| line.starts_with("  ")).filter(|line| !line.starts_with("   "));
    let names: Vec<String> = names.filter_map(|line| Some(line.split_whitespace().next()?.to_owned())).collect();
    // A user's task is one command: no more than can be read at once, `help` among them.
    assert!((15..=20).contains(&names.len()) && names.contains(&"correlate".to_owned()), "{commands}");
    let inner = ["make images", "make virtual-test", "make specimen", "make page", "about devices"];
    for name in names.iter().map(String::as_str).chain(inner) {
        let ran = desk.run(&format!("{name} -h"));
        assert!(ran.code == Some(0) && ran.stderr.is_empty(), "{ran}");
        let n = ran.stdout.lines().count();
        assert!(n <= SCREEN, "{name} -h has {n} lines: {ran}");
        fits(&ran.stdout, name);
        assert!(ran.stdout.contains(&format!("quadrille {name} --help")), "{ran}");
        let long = desk.run(&format!("{name} --help"));
        assert!(long.stdout.lines().count() > n, "{long}");
    }
    let help = desk.run("correlate -h").stdout;
    for group in ["Input:", "Zones:", "Correlation:", "Output:", "Machine:"] {
        assert!(help.contains(group), "{group}: {help}");
    }
    assert!(desk.run("correlate --help").stdout.contains("--isa"), "what few need is in the long help");
}

/// Words that users stumble over, with what to write instead.
const STUMBLED_OVER: [(&str, &str); 19] = [
    ("foretold", "predicted"),
    ("foretell", "predict"),
    ("by turns", "alternately"),
    ("for the time being", "meanwhile"),
    ("on the average", "on average"),
    ("have not the same", "do not have the same"),
    ("its zone has not", "does not have"),
    ("is no finite", "is not a finite"),
    ("is no number", "is not a number"),
    ("is no whole", "is not a whole"),
    ("is no UTF-8", "is not UTF-8"),
    ("is no valid", "is not a valid"),
    ("is no rectangle", "is not a rectangle"),
    ("is no list", "is not a list"),
    ("is no choice", "is not a choice"),
    ("is no measurement", "is not a measurement"),
    ("which is none", "which is not one"),
    ("is said on stderr", "is written to stderr"),
    ("was over", "was reached"),
];

#[test]
fn help_messages_and_pages_have_plain_words() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Vec::new();
    for folder in ["src", "crates"] {
        crate::pages::files(&root.join(folder), &["rs"], &mut sources);
    }
    let mut said: Vec<(String, String)> = crate::pages::pages()
        .into_iter()
        .map(|(path, text)| (path.strip_prefix(root).unwrap().display().to_string(), text))
        .collect();
    assert!(sources.len() > 300 && said.len() > 30, "{} sources, {} pages", sources.len(), said.len());
    for path in sources {
        let name = path.strip_prefix(root).unwrap().display().to_string();
        // Comments are for those who read the code, but for those that are the help of a command.
        let help = name.replace('\\', "/").contains("cli/args/");
        let text = std::fs::read_to_string(&path).unwrap();
        let lines = text.lines().filter(|line| help || !line.trim_start().starts_with("//"));
        said.push((name, lines.collect::<Vec<_>>().join("\n")));
    }
    let mut wrong = Vec::new();
    for (name, text) in &said {
        // A sentence may go on in the next line, behind the backslash of a string or the slashes of a comment.
        let flat: Vec<&str> = text.split_whitespace().filter(|word| !["\\", "///"].contains(word)).collect();
        let flat = flat.join(" ");
        for (word, better) in STUMBLED_OVER {
            if flat.contains(word) {
                wrong.push(format!("{name}: '{word}': write '{better}'"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
