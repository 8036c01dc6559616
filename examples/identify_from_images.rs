//! From the images of a case to the law of its adhesive: `quadrille run CASE --output DIR` from Rust, with its events.
//!
//!     quadrille make virtual-test --output test
//!     cargo run --release --example identify_from_images -- test/case.toml out/example

use quadrille::run::{CaseRun, Event, run_case};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(case), Some(output)) = (arguments.next(), arguments.next()) else {
        return Err("give a case file and a folder for the results".into());
    };
    let mut watcher = |event: Event<'_>| match event {
        Event::Begun { total, before } => println!("{total:?} frames, {before} done before"),
        Event::Frame { summary, .. } => println!("frame {}: {}", summary.number, summary.status.name()),
        Event::Note(line) => println!("{line}"),
        Event::Remark(remark) => println!("{}", remark.text),
        Event::Identified { fit, .. } => {
            for (name, found) in &fit.parameters {
                println!("{name} = {} {}, 95 % {:?}", found.value, found.unit, found.ends95);
            }
            println!("{}: {}", fit.verdict.outcome, fit.verdict.text);
        }
        Event::Reported { page } => println!("report: {}", page.display()),
        _ => {}
    };
    let pool = rayon::ThreadPoolBuilder::new().build()?;
    let outcome = run_case(&CaseRun::new(case, output), &pool, &mut watcher)?;
    println!("{outcome:?}");
    Ok(())
}
