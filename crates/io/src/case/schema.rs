//! The JSON schema of case files, and the reference of their keys made from it.

#![expect(clippy::indexing_slicing, reason = "the schema is made by the program of its own types; a test writes it")]

use super::reader::{Reader, sections};
use super::{CaseFile, STD};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};
use std::fmt::Write as _;

/// A number that a law takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LawKey {
    /// Its key: `delta_n_mm`.
    pub key: String,
    /// Its symbol: `delta_n`.
    pub symbol: &'static str,
    /// Its unit, `1` for a pure number.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
}

/// What one law takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LawKeys {
    /// Its name, under `model`.
    pub model: &'static str,
    /// Its numbers.
    pub keys: Vec<LawKey>,
}

/// The laws that a case may name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CaseLaws {
    /// Of `[cohesive]`.
    pub cohesive: Vec<LawKeys>,
    /// Of `[substrate]`.
    pub substrate: Vec<LawKeys>,
}

/// The JSON schema (draft 2020-12) of `T`, such as a section of a case.
pub fn schema_of<T: JsonSchema>() -> Value {
    let settings = SchemaSettings::draft2020_12().with(|settings| settings.inline_subschemas = true);
    let mut schema = settings.into_generator().into_root_schema_for::<T>().to_value();
    tidy(&mut schema);
    schema
}

/// The JSON schema of case files. Beside the words of the standard, `x-commands` of a section names who takes it. The
/// program adds `x-flag` to a key: the flag that says the same.
pub fn case_schema(laws: &CaseLaws) -> Value {
    let mut schema = schema_of::<CaseFile>();
    let of_group = with_laws(&mut schema["properties"]["substrate"], &laws.substrate);
    schema["properties"]["substrate"]["additionalProperties"] = of_group;
    with_laws(&mut schema["properties"]["cohesive"], &laws.cohesive);
    if let Some(sections) = schema["properties"].as_object_mut() {
        for (name, section) in sections {
            section["x-commands"] = Reader::of(name).into();
        }
    }
    schema["title"] = "Case file of quadrille".into();
    schema
}

/// Takes out what TOML has not: null; and what says nothing to a user: formats of numbers.
fn tidy(schema: &mut Value) {
    let is_null = |value: &Value| value == "null" || *value == json!({ "type": "null" });
    if let Some(schema) = schema.as_object_mut() {
        schema.remove("format");
        if schema.get("default").is_some_and(|value| value.is_null() || *value == json!({}) || *value == json!([])) {
            schema.remove("default");
        }
        if let Some(Value::String(text)) = schema.get_mut("description") {
            *text = text.replace('\n', " ");
        }
        for word in ["type", "anyOf"] {
            let Some(Value::Array(choices)) = schema.get_mut(word) else { continue };
            choices.retain(|choice| !is_null(choice));
            if let [only] = choices.as_mut_slice() {
                let only = only.take();
                schema.remove(word);
                match only {
                    Value::Object(only) => only.into_iter().for_each(|(key, value)| {
                        schema.entry(key).or_insert(value);
                    }),
                    only => drop(schema.insert(word.to_owned(), only)),
                }
            }
        }
        schema.values_mut().for_each(tidy);
    } else if let Some(list) = schema.as_array_mut() {
        list.iter_mut().for_each(tidy);
    }
}

/// Puts the keys of `laws` into the section `schema`. Gives a copy that stands by itself.
fn with_laws(schema: &mut Value, laws: &[LawKeys]) -> Value {
    let models: Vec<&str> = laws.iter().map(|law| law.model).collect();
    let mut keys = Map::new();
    for LawKey { key, symbol, unit, .. } in laws.iter().flat_map(|law| &law.keys) {
        if keys.contains_key(key) {
            continue;
        }
        let unit = if *unit == "1" { String::new() } else { format!(", {unit}") };
        // What it is, and of which laws; the same key may be something else in others.
        let mut meanings: Vec<(&str, Vec<&str>)> = Vec::new();
        for law in laws {
            for meaning in law.keys.iter().filter(|other| other.key == *key).map(|other| other.meaning) {
                match meanings.iter_mut().find(|(there, _)| *there == meaning) {
                    Some((_, models)) => models.push(law.model),
                    None => meanings.push((meaning, vec![law.model])),
                }
            }
        }
        let of_models = |models: &[&str]| match models.len() == laws.len() {
            true => String::new(),
            false => format!(" Of {}.", models.join(", ")),
        };
        let told = meanings.iter().map(|(meaning, models)| format!("{meaning}{unit}.{}", of_models(models)));
        let told = told.collect::<Vec<_>>().join(" ");
        let models: Vec<&str> = meanings.iter().flat_map(|(_, models)| models.iter().copied()).collect();
        let std = format!("Standard uncertainty of {symbol}{unit}.{}", of_models(&models));
        keys.insert(key.clone(), json!({ "type": "number", "description": told }));
        keys.insert(format!("{key}{STD}"), json!({ "type": "number", "description": std }));
    }
    schema["properties"]["model"]["enum"] = models.into();
    if let Some(properties) = schema["properties"].as_object_mut() {
        properties.extend(keys);
    }
    schema["additionalProperties"] = false.into();
    schema.clone()
}

