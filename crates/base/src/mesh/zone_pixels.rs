//! Which pixels belong to a zone, and which of them its guard leaves.

use super::pixel_set::PixelSet;
use super::polygon;
use super::{Guard, MeshError, Roi, Zone};

/// The pixels of a zone: all of them, and those that its guard leaves.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ZonePixels {
    pub all: PixelSet,
    pub guarded: PixelSet,
}

/// Pixels whose centre lies in the half-open rectangle, `guard` (left, top, right, bottom) left out.
fn rectangle(roi: Roi, guard: [f64; 4], width: usize, height: usize) -> PixelSet {
    let first = |v: f64, n: usize| v.ceil().clamp(0.0, n as f64) as usize;
    PixelSet::Box {
        x0: first(roi.x0 + guard[0], width),
        y0: first(roi.y0 + guard[1], height),
        x1: first(roi.x1 - guard[2], width),
        y1: first(roi.y1 - guard[3], height),
    }
}

/// The pixels of `zone` on an image of `width` x `height` px; `of_elements`: those of its own elements, if any.
pub(super) fn zone_pixels(
    zone: &Zone,
    image: [usize; 2],
    of_elements: Option<PixelSet>,
) -> Result<ZonePixels, MeshError> {
    let ZonePixels { all, mut guarded } = of_region(zone, image, of_elements)?;
    for crack in zone.cracks.iter().filter(|crack| crack.guard > 0.0) {
        guarded = beside(&guarded, guarded.bounds().unwrap_or_default(), &crack.path, crack.guard);
    }
    Ok(ZonePixels { all, guarded })
}

/// The same without its cracks.
fn of_region(zone: &Zone, [width, height]: [usize; 2], of_elements: Option<PixelSet>) -> Result<ZonePixels, MeshError> {
    let roi = zone.bounds(width, height)?;
    check_guard(zone)?;
    if zone.is_rectangle() {
        let all = rectangle(roi, [0.0; 4], width, height);
        let guarded = match &zone.guard {
            Guard::All(g) => rectangle(roi, [*g; 4], width, height),
            Guard::Sides(sides) => rectangle(roi, [sides[0], sides[1], sides[2], sides[3]], width, height),
            Guard::Along { line, width } => beside(&all, all.bounds().unwrap_or_default(), line, *width),
        };
        return Ok(ZonePixels { all, guarded });
    }
    if let Some(mask) = &zone.mask
        && [mask.width(), mask.height()] != [width, height]
    {
        let (mask_width, mask_height) = (mask.width(), mask.height());
        return Err(MeshError::MaskSize { zone: zone.name.clone(), mask_width, mask_height, width, height });
    }
    let rectangle = rectangle(roi, [0.0; 4], width, height);
    let frame = rectangle.bounds().ok_or_else(|| MeshError::Empty(zone.name.clone()))?;
    let polygon = (!zone.polygon.is_empty()).then(|| polygon::fill(zone, &zone.polygon, frame)).transpose()?;
    let holes = zone.exclude.iter().map(|hole| polygon::fill(zone, hole, frame)).collect::<Result<Vec<_>, _>>()?;
    let all = PixelSet::raster(frame, |x, y| {
        polygon.as_ref().is_none_or(|polygon| polygon.contains(x, y))
            && !holes.iter().any(|hole| hole.contains(x, y))
            && zone.mask.as_ref().is_none_or(|mask| mask.contains(x, y))
            && of_elements.as_ref().is_none_or(|elements| elements.contains(x, y))
    });
    if all.bounds().is_none() {
        return Err(MeshError::Empty(zone.name.clone()));
    }
    let guarded = match &zone.guard {
        guard if guard.is_none() => all.clone(),
        Guard::All(guard) => without_border(&all, frame, *guard, [width, height]),
        Guard::Sides(guards) => PixelSet::raster(frame, |x, y| {
            // Pixels cover half a pixel around their centre: a set of whole pixels is shifted by that.
            let centre = [x as f64 + 0.5, y as f64 + 0.5];
            all.contains(x, y)
                && polygon::sides(&zone.polygon)
                    .zip(guards)
                    .all(|(side, guard)| polygon::distance(centre, side) >= *guard)
        }),
        Guard::Along { line, width } => beside(&all, frame, line, *width),
    };
    Ok(ZonePixels { all, guarded })
}

/// The pixels of `set` with their centre `width` or more from `line`, which may cut pixels: the centre decides.
fn beside(set: &PixelSet, frame: [usize; 4], line: &[[f64; 2]], width: f64) -> PixelSet {
    PixelSet::raster(frame, |x, y| {
        let centre = [x as f64, y as f64];
        set.contains(x, y) && line.windows(2).all(|ends| polygon::distance(centre, [ends[0], ends[1]]) >= width)
    })
}

fn check_guard(zone: &Zone) -> Result<(), MeshError> {
    let name = || zone.name.clone();
    let (guards, sides) = match &zone.guard {
        Guard::All(guard) | Guard::Along { width: guard, .. } => (std::slice::from_ref(guard), 1),
        Guard::Sides(guards) if zone.is_rectangle() => (guards.as_slice(), 4),
        Guard::Sides(guards) => (guards.as_slice(), zone.polygon.len()),
    };
    if guards.len() != sides {
        return Err(MeshError::GuardSides(name(), guards.len(), sides));
    }
    if let Guard::Along { line, .. } = &zone.guard
        && let Some(corner) = line.iter().position(|p| !p.iter().all(|v| v.is_finite()))
    {
        return Err(MeshError::NotFinite { zone: name(), corner });
    }
    match guards.iter().find(|guard| !(guard.is_finite() && **guard >= 0.0)) {
        Some(&guard) => Err(MeshError::Guard { zone: name(), guard }),
        None => Ok(()),
    }
}

