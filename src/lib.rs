//! Global Q4 digital image correlation, and the cohesive law of an adhesive from the fields that it measures.
//!
//! A pair of images:
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use quadrille::synth::{RenderOptions, Texture, Translation, render};
//! use quadrille::{backend::cpu::CpuBackend, correlate::*, mesh::*};
//! # let texture = Texture::new(7, 4.5)?;
//! # let photograph = |u| render(&texture, &Translation(u), &RenderOptions::new(128, 96)).map(std::sync::Arc::new);
//! let (reference, deformed) = (photograph([0.0, 0.0])?, photograph([0.3, -0.2])?);
//! let zone = Zone::rectangle("all", Roi { x0: 16.0, y0: 16.0, x1: 112.0, y1: 80.0 });
//! let correlator = Correlator::new(CpuBackend::default(), reference, &[zone], Options::default())?;
//! let field = Tracker::new(&correlator).correlate(1, deformed)?.measurement; // displacement, sigma, status, ...
//! assert!((field.displacement[0][0] - 0.3).abs() < 0.02); // px
//! # Ok(()) }
//! ```
//!
//! A series of files into a store, restarted where it was stopped, and a case from its images to the law ([`run`]; a longer one is
//! `examples/identify_from_images.rs`):
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use quadrille::{io::case::CaseFile, run::*};
//! let pool = rayon::ThreadPoolBuilder::new().build()?;
//! let asked = Overlay { deformed: vec!["images/*.tif".into()], ..Overlay::default() }; // the first is the reference
//! let plan = Plan::of(&asked, &CaseFile::default())?;
//! let folder = RunFolder::writable("results".as_ref())?;
//! run_series(&plan, &folder, &pool, Session::new(Existing::Continue), &mut |event| println!("{event:?}"))?;
//!
//! let outcome = run_case(&CaseRun::new("case.toml", "results/joint"), &pool, &mut |_| ())?;
//! assert_eq!(outcome, Outcome::Fine); // results/joint/fit.json, report.html, ...
//! # Ok(()) }
//! ```
//!
//! One straight road: images -> [`field::Measurement`] -> [`identify::Fit`] -> [`report`]. Beside it the mechanics of cohesive joints:
//! displacements of the border -> [`mechanics::Solution`]. Modules know only modules of lower rank (`tests/layers.rs`): `units`,
//! `clock`, `isa`; `linalg`; `imaging`, `mesh`; `field`; `backend`, `io`, `synth`; `correlate`, `mechanics`; `bench`, `identify`,
//! `metrology`, `virtual_test`; `paper`, `report`; `run`; `cli`.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(doctest)]
#[doc = include_str!("../docs/mechanics.md")]
struct Mechanics;

pub mod backend;
pub mod bench;
pub mod cli;
pub mod clock;
pub mod correlate;
pub mod field;
pub mod identify;
pub mod imaging;
pub mod io;
pub mod isa;
pub mod linalg;
pub mod mechanics;
pub mod mesh;
pub mod metrology;
pub mod paper;
pub mod report;
pub mod run;
pub mod synth;
pub mod units;
pub mod virtual_test;
