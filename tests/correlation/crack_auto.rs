//! Cracks found from the residual, on images by another renderer than the program's own (`common/scenes.rs`): where
//! there is one it is found and measured as by a path that was given, and nothing else is taken for one.

use crate::common;
use crate::common::scenes;
use common::{inside, prepared};
use quadrille::correlate::{CrackSearch, NoCrack, Options, move_onto_crack, search_cracks};
use quadrille::field::{CrackLine, Measurement, NodalNoise, Status};
use quadrille::imaging::Image;
use quadrille::mesh::{Crack, Zone};
use quadrille::units::Px;
use scenes::{AffineMotion, SPOT_PX, Spots, photographed};
use std::sync::Arc;

const SIDE: usize = 320;
const MOTION: AffineMotion =
    AffineMotion { shift: [2.3, -1.4], gradient: [[0.004, 0.002], [-0.001, -0.003]], centre: 160.0 };

fn pair(reference: impl Fn([f64; 2]) -> f64 + Sync, deformed: impl Fn([f64; 2]) -> f64 + Sync) -> [Arc<Image>; 2] {
    [photographed(SIDE, 2.0, 11, reference), photographed(SIDE, 2.0, 12, deformed)]
}

fn spots() -> Spots {
    Spots::new(7, SIDE, SPOT_PX)
}

/// A line through the image that rises by `slope`, and how far below it a place is.
#[derive(Clone, Copy)]
struct Straight {
    at: [f64; 2],
    slope: f64,
}

impl Straight {
    fn below(&self, x: [f64; 2]) -> f64 {
        (x[1] - self.at[1] - self.slope * (x[0] - self.at[0])) / 1f64.hypot(self.slope)
    }

    fn y(&self, x: f64) -> f64 {
        self.at[1] + self.slope * (x - self.at[0])
    }
}

/// A crack along a line from the left up to the column `tip`, whose lower side moves down by what `opening` says of the
/// column.
fn cracked(line: Straight, opening: impl Fn(f64) -> f64 + Sync) -> [Arc<Image>; 2] {
    let s = spots();
    let seen = |y: [f64; 2]| {
        let above = MOTION.material(y);
        if line.below(above) < 0.0 {
            return s.grey(above);
        }
        let mut below = above;
        for _ in 0..20 {
            below = MOTION.material([y[0], y[1] - opening(below[0])]);
        }
        if line.below(below) >= 0.0 { s.grey(below) } else { 12.0 }
    };
    pair(|x| s.grey(x), seen)
}

fn field(images: &[Arc<Image>; 2], zones: &[Zone]) -> Measurement<Px> {
    prepared(&images[0], zones, Options::default()).correlate(images[1].clone(), None).unwrap().measurement
}

fn search(images: &[Arc<Image>; 2]) -> CrackSearch {
    let correlate =
        &mut |zones: &[Zone]| prepared(&images[0], zones, Options::default()).correlate(images[1].clone(), None);
    search_cracks(&images[0], &images[1], &inside(SIDE, SIDE, 16), Crack::GUARD, correlate).unwrap()
}

/// Opening along a path: place, value, standard uncertainty.
fn openings(images: &[Arc<Image>; 2], path: &[[f64; 2]]) -> Vec<([f64; 2], f64, f64)> {
    let mut zones = inside(SIDE, SIDE, 16);
    zones[0].cracks.push(Crack { path: path.to_vec(), guard: Crack::GUARD });
    let field = field(images, &zones);
    assert_eq!(field.status, Status::Converged);
    let line = CrackLine::on(&field.mesh, path.to_vec(), None).unwrap();
    let values = line.read(&field, &NodalNoise::new(&field.mesh, &field.measured));
    let places = line.points().iter().zip(values.points);
    places.filter_map(|(place, jump)| Some((place.at, jump?.opening.value, jump?.opening.sigma))).collect()
}

