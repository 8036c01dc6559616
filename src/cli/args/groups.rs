//! The options of a command in groups, and the short help: one screen.

use crate::cli::lines::{WIDTH, wrapped};
use clap::{Arg, Command};

/// Options by what they are about; the same name is the same matter in every command. What no group names stands under
/// "Options".
const GROUPS: [(&str, &[&str]); 8] = [
    (
        "Input",
        &[
            "case",
            "reference",
            "page",
            "pages",
            "max_image_mpx",
            "load",
            "load_time",
            "frame_interval",
            "frame_times",
            "load_start",
            "area",
            "pattern",
            "settle",
            "timeout",
            "stills",
            "run",
            "shots",
        ],
    ),
    (
        "Zones",
        &[
            "roi",
            "polygon",
            "mask",
            "mesh",
            "guard",
            "crack",
            "crack_guard",
            "crack_young",
            "crack_poisson",
            "crack_radius",
            "element_share",
            "drop_textureless",
        ],
    ),
    (
        "Correlation",
        &[
            "element_size",
            "elements",
            "interpolation",
            "tolerance",
            "max_iterations",
            "brightness",
            "start",
            "update_reference",
            "noise",
            "noise_correlation",
            "regularisation",
            "cutoff",
        ],
    ),
    ("Fit", &["laws", "sweep", "tournament", "max_seconds", "max_evaluations"]),
    ("Quantities", &["point", "line", "step", "extensometer", "width", "opening", "remove_rigid", "curves"]),
    (
        "Output",
        &[
            "output",
            "overwrite",
            "resume",
            "export",
            "figures",
            "no_report",
            "strain",
            "strain_window",
            "pixel_size",
            "to",
            "split",
            "frames",
            "json",
            "format",
            "scale",
            "style",
            "range",
            "magnify",
        ],
    ),
    ("Machine", &["device", "isa", "threads", "shard", "trust_device"]),
    ("Messages", &["quiet", "verbose", "progress", "color", "help", "version"]),
];

/// Options that few ever need: in `--help` alone, for the commands where the short help would be longer than a screen.
const RARE: [&str; 20] = [
    "elements",
    "trust_device",
    "crack_guard",
    "crack_young",
    "crack_poisson",
    "crack_radius",
    "element_share",
    "drop_textureless",
    "tolerance",
    "max_iterations",
    "noise_correlation",
    "page",
    "pages",
    "max_image_mpx",
    "isa",
    "resume",
    "shard",
    "progress",
    "version",
    "color",
];

/// What an option is in a few words, for a command with many: a line each.
const BRIEF: [(&str, &str); 22] = [
    ("deformed", "deformed images; the first is the reference"),
    ("reference", "the reference; several: their mean"),
    ("case", "a case file that says the same; flags win"),
    ("roi", "a rectangle to measure, px; may be repeated"),
    ("polygon", "a polygon to measure, px; may be repeated"),
    ("mask", "an image, white where it is measured"),
    ("mesh", "a mesh to measure with, .msh or .vtu"),
    ("guard", "pixels left out beside the border of a zone"),
    ("element_size", "side of the elements, 4 to 128 px; 16"),
    ("interpolation", "cubic, quintic, keys, bilinear"),
    ("brightness", "auto, zone, smooth, element, off"),
    ("start", "previous frame, or independent"),
    ("update_reference", "large deformation: residual, every N"),
    ("noise", "camera noise, grey levels, or photon"),
    ("regularisation", "tikhonov or equilibrium-gap; needs --cutoff"),
    ("cutoff", "cut-off length of the regularisation, px"),
    ("overwrite", "replace the results of an earlier run"),
    ("pixel_size", "millimetres per pixel: columns in mm"),
    ("export", "csv,vtu per frame, or none"),
    ("strain", "infinitesimal, green-lagrange, hencky"),
    ("figures", "frames to draw at the end: 1,5-20, last, all"),
    ("device", "auto, cpu, gpu, or part of an adapter's name"),
];

/// Options above which the rare ones are left out of the short help.
const MANY: usize = 18;
/// Column at which the short help says what an option is.
const TEXT_AT: usize = 28;

/// `command` with the options of all its commands in groups.
pub fn grouped(command: Command) -> Command {
    let command = command.mut_args(|arg| match heading(&arg) {
        Some(heading) => arg.help_heading(heading),
        None => arg,
    });
    let names: Vec<String> = command.get_subcommands().map(|inner| inner.get_name().to_owned()).collect();
    names.into_iter().fold(command, |command, name| command.mut_subcommand(name, grouped))
}

fn heading(arg: &Arg) -> Option<&'static str> {
    let id = arg.get_id().as_str();
    // Positional arguments have a place of their own.
    let listed = !arg.is_positional();
    GROUPS.iter().find(|(_, ids)| listed && ids.contains(&id)).map(|(heading, _)| *heading)
}

