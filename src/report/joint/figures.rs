//! The figures of a run: deformed joint, tractions along the adhesive, maps of the derivatives.

use super::{JointMap, JointProfiles, JointReport};
use crate::io::text::file_name;
use crate::mechanics::cohesive::Traction;
use crate::report::{Picture, ReportError};

/// Share of what stands beside it, below which a result is nothing but rounding.
const ROUNDING: f64 = 1e-9;

impl JointReport<'_> {
    /// The instants to draw: those `asked` for that have a solution, or the first, the middle and the last one.
    pub fn chosen(&self, asked: Option<&[usize]>) -> Vec<usize> {
        let solved: Vec<usize> = self.solved().map(|(number, _)| number).collect();
        let mut chosen: Vec<usize> = match (asked, solved.as_slice()) {
            (Some(asked), _) => asked.iter().copied().filter(|instant| solved.contains(instant)).collect(),
            (None, []) => Vec::new(),
            (None, [first, .., last]) => vec![*first, solved[solved.len() / 2], *last],
            (None, [only]) => vec![*only],
        };
        chosen.dedup();
        chosen
    }

    /// Draws the deformed joint and the tractions at the `chosen` instants, loads and energies over all of them, and
    /// the derivatives at the last of those chosen; `save` is
    /// called with the name (without ending) of each picture.
    ///
    /// # Errors
    /// A picture without a finite range, and what `save` refuses.
    pub fn draw<E: From<ReportError>>(
        &self,
        chosen: &[usize],
        mut save: impl FnMut(String, Picture) -> Result<(), E>,
    ) -> Result<(), E> {
        let Some(&last) = chosen.iter().max() else { return Ok(()) };
        for &number in chosen {
            save(format!("{number:06}-deformed"), self.deformed(number)?)?;
        }
        let profiles = [
            ("tn", self.profiles(chosen, |t| t.normal, "Normal traction along the joint", "T_n (MPa)")),
            ("tt", self.profiles(chosen, |t| t.tangential, "Tangential traction along the joint", "T_t (MPa)")),
        ];
        // Of a symmetric joint one component is nothing but rounding.
        let largest = profiles.each_ref().map(|(_, profiles)| profiles.largest());
        for ((name, profiles), own) in profiles.iter().zip(largest) {
            if own > ROUNDING * largest[0].max(largest[1]) {
                save(format!("{last:06}-{name}"), profiles.draw()?)?;
            }
        }
        if !self.joint.groups.is_empty() {
            save("load-displacement".to_owned(), self.load_displacement()?)?;
        }
        if self.energies.iter().any(Option::is_some) {
            save("energies".to_owned(), self.energy_curves()?)?;
        }
        for (k, sensitivity) in self.solution.parameters.iter().enumerate() {
            let name = self.name_of(sensitivity);
            let mut file = file_name(&name);
            if file != name {
                // Two names may look alike without the signs that file names do not hold.
                file = format!("{file}-{}", k + 1);
            }
            for (c, component) in ["ux", "uy"].into_iter().enumerate() {
                if let Some(map) = self.sensitivity(last, k, c)? {
                    save(format!("{last:06}-d{component}_d{file}"), map)?;
                }
            }
        }
        Ok(())
    }

    /// The map of the derivative of component `c` (0 for u_x, 1 for u_y) by parameter `k` at instant `number`; `None`
    /// where it is zero everywhere.
    ///
    /// # Errors
    /// Values without a finite range.
    pub fn sensitivity(&self, number: usize, k: usize, c: usize) -> Result<Option<Picture>, ReportError> {
        let sensitivity = &self.solution.parameters[k];
        let name = self.name_of(sensitivity);
        let component = ["u_x", "u_y"][c];
        let unit = match sensitivity.parameter.unit {
            "1" => "mm".to_owned(),
            unit => format!("mm per {unit}"),
        };
        let values: Vec<f64> = self.solution.instants[number - 1].sensitivities[k].iter().map(|v| v[c]).collect();
        let instant = &self.solution.instants[number - 1];
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0_f64, |most, v| most.max(v.abs()));
        let moved = largest(&mut instant.displacement.iter().flatten().copied());
        // A change by all of the parameter moves nothing.
        if largest(&mut values.iter().copied()) * self.value_of(sensitivity).abs() <= ROUNDING * moved {
            return Ok(None);
        }
        let map = JointMap {
            title: format!("Sensitivity of {component} to {name} at instant {number}"),
            label: format!("d {component} / d {name} ({unit})"),
            notes: Vec::new(),
            nodes: self.joint.model.mesh().nodes(),
            elements: self.joint.model.mesh().elements(),
            values: &values,
        };
        map.draw().map(Some)
    }

    /// The joint at instant `number` with its displacements enlarged, coloured by the equivalent stress.
    ///
    /// # Errors
    /// Values without a finite range.
    pub fn deformed(&self, number: usize) -> Result<Picture, ReportError> {
        let model = &self.joint.model;
        let (mesh, u) = (model.mesh(), &self.solution.instants[number - 1].displacement);
        let largest = u.iter().flatten().fold(0.0_f64, |most, u| most.max(u.abs()));
        // A round factor that makes the motion about a tenth of the joint's size.
        let wanted = 0.1 * mesh.extent() / largest.max(f64::MIN_POSITIVE);
        let factor = if wanted > 1.0 && wanted < 1e6 { 10f64.powf(wanted.log10().floor()) } else { 1.0 };
        let moved: Vec<[f64; 2]> =
            mesh.nodes().iter().zip(u).map(|(x, u)| [x[0] + factor * u[0], x[1] + factor * u[1]]).collect();
        // At the nodes: the mean of the elements around.
        let mut stress = vec![[0.0; 2]; u.len()];
        for (corners, states) in mesh.elements().iter().zip(model.states(u)) {
            for (&node, state) in corners.iter().zip(states) {
                stress[node as usize][0] += state.equivalent_stress;
                stress[node as usize][1] += 1.0;
            }
        }
        JointMap {
            title: format!("Deformed joint at instant {number}"),
            label: "equivalent stress (MPa)".into(),
            notes: vec![format!("displacements times {factor}; largest {largest:.3e} mm")],
            nodes: &moved,
            elements: mesh.elements(),
            values: &stress.iter().map(|[sum, n]| sum / n).collect::<Vec<_>>(),
        }
        .draw()
    }

    /// One component of the traction along the joint at the `chosen` instants.
    fn profiles(&self, chosen: &[usize], pick: fn(Traction) -> f64, title: &str, label: &str) -> JointProfiles {
        let (model, law) = (&self.joint.model, &*self.joint.law);
        let curve = |&number: &usize| {
            let u = &self.solution.instants[number - 1].displacement;
            let values = model.tractions(law, u).into_iter().map(pick).collect();
            (format!("instant {number}"), values, model.crack_front(law, u))
        };
        JointProfiles {
            title: title.into(),
            label: label.into(),
            instants: chosen.iter().map(curve).collect(),
            along: model.pair_positions().into_iter().map(|(_, along)| along).collect(),
            notes: vec![format!("crack front: where the normal jump reaches {:.3e} mm", law.front_opening())],
        }
    }
}
