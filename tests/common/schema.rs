//! What a JSON schema says of a value: the part of draft 2020-12 that the schema of case files uses.

use serde_json::Value;

/// What is wrong with `value`, each with its path; nothing when the schema accepts it.
///
/// # Panics
/// At a word of the standard that is not known here.
pub fn faults(schema: &Value, value: &Value) -> Vec<String> {
    let mut found = Vec::new();
    check(schema, value, "", &mut found);
    found
}

fn check(schema: &Value, value: &Value, path: &str, found: &mut Vec<String>) {
    let Some(words) = schema.as_object() else {
        if *schema == Value::Bool(false) {
            found.push(format!("{path}: there is no such key"));
        }
        return;
    };
    for (word, rule) in words {
        let fine = match word.as_str() {
            "type" => is(rule, value),
            "const" => rule == value,
            "enum" => rule.as_array().unwrap().contains(value),
            "minimum" => value.as_f64().is_none_or(|value| value >= rule.as_f64().unwrap()),
            "maximum" => value.as_f64().is_none_or(|value| value <= rule.as_f64().unwrap()),
            "minItems" => value.as_array().is_none_or(|list| list.len() >= rule.as_u64().unwrap() as usize),
            "maxItems" => value.as_array().is_none_or(|list| list.len() <= rule.as_u64().unwrap() as usize),
            "required" => value.as_object().is_none_or(|table| {
                rule.as_array().unwrap().iter().all(|key| table.contains_key(key.as_str().unwrap()))
            }),
            "anyOf" => rule.as_array().unwrap().iter().any(|rule| faults(rule, value).is_empty()),
            "oneOf" => rule.as_array().unwrap().iter().filter(|rule| faults(rule, value).is_empty()).count() == 1,
            "items" => {
                for (k, item) in value.as_array().into_iter().flatten().enumerate() {
                    check(rule, item, &format!("{path}[{k}]"), found);
                }
                true
            }
            "properties" | "additionalProperties" => {
                let own = &schema["properties"];
                for (key, value) in value.as_object().into_iter().flatten() {
                    let path = format!("{path}.{key}");
                    match (word.as_str(), own.get(key)) {
                        ("properties", Some(rule)) => check(rule, value, &path, found),
                        ("additionalProperties", None) => check(rule, value, &path, found),
                        _ => {}
                    }
                }
                true
            }
            // Its own language; the parser is asked as well.
            "pattern" => true,
            "$schema" | "title" | "description" | "default" => true,
            own if own.starts_with("x-") => true,
            other => panic!("the word {other} is not known here"),
        };
        if !fine {
            found.push(format!("{path}: {value} is not {word} {rule}"));
        }
    }
}

fn is(kind: &Value, value: &Value) -> bool {
    match kind {
        Value::Array(kinds) => kinds.iter().any(|kind| is(kind, value)),
        Value::String(kind) => match kind.as_str() {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "boolean" => value.is_boolean(),
            "integer" => value.is_i64() || value.is_u64(),
            "number" => value.is_number(),
            other => panic!("the type {other} is not known here"),
        },
        other => panic!("{other} is no type"),
    }
}
