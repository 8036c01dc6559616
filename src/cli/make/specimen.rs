//! `quadrille make specimen`: the mesh and the case file of a usual test, to begin with.

use crate::cli::args::SpecimenArgs;
use crate::cli::{Outcome, Result};
use crate::mechanics::{Specimen, SpecimenOptions};
use std::fs;

pub(crate) fn run(args: &SpecimenArgs) -> Result<Outcome> {
    let kind = args.kind.kind();
    let given = kind.defaults();
    let arm = |own: Option<f64>, default: f64| own.or(args.arm).unwrap_or(default);
    let options = SpecimenOptions {
        length: args.length.unwrap_or(given.length),
        crack: args.crack_length.unwrap_or(given.crack),
        arms: [arm(args.lower_arm, given.arms[0]), arm(None, given.arms[1])],
        adhesive: args.adhesive.unwrap_or(given.adhesive),
        element: args.element.unwrap_or(given.element),
        rows: args.rows.unwrap_or(given.rows),
        opening: args.last_opening.unwrap_or(given.opening),
        instants: args.instants.unwrap_or(given.instants),
        lever: args.lever.unwrap_or(given.lever),
    };
    let specimen = Specimen::new(kind, &options)?;
    let folder = &args.results.output;
    fs::create_dir_all(folder).map_err(|error| format!("{}: cannot be made: {error}", folder.display()))?;
    for (name, text) in [("mesh.json", specimen.mesh_json()), ("case.toml", specimen.case.clone())] {
        let path = folder.join(name);
        if path.exists() && !args.results.overwrite {
            return Err(format!("{}: is there already; replace it with --overwrite", path.display()).into());
        }
        fs::write(&path, text).map_err(|error| format!("{}: cannot be written: {error}", path.display()))?;
    }
    eprintln!("compute it with: quadrille simulate {} --output out", folder.join("case.toml").display());
    Ok(Outcome::Fine)
}
