//! Two strips and the band without texture between them: where the adhesive of a joint is in an image.

use super::{Image, Specimen, SpecimenPart};
use crate::plane::Point;
use thiserror::Error;

/// Rows beyond the band, in elements, in which its faces are looked for.
const REACH: usize = 3;
/// Columns that are looked at together, in elements.
const BLOCK: usize = 1;
/// Blocks that say the same of a face, to be a line.
const LEAST_BLOCKS: usize = 5;
/// The strips vary so many times as much as the band, in grey levels squared, or there is no band.
const TEXTURE: f64 = 4.0;
/// Parts of the joint whose faces are found apart: their scatter is the uncertainty.
const PARTS: usize = 8;
/// Grey levels squared that no image is without.
const ROUNDING: f64 = 1.0 / 12.0;
/// Faces that turn by less over their length are those of rectangles, px.
const LEVEL: f64 = 0.5;

/// Two strips with a band between them, px of the image.
#[derive(Debug, Clone, PartialEq)]
pub struct Strips {
    /// Corners of the strip above the band (left of it, where that is upright) and of the other, in order around each.
    pub corners: [[Point; 4]; 2],
    /// Whether they are rectangles along the axes of the image.
    pub are_rectangles: bool,
    /// Whether the band runs along y.
    pub is_upright: bool,
    /// Distance of the faces.
    pub gap_px: f64,
    /// Its standard uncertainty, by how parts of the joint differ.
    pub gap_std_px: f64,
}

/// Why there are no two strips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum StripsError {
    /// Texture in one part or none.
    #[error(
        "the reference shows {0} part(s) with texture, where a joint has two strips with a dark or bright band between them"
    )]
    Parts(usize),
    /// Beside each other over hardly any length.
    #[error("the two largest parts with texture do not lie along each other")]
    Apart,
    /// No edge that goes on along the joint.
    #[error("no straight face of a band is seen between the two largest parts with texture")]
    NoBand,
}

/// The image with the joint along its first coordinate.
struct View<'a> {
    image: &'a Image,
    is_upright: bool,
}

impl View<'_> {
    fn grey(&self, along: usize, across: usize) -> f64 {
        let [x, y] = if self.is_upright { [across, along] } else { [along, across] };
        f64::from(self.image.grey(x, y))
    }

    fn contains(&self, part: &SpecimenPart, along: usize, across: usize) -> bool {
        if self.is_upright { part.contains(across, along) } else { part.contains(along, across) }
    }

    /// Box of a part: begin and end along, begin and end across.
    fn extent(&self, part: &SpecimenPart) -> [usize; 4] {
        let [x0, y0, x1, y1] = part.bounds;
        if self.is_upright { [y0, y1, x0, x1] } else { [x0, x1, y0, y1] }
    }
}

/// A line across which a face lies: `at` where the joint begins, and its slope.
#[derive(Debug, Clone, Copy)]
struct Line {
    at: f64,
    slope: f64,
}

impl Line {
    fn across(self, along: f64) -> f64 {
        self.at + self.slope * along
    }

