//! Whether the data determine the parameters, in words.

use crate::linalg::Dense;

/// Relative standard uncertainty above which a parameter is not determined.
pub const LARGEST_STD: f64 = 0.25;
/// Correlation, in magnitude, above which two parameters are not determined apart.
pub const LARGEST_CORRELATION: f64 = 0.95;
/// Condition number of the scaled Jacobian above which some combination of parameters is not determined.
pub const LARGEST_CONDITION: f64 = 30.0;

/// Whether the data determine the parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Whether they all are determined.
    pub determined: bool,
    /// What there is to say, a sentence each.
    pub sentences: Vec<String>,
    /// The thresholds.
    pub thresholds: String,
}

/// The verdict for parameters called `names` with relative standard uncertainties, their correlation, and the eigenvalues
/// (ascending) and eigenvectors of the scaled `J^T W J`.
pub fn verdict(names: &[&str], relative_std: &[f64], correlation: &Dense, eigen: &(Vec<f64>, Dense)) -> Verdict {
    let mut sentences = Vec::new();
    for (name, std) in names.iter().zip(relative_std).filter(|(_, std)| **std > LARGEST_STD) {
        sentences.push(format!(
            "{name} is not determined by these data: its standard uncertainty is {:.0} % of its value; prescribe {name} or \
             measure with less noise",
            100.0 * std
        ));
    }
    for row in 0..names.len() {
        for column in 0..row {
            let value = correlation[(row, column)];
            if value.abs() > LARGEST_CORRELATION {
                let (a, b) = (names[column], names[row]);
                // The one that is known less is the one to prescribe.
                let weak = if relative_std[column] > relative_std[row] { a } else { b };
                sentences.push(format!(
                    "{weak} is not determined by these data: {a} and {b} are correlated {value:.3}; prescribe {weak} or add \
                     another mode mixity"
                ));
            }
        }
    }
    let (values, vectors) = eigen;
    let (least, most) = (values[0].max(0.0).sqrt(), values[values.len() - 1].max(0.0).sqrt());
    let condition = if least > 0.0 { most / least } else { f64::INFINITY };
    if !(condition <= LARGEST_CONDITION) {
        let weakest =
            (0..names.len()).fold(0, |k, j| if vectors[(j, 0)].abs() > vectors[(k, 0)].abs() { j } else { k });
        let name = names[weakest];
        sentences.push(format!(
            "the condition number of the scaled Jacobian is {condition:.0}: the data hardly tell {name}; prescribe {name} or add \
             another mode mixity"
        ));
    }
    let determined = sentences.is_empty();
    if determined {
        sentences.push(format!(
            "{} determined by these data",
            match names {
                [one] => format!("{one} is"),
                several => format!("{} are", several.join(", ")),
            }
        ));
    }
    let thresholds = format!(
        "not determined: standard uncertainty above {:.0} %, correlation above {LARGEST_CORRELATION} in magnitude, or \
         condition number of the scaled Jacobian above {LARGEST_CONDITION}",
        100.0 * LARGEST_STD
    );
    Verdict { determined, sentences, thresholds }
}
