//! Which pixels belong to a zone.

use super::polygon;
use super::{Guard, MeshError, Roi, Zone};

/// A set of pixels of an image.
#[derive(Debug, Clone, PartialEq)]
pub enum PixelSet {
    /// Columns x0..x1 of rows y0..y1.
    Box {
        /// First column.
        x0: usize,
        /// First row.
        y0: usize,
        /// Column after the last.
        x1: usize,
        /// Row after the last.
        y1: usize,
    },
    /// Any pixels, by a raster.
    Raster {
        /// Column of the raster's first pixel.
        x0: usize,
        /// Row of the raster's first pixel.
        y0: usize,
        /// Columns of the raster.
        width: usize,
        /// Whether a pixel belongs to the set, row by row.
        bits: Vec<bool>,
    },
}

impl PixelSet {
    /// Whether the pixel in column `x` and row `y` belongs to the set.
    pub fn contains(&self, x: usize, y: usize) -> bool {
        match self {
            Self::Box { x0, y0, x1, y1 } => (*x0..*x1).contains(&x) && (*y0..*y1).contains(&y),
            Self::Raster { x0, y0, width, bits } => {
                let inside = x >= *x0 && x < x0 + width && y >= *y0;
                inside && bits.get((y - y0) * width + x - x0).copied().unwrap_or(false)
            }
        }
    }

    /// The smallest box `[x0, y0, x1, y1]` (the last two not included) that holds the set's pixels; `None`
    /// for the empty set.
    pub fn bounds(&self) -> Option<[usize; 4]> {
        match self {
            Self::Box { x0, y0, x1, y1 } => (x0 < x1 && y0 < y1).then_some([*x0, *y0, *x1, *y1]),
            Self::Raster { x0, y0, width, bits } => {
                let mut bounds: Option<[usize; 4]> = None;
                for at in bits.iter().enumerate().filter(|(_, bit)| **bit).map(|(at, _)| at) {
                    let (x, y) = (x0 + at % width, y0 + at / width);
                    let [bx0, by0, bx1, by1] = bounds.unwrap_or([x, y, x, y]);
                    bounds = Some([bx0.min(x), by0.min(y), bx1.max(x + 1), by1.max(y + 1)]);
                }
                bounds
            }
        }
    }

    /// Number of pixels of the set in columns `x0..x1` and rows `y0..y1`.
    pub fn count(&self, [x0, y0, x1, y1]: [usize; 4]) -> usize {
        match self {
            Self::Box { x0: bx0, y0: by0, x1: bx1, y1: by1 } => {
                let overlap = |a: usize, b: usize, c: usize, d: usize| b.min(d).saturating_sub(a.max(c));
                overlap(x0, x1, *bx0, *bx1) * overlap(y0, y1, *by0, *by1)
            }
            Self::Raster { .. } => (y0..y1).map(|y| (x0..x1).filter(|&x| self.contains(x, y)).count()).sum(),
        }
    }

    /// The set on the image of half the size: pixels at least two of whose four belong to it.
    pub fn halved(&self) -> Self {
        match self {
            Self::Box { x0, y0, x1, y1 } => {
                Self::Box { x0: x0 / 2, y0: y0 / 2, x1: x1.div_ceil(2), y1: y1.div_ceil(2) }
            }
            Self::Raster { x0, y0, width, bits } => {
                let height = bits.len() / (*width).max(1);
                let half = [x0 / 2, y0 / 2, (x0 + width).div_ceil(2), (y0 + height).div_ceil(2)];
                Self::raster(half, |x, y| self.count([2 * x, 2 * y, 2 * x + 2, 2 * y + 2]) >= 2)
            }
        }
    }

    /// The set of the pixels for which `inside` holds, within the box.
    pub(super) fn raster([x0, y0, x1, y1]: [usize; 4], inside: impl Fn(usize, usize) -> bool) -> Self {
        let bits = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))).map(|(x, y)| inside(x, y)).collect();
        Self::Raster { x0, y0, width: x1.saturating_sub(x0), bits }
    }
}

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

