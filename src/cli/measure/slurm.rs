//! `quadrille slurm`: scripts that spread a series over a cluster.

use crate::cli::args::SlurmArgs;
use crate::cli::{Outcome, Result, absolute, write_new};
use crate::field::UpdateReference;
use crate::io::case::read_case;
use crate::run::{make_folder, read_text};
use clap::ValueEnum;
use std::num::NonZeroUsize;
use std::path::Path;

/// Seconds before the end of its time at which a task is told to stop: it finishes its frames and writes what it knows.
const WARNING_S: usize = 120;

pub(crate) fn run(args: &SlurmArgs) -> Result<Outcome> {
    // A case that cannot be read is refused here, not by a hundred tasks.
    let case = read_case(&args.case)?;
    if let Some(update) = case.correlation.update_reference.filter(|&update| update != UpdateReference::Never) {
        return Err(format!(
            "{}: update_reference = \"{update}\" makes every frame depend on those before it, so that tasks cannot share the \
             series; leave it out, or run the series in one task with `quadrille correlate`",
            args.case.display()
        )
        .into());
    }
    let stem = args.case.file_stem().map_or_else(|| "quadrille".into(), |stem| stem.to_string_lossy().into_owned());
    let scripts = args.scripts.clone().unwrap_or_else(|| ".".into());
    make_folder(&scripts)?;
    let program = match &args.program {
        Some(program) => program.clone(),
        None => this_program()?,
    };
    let prologue = match &args.prologue {
        Some(path) => format!("# From {}:\n{}\n", absolute(path), read_text(path)?.trim_end()),
        None => String::new(),
    };
    let about = About { args, program, case: absolute(&args.case), output: absolute(&args.output), prologue };
    about.check_names(&scripts)?;
    let names = [format!("{stem}-array.sbatch"), format!("{stem}-check.sbatch")];
    for (name, text) in names.iter().zip([about.array(), about.check()]) {
        write_new(&scripts.join(name), &text, args.overwrite)?;
    }
    let [array, check] = names.map(|name| word(&scripts.join(name).display().to_string()));
    println!("array=$(sbatch --parsable {array})");
    println!("sbatch --dependency=afterany:$array {check}");
    println!("# To repeat a task that failed, say 3: sbatch --array=3 {array}");
    Ok(Outcome::Fine)
}

/// The path of the program on this machine: that of the script where it runs inside Python.
fn this_program() -> Result<String> {
    let process = std::env::current_exe()?;
    let is_python = process.file_stem().is_some_and(|name| name.to_string_lossy().starts_with("python"));
    let script = std::env::args_os().nth(1).filter(|script| is_python && Path::new(script).is_file());
    Ok(script.map_or_else(|| process.to_string_lossy().into_owned(), |script| absolute(Path::new(&script))))
}

/// A text as one word of the shell.
fn word(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

struct About<'a> {
    args: &'a SlurmArgs,
    program: String,
    case: String,
    output: String,
    /// Lines that every job runs first.
    prologue: String,
}