#[test]
fn a_crack_is_found_within_an_element_and_opens_as_along_its_true_path() {
    for (what, line, tip, most) in [
        ("level, through", Straight { at: [160.0, 147.0], slope: 0.0 }, 1e6, 2.0),
        ("slanting, to a tip", Straight { at: [160.0, 163.0], slope: 0.3 }, 210.0, 3.0),
    ] {
        // Closes towards its tip, if it has one.
        let opening = move |x: f64| if tip > 1e5 { most } else { most * ((tip - x) / tip).clamp(0.0, 1.0).sqrt() };
        let images = cracked(line, opening);
        let found = search(&images);
        let [crack] = found.cracks.as_slice() else { panic!("{what}: {found:?}") };
        println!("{what}: {crack:?}");
        for [x, y] in &crack.path {
            // The end beyond the tip is cut for what cannot be seen.
            let off = line.below([*x, *y]).abs();
            assert!(off < if *x < tip { 8.0 } else { 16.0 }, "{what}: {off} px off at {x}");
        }
        let ends = [crack.path[0][0], crack.path[crack.path.len() - 1][0]];
        assert!(ends[0] <= 20.0 && ends[1] >= tip.min(300.0), "{what}: {ends:?}");
        let truth = [[0.0, line.y(0.0)], [ends[1], line.y(ends[1])]];
        let [by_search, by_path] = [&crack.path[..], &truth].map(|path| openings(&images, path));
        assert!(by_search.len() + 2 >= by_path.len(), "{what}: {} of {}", by_search.len(), by_path.len());
        let normal = 1.0 / 1f64.hypot(line.slope);
        for (name, openings) in [("found", by_search), ("given", by_path)] {
            // Near the tip the opening bends within an element.
            let inside: Vec<_> = openings.iter().filter(|(at, ..)| at[0] < tip - 32.0).collect();
            let by_sigma = |(at, value, sigma): &&([f64; 2], f64, f64)| (value - normal * opening(at[0])) / sigma;
            let worst = inside.iter().map(by_sigma).fold(0.0, |a: f64, b| a.max(b.abs()));
            let rms = (inside.iter().map(by_sigma).map(|z| z * z).sum::<f64>() / inside.len() as f64).sqrt();
            // Noise, and a path that is a pixel off.
            assert!(inside.len() > 8 && worst < 5.0 && rms < 2.0, "{what}, {name}: {rms} and {worst} sigma off");
        }
    }
}

#[test]
fn a_path_drawn_beside_the_crack_is_moved_onto_it_and_its_openings_are_right() {
    for (line, tip, most) in [
        (Straight { at: [160.0, 147.0], slope: 0.0 }, 1e6, 2.0),
        (Straight { at: [160.0, 147.0], slope: 0.0 }, 1e6, 9.0),
        (Straight { at: [160.0, 163.0], slope: 0.3 }, 210.0, 3.0),
    ] {
        let opening = move |x: f64| if tip > 1e5 { most } else { most * ((tip - x) / tip).clamp(0.0, 1.0).sqrt() };
        let images = cracked(line, opening);
        let uncut = field(&images, &inside(SIDE, SIDE, 16));
        let normal = 1.0 / 1f64.hypot(line.slope);
        for off in [0.0, 2.0, -4.0, 6.0, -8.0] {
            let end = if tip > 1e5 { 319.0 } else { tip + 32.0 };
            let drawn = [[0.0, line.y(0.0) + off], [end, line.y(end) + off]];
            let on_it = move_onto_crack(&drawn, &uncut, [&images[0], &images[1]]).expect("the crack is seen");
            let moved = on_it.by_px > 0.0;
            println!("{most} px open, {off} px off: moved by {:.1} px to {:?}", on_it.by_px, on_it.path);
            assert!(off.abs() < 3.0 || moved, "{most} px open, {off} px off: {on_it:?}");
            assert!(off != 0.0 || !moved, "{on_it:?}");
            let openings = openings(&images, &on_it.path);
            let inside: Vec<_> = openings.iter().filter(|(at, ..)| at[0] < tip - 32.0).collect();
            let by_sigma = |(at, value, sigma): &&([f64; 2], f64, f64)| (value - normal * opening(at[0])) / sigma;
            let rms = (inside.iter().map(by_sigma).map(|z| z * z).sum::<f64>() / inside.len() as f64).sqrt();
            // Noise, and a path that is a pixel off.
            assert!(inside.len() > 8 && rms < 2.0, "{most} px open, {off} px off: {rms} sigma off, {inside:?}");
        }
    }
}