/// The pixels of `zone` on an image of `width` x `height` px. `of_elements` are those of its own elements,
/// where it has such.
pub(super) fn zone_pixels(
    zone: &Zone,
    [width, height]: [usize; 2],
    of_elements: Option<PixelSet>,
) -> Result<ZonePixels, MeshError> {
    let roi = zone.bounds(width, height)?;
    check_guard(zone)?;
    if zone.is_rectangle() {
        let guard = match &zone.guard {
            Guard::All(g) => [*g; 4],
            Guard::Sides(sides) => [sides[0], sides[1], sides[2], sides[3]],
        };
        let all = rectangle(roi, [0.0; 4], width, height);
        return Ok(ZonePixels { all, guarded: rectangle(roi, guard, width, height) });
    }
    if let Some(mask) = &zone.mask
        && [mask.width(), mask.height()] != [width, height]
    {
        let (mask_width, mask_height) = (mask.width(), mask.height());
        return Err(MeshError::MaskSize { zone: zone.name.clone(), mask_width, mask_height, width, height });
    }
    let rectangle = rectangle(roi, [0.0; 4], width, height);
    let frame = rectangle.bounds().ok_or_else(|| MeshError::Empty { zone: zone.name.clone() })?;
    let polygon = (!zone.polygon.is_empty()).then(|| polygon::fill(zone, &zone.polygon, frame)).transpose()?;
    let holes = zone.exclude.iter().map(|hole| polygon::fill(zone, hole, frame)).collect::<Result<Vec<_>, _>>()?;
    let all = PixelSet::raster(frame, |x, y| {
        polygon.as_ref().is_none_or(|polygon| polygon.contains(x, y))
            && !holes.iter().any(|hole| hole.contains(x, y))
            && zone.mask.as_ref().is_none_or(|mask| mask.contains(x, y))
            && of_elements.as_ref().is_none_or(|elements| elements.contains(x, y))
    });
    if all.bounds().is_none() {
        return Err(MeshError::Empty { zone: zone.name.clone() });
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
    };
    Ok(ZonePixels { all, guarded })
}

fn check_guard(zone: &Zone) -> Result<(), MeshError> {
    let name = || zone.name.clone();
    let (guards, sides) = match &zone.guard {
        Guard::All(guard) => (std::slice::from_ref(guard), 1),
        Guard::Sides(guards) if zone.is_rectangle() => (guards.as_slice(), 4),
        Guard::Sides(guards) => (guards.as_slice(), zone.polygon.len()),
    };
    if guards.len() != sides {
        return Err(MeshError::GuardSides { zone: name(), given: guards.len(), sides });
    }
    match guards.iter().find(|guard| !(guard.is_finite() && **guard >= 0.0)) {
        Some(&guard) => Err(MeshError::Guard { zone: name(), guard }),
        None => Ok(()),
    }
}

/// The pixels of `set` farther than `guard` from the nearest pixel of the image that is not in the set. The
/// image's own border is none: nothing is mixed in from beyond it.
fn without_border(set: &PixelSet, [x0, y0, x1, y1]: [usize; 4], guard: f64, [width, height]: [usize; 2]) -> PixelSet {
    let reach = guard.ceil() as isize + 1;
    // Offsets of the pixels that a pixel outside takes away: the border lies midway, half a pixel from both.
    let disc: Vec<(isize, isize)> = (-reach..=reach)
        .flat_map(|j| (-reach..=reach).map(move |i| (i, j)))
        .filter(|&(i, j)| ((i * i + j * j) as f64).sqrt() - 0.5 < guard)
        .collect();
    let inside = |x: isize, y: isize| x >= 0 && y >= 0 && set.contains(x as usize, y as usize);
    let mut kept: Vec<bool> =
        (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))).map(|(x, y)| set.contains(x, y)).collect();
    let (from, to) = ([x0.saturating_sub(1), y0.saturating_sub(1)], [(x1 + 1).min(width), (y1 + 1).min(height)]);
    for y in from[1]..to[1] {
        for x in from[0]..to[0] {
            let (px, py) = (x as isize, y as isize);
            let neighbours = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];
            if set.contains(x, y) || !neighbours.iter().any(|(i, j)| inside(px + i, py + j)) {
                continue;
            }
            for (i, j) in &disc {
                let (qx, qy) = (px + i - x0 as isize, py + j - y0 as isize);
                if (0..(x1 - x0) as isize).contains(&qx) && (0..(y1 - y0) as isize).contains(&qy) {
                    kept[qy as usize * (x1 - x0) + qx as usize] = false;
                }
            }
        }
    }
    PixelSet::Raster { x0, y0, width: x1 - x0, bits: kept }
}