const HEAD: &str = "# Case files\n\n\
<!-- Made by `quadrille about case > docs/case.md`; a test compares. -->\n\n\
All commands read the same kind of TOML file. File names in it are relative to its folder, those of flags to the current\n\
folder. Flags take precedence. An error names file, line, section, key, and the key that may be meant.\n\n\
`quadrille about schema > case.schema.json` writes the JSON schema. An editor that knows TOML (Taplo, Even Better TOML) then\n\
completes and checks a case file that begins with\n\n\
```toml\n#:schema ./case.schema.json\n```\n\n\
`word`: one of the words that the meaning lists; those of a flag are explained [with it](commands.md). An empty default: nothing, or what the meaning says.\n";

/// Length of a list of values, in bytes, above which the next key with the same values refers to it.
const LONG: usize = 40;

/// The reference of all keys as Markdown, made of what [`case_schema`] gives.
pub fn case_reference(schema: &Value) -> String {
    let mut text = HEAD.to_owned();
    for name in sections() {
        let section = &schema["properties"][name];
        let repeated = section["type"] == "array";
        let head = if repeated { format!("[[{name}]]") } else { format!("[{name}]") };
        let about = section["description"].as_str().unwrap_or_default();
        let commands = section["x-commands"].as_str().unwrap_or_default();
        // These do not fail: a string takes all.
        let _ = write!(text, "\n## `{head}`\n\n{about}\n\nFor {commands}.\n");
        let item = if repeated { &section["items"] } else { section };
        let required = |key: &str| item["required"].as_array().is_some_and(|keys| keys.iter().any(|one| one == key));
        let of_law = item["properties"].get("model").is_some();
        // Those of a law are one line; other sections have keys of their own that end so.
        let is_told = |(key, _): &(&String, &Value)| !(of_law && key.ends_with(STD));
        let keys: Vec<_> = item["properties"].as_object().into_iter().flatten().filter(is_told).collect();
        if keys.is_empty() {
            continue;
        }
        let _ = write!(text, "\n| key, flag | values | default | meaning |\n|---|---|---|---|\n");
        let mut last = String::new();
        for (key, value) in keys {
            let default = match value.get("default") {
                Some(default) => format!("`{default}`"),
                None if required(key) => "required".to_owned(),
                None => String::new(),
            };
            let flag = value["x-flag"].as_str();
            // What the words of a flag mean is said with the flag.
            let told = if flag.is_some() { String::new() } else { words(value) };
            let meaning = [value["description"].as_str().unwrap_or_default().to_owned(), told];
            let meaning = meaning.into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join(" ");
            let values = flag.and_then(|_| listed(value)).unwrap_or_else(|| values(value));
            let shown = if values.len() > LONG && values == last { "the same" } else { values.as_str() };
            let flag = flag.map_or(String::new(), |flag| format!(", `{flag}`"));
            let _ = writeln!(text, "| `{key}`{flag} | {shown} | {default} | {} |", meaning.replace('|', "\\|"));
            last = values;
        }
        if of_law {
            let about = "Standard uncertainty of `KEY`, in its unit (docs/identification.md, \"The error budget\").";
            let _ = writeln!(text, "| `KEY{STD}` | number |  | {about} |");
        }
    }
    text
}

/// The words that `schema` has to choose from, each with what it means where that is said.
fn choices(schema: &Value) -> Vec<(&Value, &str)> {
    let alone = schema["enum"].as_array().into_iter().flatten().map(|word| (word, ""));
    let told = schema["oneOf"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|choice| Some((choice.get("const")?, choice["description"].as_str().unwrap_or_default())));
    alone.chain(told).collect()
}

/// What the words mean.
fn words(schema: &Value) -> String {
    let own = choices(schema);
    let inner = schema["anyOf"].as_array().into_iter().flatten().flat_map(choices);
    let told = own.into_iter().chain(inner).filter(|(_, about)| !about.is_empty());
    told.map(|(word, about)| format!("`{word}`: {about}")).collect::<Vec<_>>().join(" ")
}

/// The words that `schema` has to choose from, as a list; `None` without any.
fn listed(schema: &Value) -> Option<String> {
    let words: Vec<String> = choices(schema).iter().map(|(word, _)| format!("`{word}`")).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// What a key takes, in words.
fn values(schema: &Value) -> String {
    let words = choices(schema);
    if words.iter().any(|(_, about)| !about.is_empty()) {
        return "word".to_owned();
    }
    if let Some(listed) = listed(schema) {
        return listed;
    }
    if let Some(word) = schema.get("const") {
        return format!("`{word}`");
    }
    if let Some(any) = schema["anyOf"].as_array() {
        return any.iter().map(values).collect::<Vec<_>>().join(" or ");
    }
    match schema["type"].as_str() {
        Some("integer") => "whole number".to_owned(),
        Some("boolean") => "`true`, `false`".to_owned(),
        Some("string") => "text".to_owned(),
        Some("array") => match (schema["minItems"].as_u64(), values(&schema["items"])) {
            (Some(n), of) if n > 1 => format!("list of {n}: {of}"),
            (_, of) => format!("list: {of}"),
        },
        Some("object") => match (schema["properties"].as_object(), &schema["additionalProperties"]) {
            (Some(keys), _) => {
                let keys: Vec<String> = keys.keys().map(|key| format!("{key} = ..")).collect();
                format!("`{{ {} }}`", keys.join(", "))
            }
            (None, of) => format!("for each name: {}", values(of)),
        },
        Some(other) => other.to_owned(),
        None => "anything".to_owned(),
    }
}
