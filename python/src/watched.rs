//! Long work that Python watches: events go to a function, Ctrl-C and an exception of that function are a wish to stop.

use crate::errors::Raised;
use crate::json::to_python;
use pyo3::prelude::*;
use quadrille::run::{Event, Stop};
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

/// How often Ctrl-C is looked for.
const EVERY: Duration = Duration::from_millis(50);
/// Events that may wait for a function that is slow; then the work waits.
const WAITING: usize = 256;

/// Does `work` on a thread of its own, while this one calls `on_event` and looks for Ctrl-C.
pub fn watched<T: Send, E: Raised + std::error::Error + Send>(
    py: Python<'_>,
    on_event: Option<&Bound<'_, PyAny>>,
    stop: &Stop,
    work: impl FnOnce(&mut dyn FnMut(Event<'_>)) -> Result<T, E> + Send,
) -> PyResult<T> {
    let (tell, mut words) = sync_channel::<Value>(WAITING);
    let listens = on_event.is_some();
    let mut wish: Option<PyErr> = None;
    let done = std::thread::scope(|scope| {
        let thread = scope.spawn(move || {
            work(&mut |event| {
                if listens && let Some(event) = value_of(event) {
                    let _ = tell.send(event); // nobody listens any more
                }
            })
        });
        loop {
            let word;
            (words, word) = py.detach(move || {
                let word = words.recv_timeout(EVERY);
                (words, word)
            });
            let heard = match (&word, on_event, &wish) {
                (Ok(event), Some(call), None) => to_python(py, event).and_then(|event| call.call1((event,))).map(drop),
                _ => Ok(()),
            };
            if let Err(error) = heard.and_then(|()| if wish.is_none() { py.check_signals() } else { Ok(()) }) {
                stop.ask();
                wish.get_or_insert(error);
            }
            if word == Err(RecvTimeoutError::Disconnected) {
                break;
            }
        }
        py.detach(move || thread.join())
    });
    match (wish, done) {
        (_, Err(panic)) => std::panic::resume_unwind(panic),
        (Some(wish), _) => Err(wish),
        (None, Ok(done)) => done.map_err(crate::errors::raised),
    }
}

/// An event as a record whose key `event` says which it is.
fn value_of(event: Event<'_>) -> Option<Value> {
    let name = |path: &Path| path.display().to_string();
    let with = |kind: &str, value: Result<Value, serde_json::Error>| {
        let mut record = Map::new();
        record.insert("event".to_owned(), kind.into());
        if let Ok(Value::Object(fields)) = value {
            record.extend(fields);
        }
        Some(Value::Object(record))
    };
    match event {
        Event::Begun { total, before } => Some(json!({ "event": "begun", "total": total, "before": before })),
        Event::Note(text) => Some(json!({ "event": "note", "text": text })),
        Event::Remark(remark) => with("remark", serde_json::to_value(remark)),
        Event::Frame { summary, .. } => with("frame", serde_json::to_value(summary)),
        Event::Finished { frames, seconds } => {
            Some(json!({ "event": "finished", "frames": frames.len(), "seconds": seconds }))
        }
        Event::Simulated { folder, .. } => Some(json!({ "event": "simulated", "folder": name(folder) })),
        Event::Fitting(at) => {
            let parameters: Map<String, Value> =
                at.parameters.iter().map(|(name, v)| ((*name).into(), json!(v))).collect();
            Some(json!({
                "event": "fitting", "doing": at.doing, "evaluation": at.evaluation, "instant": at.instant,
                "n_instants": at.n_instants, "omega": at.omega, "parameters": parameters, "seconds": at.seconds,
            }))
        }
        Event::Identified { folder, .. } => Some(json!({ "event": "identified", "folder": name(folder) })),
        Event::Compared { folder, .. } => Some(json!({ "event": "compared", "folder": name(folder) })),
        Event::Reported { page } => Some(json!({ "event": "reported", "page": name(page) })),
        _ => None,
    }
}
