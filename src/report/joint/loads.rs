//! Loads of a run: reactions of groups of nodes, the load-displacement curve, energies and their balance.

use super::JointReport;
use crate::mechanics::{Energies, Instant, RigidBlock, Status};
use crate::report::{Picture, Plot, PlotSeries, ReportError, Style, version};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// The reaction of a group of nodes at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ReactionSummary {
    /// The force from outside on the nodes of the group (of supports, rigid bodies and loads), along x and y.
    #[serde(rename = "force_N_per_mm")]
    pub force_n_per_mm: [f64; 2],
    /// Mean displacement of the prescribed nodes, of all of a free component; of a rigid body that of its point.
    pub displacement_mm: [f64; 2],
}

/// Energies at an instant, mJ per mm of width.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EnergySummary {
    /// Work that the reactions have done.
    pub work: f64,
    /// Elastic energy of the strips.
    pub elastic: f64,
    /// Plastic work in the strips.
    pub plastic: f64,
    /// Work done on the adhesive.
    pub adhesive: f64,
    /// Work less all energies.
    pub imbalance: f64,
    /// Whether the sums have settled: not where pairs snapped.
    pub settled: bool,
}

impl From<Energies> for EnergySummary {
    fn from(energies: Energies) -> Self {
        let Energies { work, elastic, plastic, adhesive, settled } = energies;
        Self { work, elastic, plastic, adhesive, imbalance: energies.imbalance(), settled }
    }
}

/// How the energies of a run balance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Balance {
    /// Unit of all energies.
    pub unit: &'static str,
    /// Largest imbalance over the largest work, up to the last instant at which the sums have settled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative: Option<f64>,
    /// That instant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up_to_instant: Option<usize>,
    /// Share of the work that the test lost in snaps by its last instant; absent without snaps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lost_in_snaps: Option<f64>,
    /// Share of the work that is not accounted for by the last instant because the path was not followed finely
    /// enough; absent where it was, or where pairs snap.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_followed: Option<f64>,
}

impl Balance {
    /// In words, for people.
    pub fn text(&self) -> String {
        let settled = match (self.relative, self.up_to_instant) {
            (Some(share), Some(k)) => Some((format!("energies balance to {share:.1e} of the work"), k)),
            _ => None,
        };
        let why = match (self.lost_in_snaps, self.not_followed) {
            (Some(lost), _) => format!("pairs snap, in which {:.3} % of the work is lost", 100.0 * lost),
            (None, Some(open)) => format!(
                "the path between the instants was not followed finely enough, and {:.1e} of the work is not accounted for",
                open.abs()
            ),
            (None, None) => return settled.map_or("energies: no work was done".to_owned(), |(balance, _)| balance),
        };
        match settled {
            Some((balance, k)) => format!("{balance} up to instant {k}; after it {why}"),
            None => format!("energies: from the first instant on {why}"),
        }
    }
}