/// The pixels of `set` farther than `guard` from those of the image that are not in it; its own border mixes nothing.
fn without_border(set: &PixelSet, frame: [usize; 4], guard: f64, [width, height]: [usize; 2]) -> PixelSet {
    let [x0, y0, x1, y1] = frame;
    // The pixels around the frame are outside of the set, those beyond the image do not exist.
    let (left, top) = (x0.saturating_sub(1), y0.saturating_sub(1));
    let (columns, rows) = ((x1 + 1).min(width) - left, (y1 + 1).min(height) - top);
    // Rows from each pixel to the nearest one outside in its column; `None` where there is none.
    let mut vertical: Vec<Option<usize>> = vec![None; columns * rows];
    for column in 0..columns {
        let mut pass = |row: usize, before: Option<usize>| {
            let own = &mut vertical[row * columns + column];
            let outside = !set.contains(left + column, top + row);
            let steps = if outside { Some(0) } else { before.map(|steps| steps + 1) };
            *own = [*own, steps].into_iter().flatten().min();
            *own
        };
        (0..rows).fold(None, |before, row| pass(row, before));
        (0..rows).rev().fold(None, |before, row| pass(row, before));
    }
    let kept = |x: usize, y: usize| {
        let (column, row) = (x - left, &vertical[(y - top) * columns..][..columns]);
        let mut nearest = f64::INFINITY;
        // Column by column away from the pixel, until no further one can be nearer or within the guard.
        for across in 0..columns {
            let distance = across as f64;
            if distance >= nearest || distance - 0.5 >= guard {
                break;
            }
            let beside = [column.checked_sub(across), Some(column + across)].into_iter().flatten();
            for steps in beside.filter_map(|column| row.get(column).copied().flatten()) {
                nearest = nearest.min(distance.hypot(steps as f64));
            }
        }
        // The border lies midway, half a pixel from both.
        nearest - 0.5 >= guard
    };
    PixelSet::raster(frame, |x, y| set.contains(x, y) && kept(x, y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_guard_along_a_line_leaves_out_what_is_near_it_and_no_other_border() {
        let corners = [[10.0, 30.0], [50.0, 10.0], [60.0, 30.0], [20.0, 50.0]];
        let line = vec![corners[0], corners[1]];
        let plain = Zone { name: "tilted".into(), polygon: corners.to_vec(), ..Zone::default() };
        let roi = Roi { x0: 8.0, y0: 8.0, x1: 64.0, y1: 52.0 };
        for zone in [plain, Zone::rectangle("box", roi)] {
            let zone = Zone { guard: Guard::Along { line: line.clone(), width: 3.0 }, ..zone };
            let ZonePixels { all, guarded } = zone_pixels(&zone, [80, 60], None).unwrap();
            let mut n_left_out = 0;
            for (x, y) in (0..60).flat_map(|y| (0..80).map(move |x| (x, y))) {
                // The line is (40, -20) long: distance of a point beside it.
                let (dx, dy) = (x as f64 - 10.0, y as f64 - 30.0);
                let along = (40.0 * dx - 20.0 * dy) / 2000.0;
                let ends = (dx.hypot(dy)).min((dx - 40.0).hypot(dy + 20.0));
                let distance =
                    if (0.0..=1.0).contains(&along) { (20.0 * dx + 40.0 * dy).abs() / 2000f64.sqrt() } else { ends };
                assert_eq!(guarded.contains(x, y), all.contains(x, y) && distance >= 3.0, "({x}, {y})");
                n_left_out += usize::from(all.contains(x, y) && !guarded.contains(x, y));
            }
            assert!(n_left_out > 100, "{n_left_out}"); // a band of 45 px by 3 px, within
        }
        let bad = |guard| zone_pixels(&Zone { guard, ..Zone::rectangle("box", roi) }, [80, 60], None).unwrap_err();
        assert!(matches!(bad(Guard::Along { line: line.clone(), width: -1.0 }), MeshError::Guard { .. }));
        let nowhere = Guard::Along { line: vec![[f64::NAN, 0.0], [1.0, 1.0]], width: 3.0 };
        assert!(matches!(bad(nowhere), MeshError::NotFinite { corner: 0, .. }));
    }

    #[test]
    fn a_guard_keeps_the_pixels_that_are_far_enough_from_every_pixel_outside() {
        let image = [40, 31];
        // Ragged, with holes, up to the border of the image at the left and below.
        let frame = [0, 3, 33, 31];
        let set = PixelSet::raster(frame, |x, y| (x * 7 + y * 13) % 41 > 0 && x + y < 50);
        for guard in [0.5, 1.0, 2.3, 3.0, 7.5, 1e9] {
            let found = without_border(&set, frame, guard, image);
            for (x, y) in (0..image[1]).flat_map(|y| (0..image[0]).map(move |x| (x, y))) {
                let outside = (0..image[1]).flat_map(|v| (0..image[0]).map(move |u| (u, v)));
                let outside = outside.filter(|&(u, v)| !set.contains(u, v));
                let nearest = outside.map(|(u, v)| (u as f64 - x as f64).hypot(v as f64 - y as f64));
                let want = set.contains(x, y) && nearest.fold(f64::INFINITY, f64::min) - 0.5 >= guard;
                assert_eq!(found.contains(x, y), want, "({x}, {y}), guard {guard}");
            }
        }
    }
}
