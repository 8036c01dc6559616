//! Options that are keys of a case: the case knows their defaults, the command line their flags.

use crate::io::case::{
    CaseCamera, CaseCorrelation, CaseCrack, CaseExtensometer, CaseFit, CaseImages, CaseLine, CaseLoad, CaseOpening,
    CaseProbe, CaseQuantityOptions, CaseRegion, CaseTension, CaseZone, schema_of,
};
use clap::{Arg, Command};
use serde_json::Value;

/// Makes the schema of a section.
type Schema = fn() -> Value;

/// Sections that flags say something of, and their schemas. An option has the name of its key, or `SECTION.KEY` where
/// another section has the same key.
const SECTIONS: [(&str, Schema); 14] = [
    ("images", schema_of::<CaseImages>),
    ("camera", schema_of::<CaseCamera>),
    ("correlation", schema_of::<CaseCorrelation>),
    ("zone", schema_of::<CaseZone>),
    ("crack", schema_of::<CaseCrack>),
    ("quantities", schema_of::<CaseQuantityOptions>),
    ("load", schema_of::<CaseLoad>),
    ("probe", schema_of::<CaseProbe>),
    ("line", schema_of::<CaseLine>),
    ("extensometer", schema_of::<CaseExtensometer>),
    ("region", schema_of::<CaseRegion>),
    ("opening", schema_of::<CaseOpening>),
    ("tension", schema_of::<CaseTension>),
    ("fit", schema_of::<CaseFit>),
];

/// The sections with the commands whose flags are their keys.
const COMMANDS: [(&[&str], &[&str]); 3] = [
    (&["correlate", "watch", "calibrate"], &["images", "camera", "correlation", "zone", "crack"]),
    (&["probe"], &["quantities", "load", "probe", "line", "extensometer", "region", "opening", "tension"]),
    (&["identify"], &["fit"]),
];

/// The section and the key that the option `id` stands for, one of `sections`.
fn key_of<'a>(id: &'a str, sections: &[(&'static str, Value)]) -> Option<(&'static str, &'a str)> {
    let has = |schema: &Value, key: &str| schema["properties"].get(key).is_some();
    let (of, key) = id.split_once('.').map_or((None, id), |(section, key)| (Some(section), key));
    let mut fits = sections.iter().filter(|(name, schema)| of.is_none_or(|of| of == *name) && has(schema, key));
    fits.next().map(|(name, _)| (*name, key))
}

fn schemas(of: &[&str]) -> Vec<(&'static str, Value)> {
    let sections = SECTIONS.iter().filter(|(name, _)| of.contains(name));
    sections.map(|(name, schema)| (*name, schema())).collect()
}

/// `command` with the defaults of keys behind the help of their flags.
pub(super) fn with_defaults(mut command: Command) -> Command {
    for (names, sections) in COMMANDS {
        let sections = schemas(sections);
        let with_default = |arg: Arg| {
            let schema = key_of(arg.get_id().as_str(), &sections).and_then(|(section, key)| {
                let (_, schema) = sections.iter().find(|(name, _)| *name == section)?;
                schema["properties"][key].get("default").cloned()
            });
            // One that names its default has another in mind.
            let help = arg.get_help().map(ToString::to_string).filter(|help| !help.contains("Default"));
            match (schema, help) {
                (Some(Value::String(word)), Some(help)) => arg.help(format!("{help}. Default {word}")),
                (Some(default @ Value::Number(_)), Some(help)) => arg.help(format!("{help}. Default {default}")),
                _ => arg,
            }
        };
        for name in names.iter().filter(|name| command.find_subcommand(name).is_some()).collect::<Vec<_>>() {
            command = command.mut_subcommand(name, |inner| inner.mut_args(&with_default));
        }
    }
    command
}

/// Puts the flags of `command` into the schema of a case: `x-flag` of the key that a flag stands for.
pub fn name_flags(schema: &mut Value, command: &Command) {
    for (names, sections) in COMMANDS {
        let sections = schemas(sections);
        // What the first of them calls it counts.
        let commands = names.iter().rev().filter_map(|name| command.find_subcommand(name));
        for arg in commands.flat_map(Command::get_arguments) {
            let Some((section, key)) = key_of(arg.get_id().as_str(), &sections) else { continue };
            let place = arg.get_value_names().and_then(<[_]>::first).map(|name| format!("{name}..."));
            let flag = arg.get_long().map(|long| format!("--{long}")).or(place);
            let section = &mut schema["properties"][section];
            let keys = if section["type"] == "array" { &mut section["items"] } else { section };
            keys["properties"][key]["x-flag"] = flag.into();
        }
    }
}