    /// The line through most of the points; `None` where too few lie on one.
    fn through(mut points: Vec<Point>) -> Option<Self> {
        loop {
            let n = points.len() as f64;
            if points.len() < LEAST_BLOCKS {
                return None;
            }
            let mean = [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
            let product = |c: usize| points.iter().map(|p| (p[0] - mean[0]) * (p[c] - mean[c])).sum::<f64>();
            let slope = product(1) / product(0);
            let line = Self { at: mean[1] - slope * mean[0], slope };
            let off = |p: &Point| (p[1] - line.across(p[0])).abs();
            let mut offs: Vec<f64> = points.iter().map(off).collect();
            offs.sort_by(f64::total_cmp);
            // Three standard deviations by the median, and half a pixel that rows leave.
            let limit = 3.0 * 1.4826 * offs.get(offs.len() / 2)? + 0.5;
            let before = points.len();
            points.retain(|p| off(p) <= limit);
            if points.len() == before {
                return Some(line);
            }
        }
    }
}

impl Strips {
    /// Looks for them in `image`, for elements of `size` px.
    ///
    /// The two largest parts with texture ([`Specimen`]) lie on either side. In blocks of columns the rows between their
    /// middles are cut in three, such that the grey levels of each piece vary least (by the logarithm of the variance);
    /// through these cuts go straight faces. Each is then moved to where the square of the distance from the grey level of
    /// the band is halfway to what it is in the strip: for speckles and a band of even grey, to a fraction of a pixel.
    ///
    /// # Errors
    /// [`StripsError`].
    pub fn find(image: &Image, size: usize) -> Result<Self, StripsError> {
        let margin = (size / 2).min(image.width().min(image.height()) / 16);
        let found = Specimen::find(image, size, margin).parts;
        let [first, second, ..] = found.as_slice() else { return Err(StripsError::Parts(found.len())) };
        let middle = |part: &SpecimenPart| {
            let [x0, y0, x1, y1] = part.bounds.map(|v| v as f64);
            [(x0 + x1) / 2.0, (y0 + y1) / 2.0]
        };
        let [a, b] = [middle(first), middle(second)];
        let view = View { image, is_upright: (a[0] - b[0]).abs() > (a[1] - b[1]).abs() };
        let is_first_ahead = if view.is_upright { a[0] < b[0] } else { a[1] < b[1] };
        let parts = if is_first_ahead { [first, second] } else { [second, first] };
        let extents = parts.map(|part| view.extent(part));
        let along = [extents[0][0].max(extents[1][0]), extents[0][1].min(extents[1][1])];
        if along[0] + LEAST_BLOCKS * BLOCK * size > along[1] {
            return Err(StripsError::Apart);
        }
        let cuts = view.cuts(parts, along, size);
        let lines = [0, 1].map(|k| Line::through(cuts.iter().map(|cut| [cut[0], cut[k + 1]]).collect()));
        let [Some(ahead), Some(behind)] = lines else { return Err(StripsError::NoBand) };
        let faces = view.refine([ahead, behind], along, size).ok_or(StripsError::NoBand)?;
        let ([ahead, behind], stds) = ([faces[0].0, faces[1].0], [faces[0].1, faces[1].1]);
        let centre = (along[0] + along[1]) as f64 / 2.0;
        let slope = (ahead.slope + behind.slope) / 2.0;
        let gap_px = (behind.across(centre) - ahead.across(centre)) / slope.hypot(1.0);
        if gap_px <= 0.0 {
            return Err(StripsError::NoBand);
        }
        let ends = along.map(|at| at as f64);
        let turn = (ahead.slope.abs().max(behind.slope.abs())) * (ends[1] - ends[0]);
        let are_rectangles = turn < LEVEL;
        // Faces of rectangles are level; else the far sides go along the faces, within the strips.
        let level = |line: Line| if are_rectangles { Line { at: line.across(centre), slope: 0.0 } } else { line };
        let (ahead, behind) = (level(ahead), level(behind));
        let least = |of: &dyn Fn(f64) -> f64| ends.map(of).into_iter().fold(f64::INFINITY, f64::min);
        let height = least(&|at| ahead.across(at) - extents[0][2] as f64);
        let depth = least(&|at| extents[1][3] as f64 - behind.across(at));
        let quad = |from: &dyn Fn(f64) -> f64, to: &dyn Fn(f64) -> f64| {
            let [a, b] = ends;
            let corners = [[a, from(a)], [b, from(b)], [b, to(b)], [a, to(a)]];
            corners.map(|[along, across]| if view.is_upright { [across, along] } else { [along, across] })
        };
        let corners = [
            quad(&|at| ahead.across(at) - height, &|at| ahead.across(at)),
            quad(&|at| behind.across(at), &|at| behind.across(at) + depth),
        ];
        let gap_std_px = stds[0].hypot(stds[1]);
        Ok(Self { corners, are_rectangles, is_upright: view.is_upright, gap_px, gap_std_px })
    }
}

impl View<'_> {
    /// Of each block the middle of its columns, and the rows where the band begins and ends.
    fn cuts(&self, parts: [&SpecimenPart; 2], along: [usize; 2], size: usize) -> Vec<[f64; 3]> {
        let block = (BLOCK * size).max(8);
        let extents = parts.map(|part| self.extent(part));
        let cut = |first: usize| {
            let centre = first + block / 2;
            let last = (extents[0][2]..extents[0][3]).rev().find(|&row| self.contains(parts[0], centre, row))?;
            let next = (extents[1][2]..extents[1][3]).find(|&row| self.contains(parts[1], centre, row))?;
            let from = (last + 1).saturating_sub(REACH * size).max(extents[0][2]);
            let to = (next + REACH * size).min(extents[1][3]);
            let [begin, end] = three_pieces(&self.row_sums(first..first + block, from..to), block)?;
            // Rows lie at whole numbers: a piece begins half a row before its first.
            Some([centre as f64 - 0.5, (from + begin) as f64 - 0.5, (from + end) as f64 - 0.5])
        };
        (along[0]..=along[1] - block).step_by(block).filter_map(cut).collect()
    }