impl About<'_> {
    /// Refuses names that a script cannot hold: a line break in one would begin a line of its own, also where it is
    /// quoted.
    fn check_names(&self, scripts: &Path) -> Result<()> {
        let names = [&self.case, &self.output, &self.program, &scripts.display().to_string(), &self.prologue_name()];
        match names.into_iter().find(|name| name.chars().any(|c| c.is_control() || c == char::REPLACEMENT_CHARACTER)) {
            Some(name) => Err(format!(
                "{name:?}: a script cannot hold this name (a line break or another control character, or no UTF-8); rename it"
            )
            .into()),
            None => Ok(()),
        }
    }

    fn prologue_name(&self) -> String {
        self.args.prologue.as_ref().map_or_else(String::new, |path| path.display().to_string())
    }

    /// The lines that both scripts begin with.
    fn head(&self, name: &str, cpus: NonZeroUsize) -> String {
        let args = self.args;
        let mut lines = vec![
            "#!/bin/bash".to_owned(),
            format!("# Written by quadrille {} for {}.", env!("CARGO_PKG_VERSION"), self.case),
            format!("#SBATCH --job-name={name}"),
            "#SBATCH --ntasks=1".into(),
            format!("#SBATCH --cpus-per-task={cpus}"),
            format!("#SBATCH --time={}", args.time),
        ];
        lines.extend(args.memory.as_ref().map(|memory| format!("#SBATCH --mem={memory}")));
        lines.extend(args.partition.as_ref().map(|partition| format!("#SBATCH --partition={partition}")));
        lines.extend(args.account.as_ref().map(|account| format!("#SBATCH --account={account}")));
        lines.extend(args.sbatch.iter().map(|option| format!("#SBATCH {option}")));
        lines.join("\n")
    }

    fn array(&self) -> String {
        let (n, args) = (self.args.array, self.args);
        let gpu = match args.gpu {
            true => {
                "\n# One GPU a task. Where the cluster does not hide the others from a task, give --device the GPU's name or index.\n\
                     #SBATCH --gpus-per-task=1"
            }
            false => "",
        };
        let head = self.head("quadrille", args.cpus);
        let device = if args.gpu { "gpu" } else { "cpu" };
        let (program, case, output) = (word(&self.program), word(&self.case), word(&self.output));
        let prologue = &self.prologue;
        format!(
            "{head}\n\
             #SBATCH --array=1-{n}{gpu}\n\
             # Each task is told before its time is over, finishes its frames in flight and stops; submitted again, it goes on.\n\
             #SBATCH --signal=B:TERM@{WARNING_S}\n\
             #SBATCH --output=quadrille-%A_%a.log\n\
             \n\
             # Task I does the frames I, I + {n}, I + 2 * {n}, ... of the series, all tasks into one store: nothing is merged afterwards.\n\
             # What is done is not done again, so any task may be submitted as often as it takes:\n\
             #     sbatch --array=3 THIS_FILE\n\
             {prologue}set -u\n\
             {program} correlate --case {case} --output {output} \\\n    \
             --shard \"$SLURM_ARRAY_TASK_ID/{n}\" --start independent --device {device} \\\n    \
             --threads \"${{SLURM_CPUS_PER_TASK:-1}}\" &\n\
             child=$!\n\
             trap 'kill -TERM \"$child\"' TERM\n\
             wait \"$child\"; status=$?\n\
             # A signal ends the first wait; the frames in flight are still to be finished.\n\
             while kill -0 \"$child\" 2> /dev/null; do wait \"$child\"; status=$?; done\n\
             # 1: all frames of this task are done, and some did not converge: nothing that another try would change.\n\
             [ \"$status\" -le 1 ] || exit \"$status\"\n"
        )
    }

    /// The script of the job after it.
    fn check(&self) -> String {
        let head = self.head("quadrille-check", NonZeroUsize::MIN);
        let (program, output) = (word(&self.program), word(&self.output));
        let prologue = &self.prologue;
        let names = self.args.export.iter().filter_map(|kind| Some(kind.to_possible_value()?.get_name().to_owned()));
        let names: Vec<String> = names.collect();
        let export = match names.is_empty() {
            true => String::new(),
            false => format!("{program} export {output} --to {} || exit 2\n", names.join(",")),
        };
        format!(
            "{head}\n\
             #SBATCH --output=quadrille-check-%j.log\n\
             \n\
             # Runs when all tasks have ended, well or not: says what is done, failed and missing, and exports what is there.\n\
             # Exit status: 0 all frames converged; 1 some are missing or did not converge.\n\
             {prologue}{program} status {output}; status=$?\n\
             [ \"$status\" -le 1 ] || exit \"$status\"\n\
             {export}exit \"$status\"\n"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::word;

    #[test]
    fn a_word_of_the_shell_is_quoted_where_it_needs_to_be() {
        assert_eq!(word("/data/a-1.toml"), "/data/a-1.toml");
        assert_eq!(word("my case.toml"), "'my case.toml'");
        assert_eq!(word("it's"), "'it'\\''s'");
        assert_eq!(word("a$b"), "'a$b'");
    }
}