#[test]
fn nothing_else_is_taken_for_a_crack() {
    let s = spots();
    let moved = |y: [f64; 2]| s.grey(MOTION.material(y));
    let other = Spots::new(77, SIDE, 3.0);
    let covers = |y: [f64; 2]| y[0] < 130.0 && y[1] < 160.0;
    let wire = |y: [f64; 2]| (y[1] - 150.0 - 0.2 * y[0]).abs() < 5.0;
    let dark = |y: [f64; 2], at: f64| 1.0 - 0.45 * (0.5 + 0.5 * ((at - y[0] - 0.4 * y[1]) / 3.0).tanh());
    let hole = |y: [f64; 2], r: f64| (y[0] - 150.0).hypot(y[1] - 160.0) < r;
    let slip = |x: f64| if x > 159.3 { 1.0 } else { -1.0 };
    for (what, images) in [
        ("clean", pair(|x| s.grey(x), moved)),
        ("block", pair(|x| s.grey(x), |y| if covers(y) { 60.0 + 15.0 * other.at(y) } else { moved(y) })),
        ("wire", pair(|x| s.grey(x), |y| if wire(y) { 20.0 } else { moved(y) })),
        ("shadow", pair(|x| s.grey(x) * dark(x, 110.0), |y| moved(y) * dark(y, 220.0))),
        ("hole", pair(|x| if hole(x, 12.0) { 8.0 } else { s.grey(x) }, |y| if hole(y, 40.0) { 8.0 } else { moved(y) })),
        ("slip", pair(|x| s.grey(x), |y| s.grey([y[0] - 1.3, y[1] + 1.4 - slip(y[0] - 1.3)]))),
    ] {
        let found = search(&images);
        println!("{what}: {} marked", found.marked);
        found.rejected.iter().for_each(|rejected| println!("    {rejected}"));
        assert_eq!(found.cracks, [], "{what}");
        match what {
            "clean" => assert_eq!(found.rejected, []),
            "slip" => assert!(matches!(found.rejected[0].why, NoCrack::Slides(px) if (px - 2.0).abs() < 0.1)),
            _ => assert!(!found.rejected.is_empty(), "{what}"),
        }
    }
}

/// Beside an open crack the light changes: the elements there give up, since one gain for the zone is not theirs, and
/// their nodes on the faces are followed one by one.
#[test]
fn faces_in_another_light_are_followed_where_their_elements_give_up() {
    let (s, opening) = (spots(), 3.0);
    let line = Straight { at: [160.0, 151.3], slope: 0.05 };
    // A shadow that ends along the crack: the light rises by half a grey level per pixel.
    let dim =
        |x: [f64; 2]| if line.below(x) < 26.0 { 30.0 + 0.5 * x[0] + 0.4 * (s.grey(x) - 120.0) } else { s.grey(x) };
    let seen = |y: [f64; 2]| {
        let above = MOTION.material(y);
        let below = MOTION.material([y[0], y[1] - opening]);
        match (line.below(above) < 0.0, line.below(below) >= 0.0) {
            (true, _) => s.grey(above),
            (_, true) => dim(below),
            _ => 12.0,
        }
    };
    let images = pair(|x| s.grey(x), seen);
    let path = vec![[0.0, line.y(0.0)], [320.0, line.y(320.0)]];
    let mut zones = inside(SIDE, SIDE, 16);
    zones[0].cracks.push(Crack { path: path.clone(), guard: Crack::GUARD });
    let field = field(&images, &zones);
    assert_eq!(field.status, Status::Converged);
    let faces = field.mesh.cut_faces(&path).points;
    let left_out = field.marks.as_ref().unwrap().iter().filter(|mark| mark.is_left_out()).count();
    let marks = field.node_marks().unwrap();
    assert!(left_out > 15 && faces.iter().filter(|place| marks[place.minus].is_left_out()).count() > 10, "{left_out}");
    let values =
        CrackLine::on(&field.mesh, path, None).unwrap().read(&field, &NodalNoise::new(&field.mesh, &field.measured));
    let normal = 1.0 / 1f64.hypot(line.slope);
    let jumps: Vec<_> = values.points.iter().flatten().collect();
    assert!(jumps.len() + 2 >= faces.len(), "{} of {} places", jumps.len(), faces.len());
    for jump in jumps {
        let off = jump.opening.value - normal * opening;
        assert!(off.abs() < 5.0 * jump.opening.sigma && jump.opening.sigma < 0.5, "{off} of {}", jump.opening.sigma);
    }
}
