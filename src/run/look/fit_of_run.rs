//! What the page of a run shows beside its fields: the fit of a joint, and what its model is off by.

use crate::camera::Rectifier;
use crate::field::{Measurement, Status};
use crate::io::joint::read_joint;
use crate::io::store::Store;
use crate::linalg::Dense;
use crate::mechanics::Joint;
use crate::report::fit::{
    FitRecord, JointSensitivity, LawRows, LawSensitivity, TractionRows, read_bands, read_joint_sensitivities, read_law,
    read_law_sensitivities,
};
use crate::report::identification::measured_mm;
use crate::report::view::LawView;
use crate::run::folder::correlation_in;
use crate::run::folder::read::{fields, frames_that, read_json};
use crate::run::joint::{FIT, JOINT_SENSITIVITIES, LAW_SENSITIVITIES};
use crate::run::words::Result;
use crate::units::{Mm, PixelSize, Px, Vector};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use std::collections::BTreeMap;
use std::path::Path;

/// The case of the joint in the folder of a run.
const JOINT_CASE: &str = "identify.toml";

/// The records of a fit.
#[derive(Debug)]
pub struct FitOfRun {
    fit: FitRecord,
    law: [LawRows; 2],
    law_by: Option<[LawSensitivity; 2]>,
    bands: Vec<TractionRows>,
    joint: Vec<JointSensitivity>,
    inverse: Option<Vec<Vec<f64>>>,
    limit: f64,
}

impl FitOfRun {
    /// Those in `folder`; `None` where nothing was fitted. Sensitivities that an earlier version did not write are left
    /// out.
    ///
    /// # Errors
    /// Files that are not what they should be.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        if !folder.join(FIT).is_file() || !folder.join("law.csv").is_file() {
            return Ok(None);
        }
        let fit: FitRecord = read_json(&folder.join(FIT))?;
        let unit = |unit: &str| {
            if unit == "1" { String::new() } else { format!("_{}", unit.replace('/', "_per_").replace('^', "")) }
        };
        let key = |name: &crate::report::Name| Some(format!("{name}{}", unit(&fit.parameters.get(name)?.unit)));
        let keys: Vec<String> = fit.parameter_order.iter().filter_map(key).collect();
        let (by_law, by_joint) = (folder.join(LAW_SENSITIVITIES), folder.join(JOINT_SENSITIVITIES));
        let law_by = by_law.is_file().then(|| read_law_sensitivities(&by_law, &keys)).transpose()?;
        let joint =
            by_joint.is_file().then(|| read_joint_sensitivities(&by_joint, &keys)).transpose()?.unwrap_or_default();
        let freedom = keys.len().max(1) as f64;
        Ok(Some(Self {
            law: read_law(&folder.join("law.csv"))?,
            bands: read_bands(&folder.join("traction-bands.csv")).unwrap_or_default(),
            inverse: fit.covariance.as_deref().and_then(inverse),
            limit: ChiSquared::new(freedom).map_or(f64::INFINITY, |law| law.inverse_cdf(0.95)),
            law_by,
            joint,
            fit,
        }))
    }

    /// As the page takes them.
    pub fn view(&self) -> LawView<'_> {
        let Self { fit, law, law_by, bands, joint, inverse, limit } = self;
        LawView { fit, law, law_by: law_by.as_ref(), bands, joint, inverse: inverse.clone(), limit: *limit }
    }
}

/// The inverse of a covariance, found of the correlation: parameters may be of very different size.
#[expect(clippy::indexing_slicing, reason = "a square matrix, whose rows were counted")]
fn inverse(covariance: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let n = covariance.len();
    let std: Vec<f64> = (0..n).map(|k| covariance[k].get(k).copied().unwrap_or(0.0).sqrt()).collect();
    if n == 0 || covariance.iter().any(|row| row.len() != n) || std.iter().any(|std| !(std.is_finite() && *std > 0.0)) {
        return None;
    }
    let correlation = Dense::from_fn(n, n, |r, c| covariance[r][c] / (std[r] * std[c]));
    let inverse = correlation.cholesky().ok()?.solve(&Dense::from_fn(n, n, |r, c| f64::from(u8::from(r == c))));
    Some((0..n).map(|r| (0..n).map(|c| inverse[(r, c)] / (std[r] * std[c])).collect()).collect())
}

