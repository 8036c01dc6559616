//! A series carried out by the library, without a command line: the same bits as the program, events in order, a stop
//! and what goes on after it.

#![cfg(feature = "cli")]

use crate::program;
use program::{Desk, INSIDE, moved};
use quadrille::correlate::Tracker;
use quadrille::imaging::{Image, Pixels};
use quadrille::io::case::{CaseFile, CrackPath};
use quadrille::io::images::read_image;
use quadrille::io::store::Store;
use quadrille::mesh::Mask;
use quadrille::run::{
    Event, Existing, InMemory, Outcome, Plan, Ran, Request, RunError, RunFolder, Session, Stop, run_series,
};
use rayon::ThreadPool;
use std::sync::Arc;

/// What `quadrille correlate --roi 16,16,112,80 --reference ref.png a.png b.png c.png` is given.
fn asked(desk: &Desk) -> Request {
    let name = |file: &str| desk.path(file).display().to_string();
    let mut asked = Request { device: "cpu".parse().unwrap(), ..Request::default() };
    asked.images.reference = Some(vec![name("ref.png")]);
    asked.images.deformed = Some(["a.png", "b.png", "c.png"].map(name).to_vec());
    asked.zones.roi = vec![[16.0, 16.0, 112.0, 80.0]];
    asked
}

fn pool() -> ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap()
}

#[track_caller]
fn run(desk: &Desk, output: &str, session: Session, watcher: &mut dyn FnMut(Event<'_>)) -> Result<Ran, RunError> {
    let plan = Plan::of(&asked(desk), &CaseFile::default())?;
    run_series(&plan, &RunFolder::writable(&desk.path(output))?, &pool(), session, watcher)
}

/// The fields of a run: every file of its store but those that name folders and devices.
fn fields(desk: &Desk, output: &str) -> Vec<(String, Vec<u8>)> {
    let stored = desk.all_files(output).into_iter().filter(|name| name.starts_with("fields.zarr/"));
    let numbers = stored.filter(|name| !name.ends_with("zarr.json"));
    numbers.map(|name| (name.clone(), desk.bytes(&format!("{output}/{name}")))).collect()
}

#[test]
fn the_library_writes_the_same_fields_as_the_program() {
    let desk = Desk::with_series();
    desk.run(&format!(
        "correlate --reference ref.png a.png b.png c.png {INSIDE} --device cpu --threads 2 --output program"
    ));
    let ran = run(&desk, "library", Session::new(Existing::Continue), &mut |_| ()).unwrap();
    assert_eq!((ran.outcome, ran.complete, ran.summary.frames.len()), (Outcome::Fine, true, 3));
    let (program, library) = (fields(&desk, "program"), fields(&desk, "library"));
    assert!(program.len() > 10, "{} files", program.len());
    assert_eq!(program, library);
}

#[test]
fn whoever_watches_hears_of_the_beginning_of_every_frame_in_order_and_of_the_end() {
    let desk = Desk::with_series();
    let mut heard = Vec::new();
    let mut watcher = |event: Event<'_>| match event {
        Event::Begun { total, before } => heard.push(format!("begun: {total:?}, {before} before")),
        Event::Frame { summary, .. } => heard.push(format!("frame {}", summary.number)),
        Event::Finished { frames, .. } => heard.push(format!("finished: {}", frames.len())),
        _ => {}
    };
    run(&desk, "out", Session::new(Existing::Continue), &mut watcher).unwrap();
    assert_eq!(heard, ["begun: Some(3), 0 before", "frame 1", "frame 2", "frame 3", "finished: 3"]);
}

#[test]
fn a_run_that_is_asked_to_stop_goes_on_to_the_same_bits() {
    // So many that the last is not on its way when the first is done.
    const FRAMES: usize = 12;
    let desk = Desk::new();
    (0..=FRAMES).for_each(|k| desk.image(&format!("{k:02}.png"), &moved([0.1 * k as f64, -0.1 * k as f64])));
    let files = (1..=FRAMES).map(|k| desk.path(&format!("{k:02}.png")).display().to_string()).collect();
    let mut asked = asked(&desk);
    asked.images.reference = Some(vec![desk.path("00.png").display().to_string()]);
    asked.images.deformed = Some(files);
    let plan = Plan::of(&asked, &CaseFile::default()).unwrap();
    let run = |output: &str, session: Session, watcher: &mut dyn FnMut(Event<'_>)| {
        run_series(&plan, &RunFolder::writable(&desk.path(output)).unwrap(), &pool(), session, watcher).unwrap()
    };
    run("whole", Session::new(Existing::Continue), &mut |_| ());
    let stop = Stop::default();
    let session = Session { stop: stop.clone(), ..Session::new(Existing::Continue) };
    let mut stop_at_first = |event: Event<'_>| {
        if let Event::Frame { .. } = event {
            stop.ask();
        }
    };
    let stopped = run("parts", session, &mut stop_at_first);
    assert_eq!(stopped.outcome, Outcome::Stopped);
    assert!(!stopped.complete && stopped.summary.frames.len() < FRAMES, "{}", stopped.summary.frames.len());
    let mut before = 0;
    let mut count = |event: Event<'_>| {
        if let Event::Begun { before: n, .. } = event {
            before = n;
        }
    };
    let ran = run("parts", Session::new(Existing::Continue), &mut count);
    assert_eq!((ran.outcome, before), (Outcome::Fine, stopped.summary.frames.len()));
    assert_eq!(fields(&desk, "whole"), fields(&desk, "parts"));
}