impl JointReport<'_> {
    /// Reaction and mean displacement of each group, in their order.
    fn reactions(&self, instant: &Instant) -> Vec<ReactionSummary> {
        let (model, groups) = (&self.joint.model, &self.joint.groups);
        let forces = model.reactions(&*self.joint.law, &instant.displacement, groups);
        let mean = |nodes: &[u32]| {
            // Of a rigid body it is that of its point.
            let blocks = model.supports().blocks.iter().zip(model.block_displacements(&instant.displacement));
            let same =
                |block: &RigidBlock| block.nodes.len() == nodes.len() && block.nodes.iter().all(|n| nodes.contains(n));
            if let Some((block, moved)) = blocks.into_iter().find(|(block, _)| same(block)) {
                let middle = |c: usize| nodes.iter().map(|&node| instant.displacement[node as usize][c]).sum::<f64>();
                return [0, 1].map(|c| if block.tied[c] { moved[c] } else { middle(c) / nodes.len() as f64 });
            }
            // Of the nodes whose component is held, or of all where it is free.
            [0, 1].map(|c| {
                let held = nodes.iter().filter(|&&node| model.unknown(node as usize, c).is_none());
                let some = held.clone().next().is_some();
                let of: Vec<&u32> = if some { held.collect() } else { nodes.iter().collect() };
                of.iter().map(|&&node| instant.displacement[node as usize][c]).sum::<f64>() / of.len() as f64
            })
        };
        (groups.iter().zip(forces))
            .map(|(group, force_n_per_mm)| ReactionSummary { force_n_per_mm, displacement_mm: mean(&group.nodes) })
            .collect()
    }

    pub(super) fn reactions_of(&self, instant: &Instant) -> BTreeMap<String, ReactionSummary> {
        self.joint.groups.iter().map(|group| group.name.clone()).zip(self.reactions(instant)).collect()
    }

    /// The energies that were computed, with the numbers of their instants.
    fn known_energies(&self) -> Vec<(usize, Energies)> {
        (1..).zip(self.energies).filter_map(|(number, energies)| Some((number, (*energies)?))).collect()
    }

    pub(super) fn balance(&self) -> Option<Balance> {
        let known = self.known_energies();
        let last = known.last()?.1;
        let settled: Vec<&(usize, Energies)> = known.iter().take_while(|(_, energies)| energies.settled).collect();
        let largest = |of: &dyn Fn(&Energies) -> f64| settled.iter().map(|(_, e)| of(e).abs()).fold(0.0, f64::max);
        let (imbalance, work) = (largest(&Energies::imbalance), largest(&|e| e.work));
        let missing = (!last.settled && last.work != 0.0).then(|| last.imbalance() / last.work);
        let snaps = self.solved().any(|(_, instant)| instant.status == Status::Rescued);
        Some(Balance {
            unit: "mJ per mm of width",
            relative: (work > 0.0).then(|| imbalance / work),
            up_to_instant: settled.last().map(|(number, _)| *number),
            lost_in_snaps: missing.filter(|_| snaps),
            not_followed: missing.filter(|_| !snaps),
        })
    }

    /// Writes `reactions.csv`: force and mean displacement of every group.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_reactions<W: Write>(&self, mut out: W) -> io::Result<()> {
        let about =
            "force that holds the prescribed nodes of each group, N per mm of width; their mean displacement, mm";
        writeln!(out, "# {}\n# {about}", version())?;
        let mut out = csv::Writer::from_writer(out);
        out.write_record(["instant", "group", "ux_mm", "uy_mm", "Fx_N_per_mm", "Fy_N_per_mm"])?;
        for (number, instant) in self.solved() {
            for (group, reaction) in self.joint.groups.iter().zip(self.reactions(instant)) {
                let ReactionSummary { force_n_per_mm: [fx, fy], displacement_mm: [ux, uy] } = reaction;
                let numbers = [ux, uy, fx, fy].map(|v| format!("{v:.16e}"));
                let cells = [number.to_string(), group.name.clone()];
                out.write_record(cells.iter().chain(&numbers))?;
            }
        }
        out.flush()
    }

    /// Writes `energies.csv`.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_energies<W: Write>(&self, mut out: W) -> io::Result<()> {
        let about = "mJ per mm of width; work of the reactions = elastic + plastic + adhesive + imbalance";
        writeln!(out, "# {}\n# {about}\ninstant,work,elastic,plastic,adhesive,imbalance,settled", version())?;
        for (number, energies) in self.known_energies() {
            let EnergySummary { work, elastic, plastic, adhesive, imbalance, settled } = energies.into();
            let settled = u8::from(settled);
            writeln!(
                out,
                "{number},{work:.16e},{elastic:.16e},{plastic:.16e},{adhesive:.16e},{imbalance:.16e},{settled}"
            )?;
        }
        Ok(())
    }

    /// Force over mean displacement of every group, of the component that does the most work.
    pub(super) fn load_displacement(&self) -> Result<Picture, ReportError> {
        let reactions: Vec<Vec<ReactionSummary>> = self.solved().map(|(_, instant)| self.reactions(instant)).collect();
        let done = |c: usize| -> f64 {
            let of_group = |k: usize| {
                let (mut before, mut sum) = ([0.0; 2], 0.0);
                for at in &reactions {
                    let [f, u] = [at[k].force_n_per_mm[c], at[k].displacement_mm[c]];
                    sum += 0.5 * (before[0] + f) * (u - before[1]);
                    before = [f, u];
                }
                sum.abs()
            };
            (0..self.joint.groups.len()).map(of_group).sum()
        };
        let c = usize::from(done(1) >= done(0));
        let axis = ["x", "y"][c];
        let series = self.joint.groups.iter().enumerate().map(|(k, group)| {
            let column = |of: fn(&ReactionSummary) -> [f64; 2]| {
                std::iter::once(0.0).chain(reactions.iter().map(|at| of(&at[k])[c])).collect::<Vec<f64>>()
            };
            let (x, y) = (column(|reaction| reaction.displacement_mm), column(|reaction| reaction.force_n_per_mm));
            PlotSeries::new(&group.name, Style::LineAndMarkers, x, y)
        });
        let x = format!("mean displacement along {axis} (mm)");
        let y = format!("reaction along {axis} (N per mm of width)");
        let plot = Plot::new("Load and displacement", x, y, series);
        plot.with_note("A marker for each instant; groups of nodes as in [groups].").draw()
    }

    /// Energies over the instants.
    pub(super) fn energy_curves(&self) -> Result<Picture, ReportError> {
        let known = self.known_energies();
        let curve = |name: &str, style: Style, of: &dyn Fn(&Energies) -> f64| {
            let points = known.iter().map(|(number, energies)| (*number as f64, of(energies)));
            let (x, y) = std::iter::once((0.0, 0.0)).chain(points).unzip();
            PlotSeries::new(name, style, x, y)
        };
        let series = [
            curve("work of the reactions", Style::LineAndMarkers, &|e| e.work),
            curve("elastic", Style::Line, &|e| e.elastic),
            curve("plastic", Style::Line, &|e| e.plastic),
            curve("adhesive", Style::Line, &|e| e.adhesive),
            curve("sum of the three", Style::Dashed, &|e| e.elastic + e.plastic + e.adhesive),
        ];
        let notes = self.balance().map(|balance| balance.text()).into_iter().collect();
        Plot { notes, ..Plot::new("Energies", "instant", "mJ per mm of width", series) }.draw()
    }
}
