//! `quadrille make virtual-test`: the virtual test with its images, its truth, and a case file to run.

use crate::cli::args::{VirtualArgs, VirtualDepth, VirtualKinematics, VirtualMixity};
use crate::cli::{Outcome, Result};
use crate::mechanics::Kinematics;
use crate::run::virtual_test;
use crate::synth::Depth;
use crate::virtual_test::{Mixity, VirtualOptions};

pub(crate) fn run(args: &VirtualArgs) -> Result<Outcome> {
    let depth = match args.depth {
        VirtualDepth::Eight => Depth::U8,
        VirtualDepth::Sixteen => Depth::U16,
    };
    let mixity = match args.mixity {
        VirtualMixity::Opening => Mixity::Opening,
        VirtualMixity::Mixed => Mixity::Mixed,
        VirtualMixity::Sliding => Mixity::Sliding,
    };
    let kinematics = match args.kinematics {
        VirtualKinematics::Paper => Kinematics::Paper,
        VirtualKinematics::Finite => Kinematics::Finite,
    };
    let (seed, noise_grey, instants) = (args.seed, args.noise, args.instants);
    let options = VirtualOptions { seed, depth, noise_grey, instants, mixity, kinematics, ..VirtualOptions::default() };
    virtual_test(options, &args.law, &args.output, args.overwrite, &args.threads.pool()?)?;
    let case = args.output.join("case.toml");
    args.talk.say(format_args!("the virtual test in {}: images, load.csv, truth.json, truth", args.output.display()));
    args.talk.say(format_args!(
        "next: quadrille run {} --output {}",
        case.display(),
        args.output.join("run").display()
    ));
    Ok(Outcome::Fine)
}
