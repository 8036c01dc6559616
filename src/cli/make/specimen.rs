//! `quadrille make specimen`: the mesh and the case file of a usual test, to begin with.

use crate::cli::args::SpecimenArgs;
use crate::cli::{Outcome, Result, write_new};
use crate::mechanics::{Specimen, SpecimenOptions};
use crate::run::{make_folder, photograph};

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
    make_folder(folder)?;
    if let Some(computed) = &args.images {
        let case = folder.join("test.toml");
        if case.exists() && !args.results.overwrite {
            return Err(format!("{} is there; choose another --output, or --overwrite", case.display()).into());
        }
        photograph((kind, &options), computed, folder, &crate::cli::pool(None)?)?;
        args.talk.say(format_args!("measure it with: quadrille correlate --case {} --output fields", case.display()));
        return Ok(Outcome::Fine);
    }
    write_new(&folder.join("mesh.json"), &specimen.mesh_json(), args.results.overwrite)?;
    write_new(&folder.join("case.toml"), &specimen.case, args.results.overwrite)?;
    let case = folder.join("case.toml");
    args.talk.say(format_args!("compute it with: quadrille simulate {} --output out", case.display()));
    Ok(Outcome::Fine)
}
