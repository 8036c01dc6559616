//! Chessboards and grids of dots, drawn by a renderer of their own, found and calibrated on.

use crate::common::board::{Board, Pinhole, Pose, Print, photographed};
use quadrille::camera::PARAMETERS;
use quadrille::camera::marked::MarkedPoint;
use quadrille::camera::target::{TargetCalibration, calibrate_on_target};
use quadrille::imaging::Image;
use quadrille::metrology::target::{Pattern, SeenTarget, Target, TargetError, find_targets};
use std::sync::Arc;

const SIZE: [usize; 2] = [640, 480];
const FOCAL: f64 = 1300.0;
const CHESSBOARD: Board = Board { print: Print::Chessboard, n: [9, 6], pitch_mm: 5.0 };
const DOTS: Board = Board { print: Print::Dots(1.4), n: [9, 6], pitch_mm: 5.0 };
const DISTANCE: f64 = 125.0;
const TILT: f64 = 3.0;
const TURN: f64 = 7.0;

/// A lens of 0.3 % at the corner.
fn camera() -> Pinhole {
    let half = 0.5 * 640f64.hypot(480.0);
    Pinhole { size: SIZE, focal: FOCAL, centre: [322.0, 237.5], k1: 3e-3 * (FOCAL / half).powi(2) }
}

/// The first is tilted by three degrees, the others are turned by hand.
const POSES: [Pose; 5] = [
    Pose { degrees: [0.0, TILT, TURN], at: [0.3, -0.2, DISTANCE] },
    Pose { degrees: [24.0, 3.0, 10.0], at: [2.0, 1.0, 140.0] },
    Pose { degrees: [-20.0, 12.0, -5.0], at: [-3.0, 0.0, 135.0] },
    Pose { degrees: [4.0, 28.0, 3.0], at: [1.0, -2.0, 138.0] },
    Pose { degrees: [2.0, -26.0, 175.0], at: [0.0, 2.0, 136.0] },
];

fn target(board: &Board) -> Target {
    let pattern = if board.print == Print::Chessboard { Pattern::Chessboard } else { Pattern::Dots };
    Target { pattern, n: board.n }
}

fn named(images: Vec<Arc<Image>>) -> Vec<(String, Arc<Image>)> {
    images.into_iter().enumerate().map(|(k, image)| (format!("{k}.png"), image)).collect()
}

fn calibrated(board: &Board, seen: &[SeenTarget]) -> TargetCalibration {
    let view = |seen: &SeenTarget| -> Vec<MarkedPoint> {
        let mm = |k: usize| [k % board.n[0], k / board.n[0]].map(|n| board.pitch_mm * n as f64);
        seen.points.iter().enumerate().map(|(k, &px)| MarkedPoint { px, mm: mm(k) }).collect()
    };
    let views: Vec<_> = seen.iter().map(view).collect();
    calibrate_on_target(&views, board.pitch_mm * seen[0].dot_radius, SIZE).unwrap()
}

/// Errors of the camera of the first view by their standard uncertainties: k1, tilt along x and y, size of a pixel,
/// focal length.
fn scores(found: &TargetCalibration) -> Vec<f64> {
    let shape = found.camera.shape();
    let by = (FOCAL / shape.focal_px[0]).powi(2);
    // A plane that falls back by this angle, at a px of the mean of its two scales.
    let half_angle = (0.5 * TILT.to_radians()).tan();
    let ((sin, cos), (sin_turn, cos_turn)) = (TILT.to_radians().sin_cos(), TURN.to_radians().sin_cos());
    let [x, y, z] = POSES[0].at;
    let size = 2.0 * (z + (x * cos_turn + y * sin_turn) * sin / cos) / (FOCAL * (1.0 + cos));
    let score = |name: &str, by: f64, truth: f64| {
        let k = PARAMETERS.iter().position(|of| *of == name).unwrap();
        let of = found.estimates.iter().find(|of| of.parameter == k).unwrap();
        (of.value * by - truth) / (of.std * by)
    };
    let mut list = vec![
        score("k1", by, camera().k1),
        score("tilt_x", 1.0, -2.0 * half_angle * cos_turn / FOCAL),
        score("tilt_y", 1.0, -2.0 * half_angle * sin_turn / FOCAL),
        (found.pixel_size_mm / size).ln() / found.relative_std,
    ];
    list.extend(found.focal_px.map(|[focal, std]| (focal - FOCAL) / std));
    list
}

