//! Energy release of a run: the J-integral, and the work of separation by mode along the joint.

use super::JointReport;
use crate::io::joint::write_table;
use crate::mechanics::{Instant, JFault, JIntegral, ModeWork, phase_deg};
use crate::report::version;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// The J-integral at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct JSummary {
    /// Mean over three domains.
    #[serde(rename = "J_N_per_mm")]
    pub j_n_per_mm: f64,
    /// Largest difference of two domains.
    #[serde(rename = "spread_N_per_mm")]
    pub spread_n_per_mm: f64,
    /// The same from the tractions of the joint.
    #[serde(rename = "of_tractions_N_per_mm")]
    pub of_tractions_n_per_mm: f64,
    /// Whether the front moves along the tangent of the joint.
    pub along: bool,
    /// Where the domains lie along the joint, from its first pair.
    pub window_mm: [f64; 2],
}

impl From<JIntegral> for JSummary {
    fn from(JIntegral { value, spread, of_tractions, along, window }: JIntegral) -> Self {
        let [j_n_per_mm, spread_n_per_mm, of_tractions_n_per_mm] = [value, spread, of_tractions];
        Self { j_n_per_mm, spread_n_per_mm, of_tractions_n_per_mm, along, window_mm: window }
    }
}

impl JointReport<'_> {
    /// That of instant `number`, from 1.
    pub(super) fn j_integral(&self, number: usize) -> Option<JSummary> {
        Some(JSummary::from((*self.j_integrals.get(number - 1)?)?.ok()?))
    }

    /// Why no instant has one.
    pub(super) fn no_j_integral(&self) -> Option<String> {
        let faults: Option<Vec<JFault>> = self.j_integrals.iter().flatten().map(|found| found.err()).collect();
        faults?.last().map(JFault::to_string)
    }

    /// Work of separation by mode at every pair, by solved instant.
    fn mode_works(&self) -> Vec<(usize, &Instant, Vec<ModeWork>)> {
        let fields = self.solved().map(|(_, instant)| &instant.displacement);
        let works = self.joint.model.mode_works(&*self.joint.law, fields);
        self.solved().zip(works).map(|((number, instant), works)| (number, instant, works)).collect()
    }

    /// Share of sliding in the work at the pair nearest to the crack front, by the number of the instant.
    pub(super) fn sliding_at_front(&self) -> BTreeMap<usize, f64> {
        let model = &self.joint.model;
        let positions = model.pair_positions();
        let share = |(number, instant, works): &(usize, &Instant, Vec<ModeWork>)| {
            let front = model.crack_front(&*self.joint.law, &instant.displacement)?;
            let off = |(_, along): &([f64; 2], f64)| (along - front).abs();
            let (pair, _) = positions.iter().enumerate().min_by(|a, b| off(a.1).total_cmp(&off(b.1)))?;
            Some((*number, works.get(pair)?.sliding_share()?))
        };
        self.mode_works().iter().filter_map(share).collect()
    }

    /// Writes `j-integral.csv`: the instants that have one.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_j_integral<W: Write>(&self, out: W) -> io::Result<()> {
        let about = "energy by length of front and mm of width: mean and spread of three domains; from the tractions of \
                     the joint";
        let columns = ["instant", "J_N_per_mm", "spread_N_per_mm", "of_tractions_N_per_mm", "from_mm", "to_mm"]
            .map(str::to_owned);
        let rows = (1..).zip(self.j_integrals).filter_map(|(number, found)| {
            let JIntegral { value, spread, of_tractions, window: [from, to], .. } = found.as_ref()?.as_ref().ok()?;
            Some((vec![number], vec![*value, *spread, *of_tractions, *from, *to]))
        });
        write_table(out, &[version(), about.to_owned()], &columns, rows)
    }

    /// Whether some instant has a J-integral.
    pub fn has_j_integral(&self) -> bool {
        self.j_integrals.iter().flatten().any(Result::is_ok)
    }

    /// Writes `mode-mixity.csv`: the work of separation by mode at every pair, and the phase of its traction.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_mode_mixity<W: Write>(&self, mut out: W) -> io::Result<()> {
        let model = &self.joint.model;
        writeln!(
            out,
            "# {}\n# work of separation done so far by opening and by sliding, share of sliding in it (empty: no work), \
             phase of the traction: 0 opens, 90 slides\n\
             instant,lower_node,upper_node,x_mm,y_mm,G_opening_N_per_mm,G_sliding_N_per_mm,sliding_share,phase_deg",
            version()
        )?;
        let positions = model.pair_positions();
        for (number, instant, works) in self.mode_works() {
            let tractions = model.tractions(&*self.joint.law, &instant.displacement);
            for (k, ([lower, upper], work)) in model.mesh().pairs().iter().zip(&works).enumerate() {
                let [x, y] = positions[k].0;
                let share = work.sliding_share().map_or(String::new(), |share| format!("{share:.16e}"));
                let (opening, sliding, phase) = (work.opening, work.sliding, phase_deg(tractions[k]));
                writeln!(
                    out,
                    "{number},{lower},{upper},{x:.16e},{y:.16e},{opening:.16e},{sliding:.16e},{share},{phase:.16e}"
                )?;
            }
        }
        Ok(())
    }
}