    /// Sums of grey levels and of their squares of each row.
    fn row_sums(&self, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> Vec<[f64; 2]> {
        let of_row = |row: usize| {
            columns
                .clone()
                .map(|column| self.grey(column, row))
                .fold([0.0; 2], |[sum, squares], grey| [sum + grey, squares + grey * grey])
        };
        rows.map(of_row).collect()
    }

    /// Both faces moved to where the texture begins, with their standard uncertainty; `None` where there is no band.
    fn refine(&self, lines: [Line; 2], along: [usize; 2], size: usize) -> Option<[(Line, f64); 2]> {
        let moved = |k: usize| {
            let towards_strip = [-1.0, 1.0][k];
            let part = (along[1] - along[0]) / PARTS;
            let offs: Vec<f64> = (0..PARTS)
                .filter_map(|at| {
                    self.begin_of_texture(lines, k, along[0] + at * part..along[0] + (at + 1) * part, size)
                })
                .collect();
            let n = offs.len() as f64;
            if offs.len() < PARTS / 2 {
                return None;
            }
            let mean = offs.iter().sum::<f64>() / n;
            let variance = offs.iter().map(|off| (off - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let line = Line { at: lines[k].at + towards_strip * mean, ..lines[k] };
            Some((line, (variance / n).sqrt()))
        };
        Some([moved(0)?, moved(1)?])
    }

    /// How far from the line of a face, towards its strip, its texture begins over these columns.
    fn begin_of_texture(
        &self,
        lines: [Line; 2],
        k: usize,
        columns: std::ops::Range<usize>,
        size: usize,
    ) -> Option<f64> {
        let towards_strip = [-1.0, 1.0][k];
        let half = |at: f64| (lines[1].across(at) - lines[0].across(at)) / 2.0;
        let height = if self.is_upright { self.image.width() } else { self.image.height() };
        let rows = |at: f64, from: f64, to: f64| {
            let ends = [from, to].map(|off| lines[k].across(at) + towards_strip * off);
            let (low, high) = (ends[0].min(ends[1]).ceil().max(0.0), ends[0].max(ends[1]).floor());
            low as usize..((high + 1.0).max(0.0) as usize).min(height)
        };
        // The grey of the band in its middle third.
        let (mut sum, mut n) = (0.0, 0.0f64);
        for column in columns.clone() {
            let at = column as f64;
            for row in rows(at, -4.0 / 3.0 * half(at), -2.0 / 3.0 * half(at)) {
                sum += self.grey(column, row);
                n += 1.0;
            }
        }
        let grey = sum / n.max(1.0);
        // Squares of the distance from it, by how far the pixel lies towards the strip; in bins of a pixel.
        let reach = size as f64;
        let inner = half((columns.start + columns.end) as f64 / 2.0);
        let first = -inner.floor();
        let mut bins = vec![[0.0f64; 3]; (reach - first) as usize + 1];
        for column in columns {
            let at = column as f64;
            for row in rows(at, first, reach) {
                let off = towards_strip * (row as f64 - lines[k].across(at));
                let Some(bin) = bins.get_mut((off - first).round().max(0.0) as usize) else { continue };
                let square = (self.grey(column, row) - grey).powi(2);
                [bin[0], bin[1], bin[2]] = [bin[0] + 1.0, bin[1] + off, bin[2] + square];
            }
        }
        let means: Vec<[f64; 2]> = bins.iter().filter(|b| b[0] > 0.0).map(|b| [b[1] / b[0], b[2] / b[0]]).collect();
        let level = |takes: &dyn Fn(f64) -> bool| {
            let taken: Vec<f64> = means.iter().filter(|m| takes(m[0])).map(|m| m[1]).collect();
            (!taken.is_empty()).then(|| taken.iter().sum::<f64>() / taken.len() as f64)
        };
        let (strip, band) = (level(&|off| off > reach / 4.0)?, level(&|off| off < -inner / 2.0)?);
        let middle = (strip + band) / 2.0;
        let crosses = |pair: &&[[f64; 2]]| pair[0][1] < middle && pair[1][1] >= middle;
        let pair = means.windows(2).find(crosses).filter(|_| strip > TEXTURE * band.max(ROUNDING))?;
        let share = (middle - pair[0][1]) / (pair[1][1] - pair[0][1]);
        Some(pair[0][0] + share * (pair[1][0] - pair[0][0]))
    }
}

/// The rows at which the second and the third of three pieces begin, such that grey levels vary least within each:
/// `sum n ln(variance)` is least; `width` grey levels are in each row. `None` where there are too few rows.
fn three_pieces(rows: &[[f64; 2]], width: usize) -> Option<[usize; 2]> {
    /// Rows of a piece.
    const LEAST: usize = 3;
    let mut sums = vec![[0.0; 2]];
    for row in rows {
        let last = sums.last().copied().unwrap_or_default();
        sums.push([0, 1].map(|c| last[c] + row[c]));
    }
    let cost = |from: usize, to: usize| {
        let n = ((to - from) * width) as f64;
        let [sum, squares] = [0, 1].map(|c| sums[to][c] - sums[from][c]);
        n * ((squares / n - (sum / n).powi(2)).max(0.0) + ROUNDING).ln()
    };
    let n = rows.len();
    let ends = (LEAST..n.saturating_sub(2 * LEAST)).flat_map(|a| (a + LEAST..=n - LEAST).map(move |b| [a, b]));
    let all = |[a, b]: [usize; 2]| cost(0, a) + cost(a, b) + cost(b, n);
    ends.map(|ends| (all(ends), ends)).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, ends)| ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Pixels;

    /// Blobs on two strips whose faces are `faces` (where x is zero) with a slope, in a soft image with noise.
    fn joint(faces: [f64; 2], slope: f64, is_upright: bool) -> Image {
        let (width, height) = (400, 320);
        let mut state = 7u64;
        let mut random = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64
        };
        let blobs: Vec<[f64; 3]> = (0..9000).map(|_| [random() * 400.0, random() * 320.0, 1.0 + random()]).collect();
        let mut strip = vec![0.0f64; width * height];
        for [bx, by, r] in &blobs {
            for y in (by - 6.0).max(0.0) as usize..((by + 6.0) as usize).min(height) {
                for x in (bx - 6.0).max(0.0) as usize..((bx + 6.0) as usize).min(width) {
                    let square = (x as f64 - bx).powi(2) + (y as f64 - by).powi(2);
                    strip[y * width + x] += 90.0 * (-square / (2.0 * r * r)).exp();
                }
            }
        }
        let grey = |x: usize, y: usize, noise: f64| {
            let at = |face: f64| y as f64 - face - slope * x as f64;
            // Of a pixel the share that lies in the band, 1 px soft.
            let inside = (at(faces[0]) + 0.5).clamp(0.0, 1.0) * (0.5 - at(faces[1])).clamp(0.0, 1.0);
            let texture = (40.0 + strip[y * width + x]).min(230.0);
            (inside * 25.0 + (1.0 - inside) * texture + 4.0 * (noise - 0.5)).round() as u8
        };
        let level = |x: usize, y: usize, noise: f64| if is_upright { grey(y, x, noise) } else { grey(x, y, noise) };
        let [w, h] = if is_upright { [height, width] } else { [width, height] };
        let levels = (0..w * h).map(|at| level(at % w, at / w, random())).collect();
        Image::new(w, h, Pixels::U8(levels)).unwrap()
    }

    #[test]
    fn faces_are_found_to_a_pixel_level_slanted_and_upright() {
        for (faces, slope, is_upright) in
            [([150.3, 174.8], 0.0, false), ([140.0, 160.0], 0.05, false), ([150.3, 174.8], 0.0, true)]
        {
            let found = Strips::find(&joint(faces, slope, is_upright), 16).unwrap();
            assert_eq!((found.is_upright, found.are_rectangles), (is_upright, slope == 0.0));
            // Seen from the corners at the faces.
            let of = |k: usize, c: usize| found.corners[k][c];
            for (k, corners) in [[2, 3], [0, 1]].into_iter().enumerate() {
                for [x, y] in corners.map(|c| of(k, c)) {
                    let [along, across] = if is_upright { [y, x] } else { [x, y] };
                    let off = across - faces[k] - slope * along;
                    assert!(off.abs() < 0.7, "face {k} of {faces:?}: {off} px off; {found:?}");
                }
            }
            let gap = (faces[1] - faces[0]) / slope.hypot(1.0);
            assert!((found.gap_px - gap).abs() < 1.0 && found.gap_std_px < 0.4, "{gap}: {found:?}");
        }
    }

    #[test]
    fn an_image_without_two_strips_has_none() {
        let whole = joint([-50.0, -40.0], 0.0, false);
        assert!(matches!(Strips::find(&whole, 16), Err(StripsError::Parts(1))));
        let blank = Image::new(200, 200, Pixels::U8(vec![90; 40_000])).unwrap();
        assert_eq!(Strips::find(&blank, 16), Err(StripsError::Parts(0)));
    }
}