/// What a model is off by, px, by the number of the frame: of every node of the correlation, NaN where it is not known.
pub type Off = BTreeMap<usize, Vec<[f64; 2]>>;

/// The displacement of the model less that measured, px of the image, by the number of the frame: of every node of the
/// correlation, NaN where one of them is not known. `None` where no model was computed for the frames of the run in
/// `folder`.
///
/// # Errors
/// Files that are not what they should be.
pub fn model_less_measured(folder: &Path) -> Result<Option<Off>> {
    let case = folder.join(JOINT_CASE);
    let correlation = correlation_in(folder);
    if !case.is_file() || !folder.join("solution.csv").is_file() || !correlation.is_dir() {
        return Ok(None);
    }
    let store = Store::open(&correlation)?;
    let Some(pixel_size) = store.header().pixel_size else { return Ok(None) };
    let joint = Joint::new(&read_joint(&case)?)?;
    let converged = frames_that(|status| status == Some(Status::Converged), &store)?;
    let computed = fields(folder, &joint, converged.len())?;
    let camera = Rectifier::new(store.header().camera()?, store.mesh())?;
    let mut off = Off::new();
    for (at, (&number, computed)) in converged.iter().zip(&computed).enumerate() {
        let Some(frame) = store.frame(number)? else { continue };
        off.extend(
            off_at(&joint, pixel_size, at, computed, &camera.displaced(&frame.measurement)).map(|off| (number, off)),
        );
    }
    Ok((!off.is_empty()).then_some(off))
}

/// The same of the instant `at`, NaN in zones beside the joint; `None` where the model has other nodes than its zones.
pub(crate) fn off_at(
    joint: &Joint,
    pixel_size: PixelSize,
    at: usize,
    computed: &[[f64; 2]],
    field: &Measurement<Px>,
) -> Option<Vec<[f64; 2]>> {
    let n_nodes = field.mesh.n_nodes();
    let are_zones = |zone: usize| field.mesh.zone_nodes(zone).end == computed.len();
    if computed.len() < n_nodes && !(0..field.mesh.zones().len()).any(are_zones) {
        return None;
    }
    let (sin, cos) = joint.removed.get(at).map_or(0.0, |motion| motion.rotation_rad).sin_cos();
    let of_node = |(node, [x, y]): (usize, &[f64; 2])| {
        let [measured_x, measured_y] = measured_mm(field, pixel_size, joint, at, node)?;
        let [x, y] = [x - measured_x, y - measured_y];
        Some(pixel_size.to_px(Vector::<Mm>::new([cos * x - sin * y, sin * x + cos * y])).components())
    };
    let of_joint = computed.iter().enumerate().map(|node| of_node(node).unwrap_or([f64::NAN; 2]));
    Some(of_joint.chain(std::iter::repeat([f64::NAN; 2])).take(n_nodes).collect())
}

#[cfg(test)]
mod tests {
    use super::inverse;

    #[test]
    fn the_inverse_of_a_covariance_of_parameters_of_very_different_size_is_one() {
        let covariance = vec![vec![1e-12, 4e-7], vec![4e-7, 1.0]];
        let inverse = inverse(&covariance).unwrap();
        for r in 0..2 {
            for c in 0..2 {
                let product: f64 = (0..2).map(|k| covariance[r][k] * inverse[k][c]).sum();
                let one = f64::from(u8::from(r == c));
                // Of terms as large as the ratio of the standard uncertainties.
                assert!(
                    (product - one).abs() < 1e-9 * f64::max([[1.0, 1e-6], [1e6, 1.0]][r][c], 1.0),
                    "{r} {c} {product}"
                );
            }
        }
        assert!(super::inverse(&[vec![0.0]]).is_none() && super::inverse(&[]).is_none());
    }
}