#[test]
fn points_are_found_within_hundredths_of_a_pixel_and_coefficients_within_their_uncertainty() {
    const DRAWS: u64 = 3;
    let mut list = Vec::new();
    for (board, n_views) in [(CHESSBOARD, 1), (CHESSBOARD, 5), (DOTS, 1), (DOTS, 5)] {
        let drawn: Vec<Vec<f64>> = POSES[..n_views].iter().map(|pose| board.drawn(&camera(), pose)).collect();
        let mut largest = 0.0f64;
        for draw in 0..DRAWS {
            let seed = |k: usize| 100 * draw + k as u64 + 1;
            let images = drawn.iter().enumerate().map(|(k, grey)| photographed(grey, SIZE, 2.0, seed(k))).collect();
            let seen = find_targets(&named(images), target(&board)).unwrap();
            for (seen, pose) in seen.iter().zip(&POSES) {
                let mut truth = board.points(&camera(), pose);
                if pose.degrees[2].abs() > 90.0 {
                    truth.reverse();
                }
                let off = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
                largest = seen.points.iter().zip(&truth).map(off).fold(largest, f64::max);
            }
            list.extend(scores(&calibrated(&board, &seen)));
        }
        // Middles of dots are moved by perspective; the calibration reckons with it.
        assert!(largest < if board.print == Print::Chessboard { 0.05 } else { 0.15 }, "{board:?}: {largest}");
    }
    // 95 % of 54 are 51 +- 1.6, and what the images were drawn with is the same in all draws.
    let inside = list.iter().filter(|z| z.abs() < 1.96).count();
    assert!(10 * inside >= 9 * list.len(), "{inside} of {}: {list:.2?}", list.len());
}

#[test]
fn dots_are_found_light_on_dark_in_uneven_light_and_small_squares_too() {
    let lit = |grey: Vec<f64>| -> Vec<f64> {
        grey.iter().enumerate().map(|(k, g)| g * (0.5 + 0.5 * (k % SIZE[0]) as f64 / SIZE[0] as f64)).collect()
    };
    let negative = |grey: Vec<f64>| -> Vec<f64> { grey.iter().map(|g| 250.0 - g).collect() };
    let fine = Board { n: [25, 17], pitch_mm: 1.5, ..CHESSBOARD };
    for (board, change) in [
        (DOTS, &lit as &dyn Fn(Vec<f64>) -> Vec<f64>),
        (DOTS, &negative),
        (CHESSBOARD, &lit),
        (CHESSBOARD, &negative),
        (fine, &lit),
    ] {
        let image = photographed(&change(board.drawn(&camera(), &POSES[1])), SIZE, 2.0, 5);
        let seen = find_targets(&named(vec![image]), target(&board)).unwrap();
        let truth = board.points(&camera(), &POSES[1]);
        let off = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
        let largest = seen[0].points.iter().zip(&truth).map(off).fold(0.0, f64::max);
        assert!(largest < 0.2, "{board:?}: {largest}");
    }
}

#[test]
fn what_is_no_such_target_is_said() {
    let draw = |board: &Board| photographed(&board.drawn(&camera(), &POSES[0]), SIZE, 2.0, 1);
    for board in [CHESSBOARD, DOTS] {
        let target = target(&board);
        let refused = |images: Vec<Arc<Image>>, target: Target| find_targets(&named(images), target).unwrap_err();
        let image = draw(&board);
        let more = Target { n: [10, 6], ..target };
        let count = refused(vec![image.clone()], more);
        assert!(matches!(count, TargetError::Count { found, .. } if found[0] * found[1] == 54), "{count}");
        let less = refused(vec![image.clone()], Target { n: [8, 6], ..target });
        assert!(matches!(less, TargetError::Count { .. }), "{less}");
        let other = Board {
            print: if board.print == Print::Chessboard { Print::Dots(1.4) } else { Print::Chessboard },
            ..board
        };
        let none = refused(vec![draw(&other)], target);
        assert!(matches!(none, TargetError::NotFound { .. } | TargetError::Count { .. }), "{none}");
        let flat = Arc::new(Image::new(64, 48, quadrille::imaging::Pixels::U8(vec![7; 64 * 48])).unwrap());
        assert!(matches!(refused(vec![flat.clone()], target), TargetError::NotFound { .. }));
        assert!(matches!(refused(vec![image.clone(), flat], target), TargetError::ImageSize { .. }));
        // A hand over two points.
        let mut grey = board.drawn(&camera(), &POSES[0]);
        let [x, y] = board.points(&camera(), &POSES[0])[22];
        for row in y as usize - 25..y as usize + 25 {
            grey[row * SIZE[0] + x as usize - 25..row * SIZE[0] + x as usize + 75].fill(120.0);
        }
        let hidden = refused(vec![photographed(&grey, SIZE, 2.0, 1)], target);
        assert!(matches!(hidden, TargetError::Hidden { missing: 1..6, .. }), "{hidden}");
        assert!(matches!(refused(vec![image], Target { n: [2, 6], ..target }), TargetError::Size { .. }));
        assert!(matches!(refused(vec![], target), TargetError::NoImage));
    }
    let mut noise = crate::common::spots::numbers(3);
    let pixels = quadrille::imaging::Pixels::F32((0..300 * 200).map(|_| noise() as f32).collect());
    let noise = Arc::new(Image::new(300, 200, pixels).unwrap());
    for board in [CHESSBOARD, DOTS] {
        let said = find_targets(&named(vec![noise.clone()]), target(&board)).unwrap_err();
        assert!(matches!(said, TargetError::NotFound { .. } | TargetError::Count { .. }), "{said}");
    }
}
