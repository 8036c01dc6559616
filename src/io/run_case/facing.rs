//! How the two zones of a joint face each other.

use crate::io::case::{CaseGuard, CaseZone};

/// Checks that the zones called `names` (below, above) face each other, makes their elements begin at the facing edges, and leaves
/// `guard` px out along these. Gives the gap, px.
pub(super) fn face_each_other(
    zones: &mut [CaseZone],
    names: &[String; 2],
    guard: f64,
    element: f64,
    notes: &mut Vec<String>,
) -> Result<f64, String> {
    let there = zones.iter().map(|zone| format!("\"{}\"", zone.name.as_deref().unwrap_or(""))).collect::<Vec<_>>();
    let there = if there.is_empty() { "no zone".to_owned() } else { there.join(", ") };
    let mut at = [0; 2];
    for (at, name) in at.iter_mut().zip(names) {
        *at = zones.iter().position(|zone| zone.name.as_ref() == Some(name)).ok_or_else(|| {
            format!(
                "[interface] zones names \"{name}\", but the case has {there}; add a [[zone]] with name = \"{name}\""
            )
        })?;
    }
    if at[0] == at[1] {
        return Err(format!(
            "[interface] zones names \"{}\" twice; name the zones below and above the adhesive",
            names[0]
        ));
    }
    if zones.len() != 2 {
        return Err(format!("there are {} zones ({there}); a joint has two, those of [interface]", zones.len()));
    }
    let mut boxes = [[0.0; 4]; 2];
    for (corners, &at) in boxes.iter_mut().zip(&at) {
        let zone = &zones[at];
        let name = zone.name.as_deref().unwrap_or("");
        let plain = zone.polygon.is_none() && zone.mask.is_none() && zone.mesh.is_none();
        *corners = zone.roi.filter(|_| plain).ok_or_else(|| {
            format!(
                "zone \"{name}\": quadrille run needs a rectangle, roi = [x0, y0, x1, y1], and no polygon, mask or mesh"
            )
        })?;
        if !(corners.iter().all(|v| v.is_finite()) && corners[0] < corners[2] && corners[1] < corners[3]) {
            return Err(format!(
                "zone \"{name}\": roi = {corners:?} is no rectangle; give x0, y0, x1, y1 with x0 < x1 and y0 < y1"
            ));
        }
    }
    let [lower, upper] = &mut boxes;
    let gap = lower[1] - upper[3];
    let aside = lower[0] >= upper[2] || upper[0] >= lower[2];
    if aside || gap < 0.0 {
        let swapped = !aside && upper[1] >= lower[3];
        let hint = if swapped {
            format!("; y is down: swap the names, zones = [\"{}\", \"{}\"]", names[1], names[0])
        } else {
            String::new()
        };
        return Err(format!(
            "[interface] zone \"{}\" does not lie below zone \"{}\" with a gap between them{hint}",
            names[0], names[1]
        ));
    }
    // Whole elements are laid from the upper edge of a rectangle: here from the face of the adhesive upwards.
    let rows = ((upper[3] - upper[1]) / element + 1e-9).floor();
    let top = upper[3] - rows * element;
    if rows >= 1.0 && (top - upper[1]).abs() > 1e-9 {
        notes.push(format!(
            "zone \"{}\": its elements are laid from its lower edge, the face of the adhesive; y0 = {top}",
            names[1]
        ));
        upper[1] = top;
    }
    // Rounding must not take the last row away.
    upper[3] = upper[1] + rows.max(1.0) * element;
    for ((&at, corners), below) in at.iter().zip(boxes).zip([true, false]) {
        let zone = &mut zones[at];
        zone.roi = Some(corners);
        if zone.guard_px.is_none() {
            let (top, bottom) = if below { (guard, 0.0) } else { (0.0, guard) };
            zone.guard_px = Some(CaseGuard::Rectangle { left: 0.0, top, right: 0.0, bottom });
        }
    }
    Ok(gap)
}
