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
//! A series of files into a store, restarted where it was stopped, and a case from its images to the law ([`run`];
//! longer ones are in `examples/`):
//!
//! ```no_run
//! # #[cfg(all(feature = "report", feature = "store"))]
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use quadrille::{io::case::CaseFile, run::*};
//! let mut case = CaseFile::default();
//! case.images.deformed = Some(vec!["images/*.tif".into()]); // the first is the reference
//! let pool = rayon::ThreadPoolBuilder::new().build()?;
//! let plan = Plan::of(&Request::default(), &case)?;
//! let folder = RunFolder::writable("results".as_ref())?;
//! run_series(&plan, &folder, &pool, Session::new(Existing::Continue), &mut |event| println!("{event:?}"))?;
//!
//! let outcome = run_case(&CaseRun::new("case.toml", "results/joint"), &pool, &mut |_| ())?;
//! assert_eq!(outcome, Outcome::Fine); // results/joint/fit.json, report.html, ...
//! # Ok(()) }
//! # #[cfg(not(all(feature = "report", feature = "store")))]
//! # fn main() {}
//! ```
//!
//! One straight road: images -> [`field::Measurement`] -> [`identify::Fit`] -> [`report`]. Beside it the mechanics of
//! cohesive joints: displacements of the border -> [`mechanics::Solution`]. Below this crate, which hands on all they
//! have, are `quadrille-base`, `quadrille-dic`, `quadrille-io` and `quadrille-joint` (ARCHITECTURE.md).
//!
//! # Features
//!
//! All are on by default; `default-features = false` leaves the correlator, the mechanics and the identification, with
//! 173 crates instead of 337 (`scripts/check_features.sh` counts them).
//!
//! - `gpu`: graphics devices (wgpu). Without it [`backend::choice`] knows the CPU alone, and says so.
//! - `store`: [`io::store`], the fields of a series (zarrs).
//! - `report`: [`report`], summaries, figures and the page of a run (resvg). With `store`: [`run`].
//! - `cli`: [`cli`], the program (clap); with `store` and `report`.

// What cannot be is said in words (`expect`), or is an error.
#![cfg_attr(not(test), deny(clippy::unwrap_used))]

#[cfg(doctest)]
#[doc = include_str!("../docs/guide.md")]
struct Guide;

#[cfg(doctest)]
#[doc = include_str!("../docs/mechanics.md")]
struct Mechanics;

#[cfg(feature = "report")]
use quadrille_base::digest;
#[cfg(all(feature = "report", feature = "store"))]
use quadrille_base::plane;
#[doc(inline)]
pub use quadrille_base::{camera, field, imaging, mesh, remark, units};
#[doc(hidden)]
pub use quadrille_base::{isa, linalg};
#[doc(inline)]
pub use quadrille_dic::{backend, correlate, metrology, synth};
#[doc(inline)]
pub use quadrille_io as io;
#[doc(inline)]
pub use quadrille_joint::{identify, mechanics, reduction};

#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "report")]
pub mod report;
#[cfg(all(feature = "report", feature = "store"))]
pub mod run;
pub mod virtual_test;
