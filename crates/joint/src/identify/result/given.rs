//! What a fit takes for granted, in words: the values that its intervals are conditional on.

use crate::identify::{Constant, ConstantKind, Problem, Released, ReleasedParameter};

impl Problem<'_> {
    /// The prescribed values: parameters of the law and of the strips, thickness, width, size of a pixel.
    pub(crate) fn given(&self) -> Vec<String> {
        let law = self.unknowns.law();
        let fitted = |index: usize| self.unknowns.list().iter().any(|unknown| unknown.index == index);
        let values = law.values();
        let mut given: Vec<String> = (law.parameters().iter().enumerate())
            .filter(|(index, _)| !fitted(*index))
            .map(|(index, p)| format!("{} = {}", p.name, quantity(values[index], p.unit)))
            .collect();
        let model = &self.joint.model;
        let of_materials = self.unknowns.of_materials();
        let materials: Vec<Vec<String>> = (model.materials().iter().enumerate())
            .map(|(group, law)| {
                let is_fitted = |k: usize| of_materials.iter().any(|of| of.index == k && of.groups.contains(&group));
                let values = law.parameters().iter().zip(law.values()).enumerate().filter(|(k, _)| !is_fitted(*k));
                values.map(|(_, (p, v))| format!("{} = {}", p.name, quantity(v, p.unit))).collect()
            })
            .collect();
        let alike = materials.windows(2).all(|pair| pair[0] == pair[1]);
        for (group, list) in model.mesh().groups().iter().zip(&materials) {
            given.extend(list.iter().map(|text| if alike { text.clone() } else { format!("{text} ({group})") }));
            if alike {
                break;
            }
        }
        let has_adhesive = !model.mesh().interfaces().is_empty();
        given.extend(has_adhesive.then(|| format!("thickness = {}", quantity(model.mesh().gap(), "mm"))));
        let cell = self.observation.force.as_ref();
        given.extend(cell.map(|cell| format!("width = {}", quantity(cell.width_mm, "mm"))));
        given.extend(self.observation.pixel_size_mm.map(|mm| format!("1 px = {}", quantity(mm, "mm"))));
        given
    }

    /// Standard uncertainty of each released parameter as a prescribed one; zero where it is exact.
    pub(crate) fn prescribed_std(&self, released: &Released, constants: &[Constant]) -> Vec<f64> {
        let parameters = self.unknowns.law().parameters();
        let std_of = |p: &ReleasedParameter| {
            let same =
                |kind: &ConstantKind| matches!(kind, ConstantKind::Law { index } if parameters[*index].name == p.name);
            constants.iter().find(|constant| same(&constant.kind)).map_or(0.0, |constant| constant.std)
        };
        released.parameters.iter().map(std_of).collect()
    }
}

/// A value with its unit as people say it: MPa above a thousand as GPa, mm below a half as um; up to five digits.
fn quantity(value: f64, unit: &str) -> String {
    let (value, unit) = match unit {
        "MPa" if value.abs() >= 1e3 => (1e-3 * value, "GPa"),
        "mm" if value.abs() < 0.5 => (1e3 * value, "um"),
        "1" => (value, ""),
        unit => (value, unit),
    };
    let rounded = format!("{value:.4e}").parse::<f64>().unwrap_or(value);
    format!("{rounded} {unit}").trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::quantity;

    #[test]
    fn values_are_said_in_the_units_of_people() {
        assert_eq!(quantity(72000.0, "MPa"), "72 GPa");
        assert_eq!(quantity(72.0, "MPa"), "72 MPa");
        assert_eq!(quantity(0.00193125, "mm"), "1.9313 um");
        assert_eq!(quantity(4.0, "1"), "4");
    }
}
