//! A folder of images into a store, as `quadrille correlate` does it. It reports each frame, stops after three, and
//! continues.
//!
//!     cargo run --release --example series                      # images made here
//!     cargo run --release --example series -- images results    # yours: the first is the reference

use quadrille::io::{case::CaseFile, images::write_image, store::Store};
use quadrille::run::{Event, Existing, Plan, Request, RunFolder, Session, Stop, run_series};
use quadrille::synth::{RenderOptions, Series, Texture, Translation};
use std::{error::Error, path::Path};

/// Writes ten images of speckles that move by 0.2 px from each to the next.
fn make_images(folder: &Path) -> Result<(), Box<dyn Error>> {
    let (texture, motion, options) = (Texture::new(1, 4.5)?, Translation([1.8, 0.9]), RenderOptions::new(192, 128));
    let series = Series { texture, motion, n_frames: 9, options };
    std::fs::create_dir_all(folder)?;
    (0..=9).try_for_each(|k| Ok(write_image(&folder.join(format!("image_{k}.png")), &series.image(k)?)?))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let work = std::env::temp_dir().join(format!("quadrille_series_{}", std::process::id()));
    let (images, results) = match (arguments.next(), arguments.next()) {
        (Some(images), Some(results)) => (images.into(), results.into()),
        _ => (work.join("images"), work.join("results")),
    };
    if images.starts_with(&work) {
        make_images(&images)?;
    }
    let mut case = CaseFile::default();
    case.images.deformed = Some(vec![images.join("*").display().to_string()]);
    let plan = Plan::of(&Request::default(), &case)?;
    let folder = RunFolder::writable(&results)?;
    let pool = rayon::ThreadPoolBuilder::new().build()?;
    for start in ["first", "second"] {
        let stop = Stop::default();
        let session = Session { stop: stop.clone(), ..Session::new(Existing::Continue) };
        let mut watcher = |event: Event<'_>| match event {
            Event::Begun { total, before } => println!("{start} start: {total:?} frames, {before} done before"),
            Event::Frame { summary, .. } => {
                println!("frame {}: {} in {:.3} s", summary.number, summary.status.name(), summary.seconds);
                if start == "first" && summary.number == 3 {
                    stop.ask(); // frames that are being computed are finished, no other is begun
                }
            }
            _ => {}
        };
        let ran = run_series(&plan, &folder, &pool, session, &mut watcher)?;
        println!("{:?}, {} frames in {}", ran.outcome, ran.summary.frames.len(), folder.path().display());
    }
    let last = Store::open(&results)?.frame(plan.deformed.len())?.ok_or("the last frame is missing")?;
    println!("in the last frame node 0 has moved by {:?} px", last.measurement.displacement[0]);
    Ok(())
}