#[test]
fn what_is_wrong_is_told_by_its_kind() {
    let desk = Desk::with_series();
    run(&desk, "out", Session::new(Existing::Continue), &mut |_| ()).unwrap();
    let mut other = asked(&desk);
    other.correlation.element_size_px = Some(8);
    let plan = Plan::of(&other, &CaseFile::default()).unwrap();
    let folder = RunFolder::writable(&desk.path("out")).unwrap();
    let again = run_series(&plan, &folder, &pool(), Session::new(Existing::Continue), &mut |_| ());
    assert!(matches!(again, Err(RunError::HoldsAnother { .. })), "{again:?}");
    let none = Plan::of(&Request::default(), &CaseFile::default());
    assert!(matches!(none, Err(RunError::Refused(_))), "{none:?}");
    let mut lost = asked(&desk);
    lost.images.reference = Some(vec![desk.path("none.png").display().to_string()]);
    let plan = Plan::of(&lost, &CaseFile::default()).unwrap();
    let folder = RunFolder::writable(&desk.path("lost")).unwrap();
    let lost = run_series(&plan, &folder, &pool(), Session::new(Existing::Continue), &mut |_| ());
    assert!(matches!(lost, Err(RunError::Image(_))), "{lost:?}");
}

#[test]
fn images_in_memory_give_the_fields_that_a_run_stores() {
    let desk = Desk::with_series();
    run(&desk, "out", Session::new(Existing::Continue), &mut |_| ()).unwrap();
    let store = Store::open(desk.path("out")).unwrap();
    let image = |name: &str| Arc::new(read_image(&desk.path(name), 0).unwrap().image);
    let prepared = InMemory::new(&asked(&desk), &CaseFile::default(), image("ref.png"), None).unwrap();
    let mut tracker = Tracker::new(&*prepared.correlator);
    for (at, name) in ["a.png", "b.png", "c.png"].into_iter().enumerate() {
        let field = tracker.correlate(at + 1, image(name)).unwrap().measurement;
        let stored = store.frame(at + 1).unwrap().unwrap().measurement;
        assert_eq!(field.displacement, stored.displacement, "{name}");
        let as_stored: Vec<[f64; 2]> = field.sigma.iter().map(|pair| pair.map(|v| f64::from(v as f32))).collect();
        assert_eq!(as_stored, stored.sigma, "{name}");
        assert!(prepared.strains(&field).elements.iter().all(Option::is_some));
    }
}

#[test]
fn what_single_images_cannot_have_is_refused() {
    let desk = Desk::with_series();
    let reference = Arc::new(read_image(&desk.path("ref.png"), 0).unwrap().image);
    let refused = |asked: &Request, mask| {
        let made = InMemory::new(asked, &CaseFile::default(), Arc::clone(&reference), mask);
        made.err().map(|error| error.to_string()).unwrap_or_default()
    };
    let mut update = asked(&desk);
    update.correlation.update_reference = Some("residual".parse().unwrap());
    assert!(refused(&update, None).contains("for a series"));
    let mut crack = asked(&desk);
    crack.cracks.path = vec![CrackPath::Auto];
    assert!(refused(&crack, None).contains("in a series alone"));
    assert!(refused(&asked(&desk), Mask::new(3, 2, vec![true; 6])).contains("the mask is 3 x 2 px"));
    let flat = Arc::new(Image::new(64, 64, Pixels::U8(vec![9; 64 * 64])).unwrap());
    let device = "cpu".parse().unwrap();
    let found = InMemory::new(&Request { device, ..Request::default() }, &CaseFile::default(), flat, None);
    assert!(matches!(found, Err(RunError::Reference(_))));
}