/// What `-h` says of `command`, whose whole name is `name`: a line or two for each option.
pub fn short_help(command: &Command, name: &str) -> String {
    let mut command = command.clone();
    command.build();
    let mut text = String::new();
    let mut add = |line: &str| {
        text.push_str(line.trim_end());
        text.push('\n');
    };
    if let Some(about) = command.get_about() {
        add(&wrapped(&about.to_string(), 0));
    }
    let positional: Vec<&Arg> = command.get_positionals().collect();
    let required = command.get_arguments().filter(|arg| arg.is_required_set() && !arg.is_positional());
    let required: String = required.map(|arg| format!(" {}", spec(arg))).collect();
    let places: String = positional.iter().map(|arg| format!(" {}", place(arg))).collect();
    let inner = if command.has_subcommands() { " [COMMAND]" } else { "" };
    add("");
    add(&wrapped(&format!("Usage: {name}{inner}{required} [OPTIONS]{places}"), 7));
    let options: Vec<&Arg> = command.get_arguments().filter(|arg| !arg.is_positional() && !arg.is_hide_set()).collect();
    let many = options.len() > MANY;
    for arg in positional {
        add(&if many { brief(&place(arg), arg) } else { entry(&place(arg), arg) });
    }
    let commands: Vec<&Command> = command.get_subcommands().filter(|inner| inner.get_name() != "help").collect();
    if !commands.is_empty() {
        add("\nCommands:");
    }
    let width = commands.iter().map(|inner| inner.get_name().len()).max().unwrap_or_default();
    for inner in commands {
        let about = inner.get_about().map(ToString::to_string).unwrap_or_default();
        add(&wrapped(&format!("  {:<width$} {}", inner.get_name(), first_sentence(&about)), width + 3));
    }
    let shown = |arg: &&&Arg| !(many && RARE.contains(&arg.get_id().as_str()));
    let headings = GROUPS.iter().map(|(heading, _)| Some(*heading));
    for heading in std::iter::once(None).chain(headings) {
        let of_group: Vec<_> = options.iter().filter(shown).filter(|arg| arg.get_help_heading() == heading).collect();
        if !of_group.is_empty() {
            add(&format!("{}:", heading.unwrap_or("Options")));
        }
        for arg in of_group {
            add(&if many { brief(&spec(arg), arg) } else { entry(&spec(arg), arg) });
        }
    }
    add(&format!("All options, in full and with examples: {name} --help"));
    text
}

/// An option as it is typed.
fn spec(arg: &Arg) -> String {
    let long = arg.get_long().map(|long| format!("--{long}")).unwrap_or_default();
    let short = arg.get_short().filter(|_| arg.get_long() != Some("version"));
    let short = short.map(|short| format!("-{short}, ")).unwrap_or_default();
    let takes = arg.get_action().takes_values();
    let value = arg.get_value_names().filter(|_| takes).map(|names| names.iter().map(|n| format!(" {n}")).collect());
    let value: String = value.unwrap_or_default();
    format!("{short}{long}{value}")
}

fn place(arg: &Arg) -> String {
    let name = arg.get_value_names().and_then(<[_]>::first).map_or(arg.get_id().to_string(), ToString::to_string);
    let more = if arg.get_num_args().is_some_and(|n| n.max_values() > 1) { "..." } else { "" };
    if arg.is_required_set() { format!("<{name}>{more}") } else { format!("[{name}]{more}") }
}

/// What an option is, beside how it is typed; below it where that is long.
fn entry(spec: &str, arg: &Arg) -> String {
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
    let help = first_sentence(&help);
    let begin = format!("  {spec}");
    if begin.chars().count() + 2 <= TEXT_AT {
        wrapped(&format!("{begin:TEXT_AT$}{help}"), TEXT_AT)
    } else if begin.chars().count() + 2 + help.chars().count() <= WIDTH {
        format!("{begin}  {help}")
    } else {
        format!("{begin}\n{}", wrapped(&format!("{:TEXT_AT$}{help}", ""), TEXT_AT))
    }
}

/// The same on one line: in a few words, or as much of the first sentence as there is room for.
fn brief(spec: &str, arg: &Arg) -> String {
    // Of choices the words tell, of a form the long help.
    let spec = match spec.split_once(' ') {
        Some((flag, form)) if spec.chars().count() + 4 > TEXT_AT || form.contains('|') && flag.starts_with("--") => {
            format!("{flag} ...")
        }
        _ => spec.to_owned(),
    };
    let known = BRIEF.iter().find(|(id, _)| arg.get_id() == *id).map(|(_, words)| (*words).to_owned());
    let words = known.unwrap_or_else(|| {
        let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
        let (sentence, room) = (first_sentence(&help), WIDTH - TEXT_AT);
        let clause = sentence.find([',', ';', ':', '(']).filter(|_| sentence.chars().count() > room);
        sentence[..clause.unwrap_or(sentence.len())].trim_end().chars().take(room).collect()
    });
    format!("{:TEXT_AT$}{words}", format!("  {spec}"))
}

/// The first sentence, without its point; one in brackets or after a colon belongs to it.
fn first_sentence(text: &str) -> &str {
    let end = text.find(". ").or_else(|| text.strip_suffix('.').map(str::len)).unwrap_or(text.len());
    &text[..end]
}
