//! Flat targets in images: the inner corners of a chessboard, and the dots of a grid, with sub-pixel precision.

mod corner;
mod dot;
mod grid;
mod plain;

use crate::imaging::Image;
use crate::plane::Point;
use grid::Found;
use plain::Plain;
use rayon::prelude::*;
use std::sync::Arc;
use thiserror::Error;

/// Fewest columns and rows.
const FEWEST: usize = 3;
/// Most of them.
const MOST: usize = 200;
/// How often an image is halved when the target is not found on it as it is.
const HALVINGS: usize = 3;

/// What is printed on a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// Squares; its points are the corners where four of them meet.
    Chessboard,
    /// Round dots, dark on light or light on dark; its points are their middles.
    Dots,
}

/// A flat target: points on a square grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Target {
    /// What is printed.
    pub pattern: Pattern,
    /// Points in a row, and rows.
    pub n: [usize; 2],
}

/// A target as it is seen in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenTarget {
    /// Where its points are seen, px, row by row. Rows are such that columns are counted along x, or nearly, and rows
    /// along y.
    pub points: Vec<Point>,
    /// Radius of its dots, in distances of neighbours; zero of corners.
    pub dot_radius: f64,
}

/// Why a target is not found.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TargetError {
    /// A target that is none.
    #[error("a target of {} x {} points; give columns and rows from {FEWEST} to {MOST}", n[0], n[1])]
    Size {
        /// Columns and rows.
        n: [usize; 2],
    },
    /// No image.
    #[error("no image of a target; name one or more")]
    NoImage,
    /// Images of different sizes.
    #[error(
        "{name}: the image is {} x {} px, the first {} x {} px; give images of one camera, as it writes them",
        size[0], size[1], first[0], first[1]
    )]
    ImageSize {
        /// The image.
        name: String,
        /// Its columns and rows.
        size: [usize; 2],
        /// Those of the first.
        first: [usize; 2],
    },
    /// Nothing at all.
    #[error("{name}: there is no {}; is it in focus and evenly lit, and are its points 8 px apart or more?", named(*.pattern))]
    NotFound {
        /// The image.
        name: String,
        /// What was looked for.
        pattern: Pattern,
    },
    /// Another number of points.
    #[error(
        "{name}: {} x {} {} are found, {} x {} are asked for; {}", found[0], found[1], points(*.pattern), wanted[0], wanted[1],
        if found[0] * found[1] < wanted[0] * wanted[1] {
            "give the number of points inside the board, and images that show all of it"
        } else {
            "give the number of columns and rows that the target has"
        }
    )]
    Count {
        /// The image.
        name: String,
        /// What was looked for.
        pattern: Pattern,
        /// Columns and rows that are found.
        found: [usize; 2],
        /// What is asked for.
        wanted: [usize; 2],
    },
    /// Points in between that are not seen.
    #[error(
        "{name}: {missing} of {} {} are not seen clearly; is part of the target hidden, dazzled or blurred?",
        wanted[0] * wanted[1], points(*.pattern)
    )]
    Hidden {
        /// The image.
        name: String,
        /// What was looked for.
        pattern: Pattern,
        /// How many.
        missing: usize,
        /// Columns and rows asked for.
        wanted: [usize; 2],
    },
}

fn named(pattern: Pattern) -> &'static str {
    match pattern {
        Pattern::Chessboard => "chessboard",
        Pattern::Dots => "grid of dots",
    }
}

fn points(pattern: Pattern) -> &'static str {
    match pattern {
        Pattern::Chessboard => "inner corners",
        Pattern::Dots => "dots",
    }
}

/// The target in each of the images, which have names for messages.
///
/// # Errors
/// See [`TargetError`].
pub fn find_targets(images: &[(String, Arc<Image>)], target: Target) -> Result<Vec<SeenTarget>, TargetError> {
    if !target.n.iter().all(|n| (FEWEST..=MOST).contains(n)) {
        return Err(TargetError::Size { n: target.n });
    }
    let size = |image: &Image| [image.width(), image.height()];
    let first = images.first().map(|(_, image)| size(image)).ok_or(TargetError::NoImage)?;
    if let Some((name, image)) = images.iter().find(|(_, image)| size(image) != first) {
        return Err(TargetError::ImageSize { name: name.clone(), size: size(image), first });
    }
    images.par_iter().map(|(name, image)| find_target(name, image, target)).collect()
}

fn find_target(name: &str, image: &Image, target: Target) -> Result<SeenTarget, TargetError> {
    let whole = Plain::of(image);
    let mut best: Option<Found> = None;
    let mut halved = None;
    for halvings in 0..=HALVINGS {
        let picture = halved.as_ref().unwrap_or(&whole);
        let found = match target.pattern {
            Pattern::Chessboard => corner::find(picture, target.n),
            Pattern::Dots => dot::find(picture, target.n),
        };
        let by = (1 << halvings) as f64;
        let found = found.map(|found| found.scaled(by));
        if let Some(found) = found.as_ref().filter(|found| found.is_whole(target.n)) {
            let places = found.in_order(target.n);
            if let Some(seen) = refined(&whole, target, &places) {
                return Ok(seen);
            }
        }
        best = [best, found].into_iter().flatten().max_by_key(Found::n_points);
        if picture.width.min(picture.height) < 64 {
            break;
        }
        halved = Some(picture.halved());
    }
    let (name, pattern, wanted) = (name.to_owned(), target.pattern, target.n);
    Err(match best {
        Some(found) if found.has_size(wanted) => {
            let missing = (wanted[0] * wanted[1]).saturating_sub(found.n_points()).max(1);
            TargetError::Hidden { name, pattern, missing, wanted }
        }
        Some(found) if found.is_filled() && found.n_points() >= FEWEST * FEWEST => {
            // Which of both are the columns is not seen.
            let mut size = found.size();
            size.sort_unstable_by(|a, b| if wanted[0] < wanted[1] { a.cmp(b) } else { b.cmp(a) });
            TargetError::Count { name, pattern, found: size, wanted }
        }
        _ => TargetError::NotFound { name, pattern },
    })
}

/// The points with sub-pixel precision; `None` where one of them is none.
fn refined(image: &Plain, target: Target, places: &[Point]) -> Option<SeenTarget> {
    let [columns, rows] = target.n;
    let softened = (target.pattern == Pattern::Chessboard).then(|| corner::softened(image));
    let step = |k: usize, far: usize, n: usize, at: usize| {
        let (a, b) = if at + 1 < n { (k, k + far) } else { (k - far, k) };
        [0, 1].map(|c| places[b][c] - places[a][c])
    };
    let refine = |k: usize| {
        let steps = [step(k, 1, columns, k % columns), step(k, columns, rows, k / columns)];
        match target.pattern {
            Pattern::Chessboard => corner::refined(softened.as_ref()?, places[k], steps).map(|at| (at, 0.0)),
            Pattern::Dots => dot::refined(image, places[k], steps),
        }
    };
    let found: Vec<(Point, f64)> = (0..places.len()).map(refine).collect::<Option<_>>()?;
    let mut radii: Vec<f64> = found.iter().map(|of| of.1).collect();
    let middle = radii.len() / 2;
    let dot_radius = *radii.select_nth_unstable_by(middle, f64::total_cmp).1;
    Some(SeenTarget { points: found.into_iter().map(|of| of.0).collect(), dot_radius })
}
