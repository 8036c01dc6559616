//! A measured field in the plane, and what the uncertainty of the camera does to it.

use super::model::times;
use super::still::{Similarity, StillMotion, StillZones};
use super::term::CameraTerm;
use super::{Camera, CameraError, PARAMETERS};
use crate::field::{Measurement, ModelError, PointField};
use crate::mesh::Mesh;
use crate::plane::Point;
use crate::units::Px;
use std::borrow::Cow;
use std::sync::Arc;

/// Of each parameter, its name in budgets.
const NAMES: [&str; PARAMETERS.len()] = [
    "lens",
    "lens_k2",
    "lens_p1",
    "lens_p2",
    "lens_k3",
    "lens_centre_x",
    "lens_centre_y",
    "tilt_x",
    "tilt_y",
    "tilt_stretch",
    "tilt_shear",
];

/// Maps the fields on one mesh into the plane.
///
/// ```
/// # use quadrille_base as quadrille;
/// # use quadrille::{camera::{Camera, CameraShape, Rectifier}, field::{Measurement, Status}, mesh::{Mesh, Roi, Zone}};
/// # let roi = Roi { x0: 900.0, y0: 900.0, x1: 932.0, y1: 932.0 };
/// # let mesh = std::sync::Arc::new(Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 1024, 1024).unwrap());
/// # let field = Measurement { status: Status::Converged, sigma: vec![[0.01; 2]; 9], measured: vec![true; 9],
/// #     displacement: vec![[20.0, 0.0]; 9], element_residual: vec![1.0; 4], model_error: None, marks: None,
/// #     points: None, mesh: mesh.clone() };
/// let mut shape = CameraShape::plain([1024, 1024]);
/// shape.theta[0] = 1e-3; // 0.1 % at the corner
/// let rectifier = Rectifier::new(Camera::new(shape).unwrap(), &mesh).unwrap();
/// let moved = rectifier.rectify(&field); // 20 px of the image, which is stretched there by 1 + k1 (r^2 + 2 x^2)
/// assert!((moved.displacement[0][0] - 19.976).abs() < 1e-3);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Rectifier {
    camera: Camera,
    /// The mesh as it is in the image.
    raw: Arc<Mesh<Px>>,
    /// Its nodes in the plane; the same mesh where the camera is plain.
    plane: Arc<Mesh<Px>>,
    /// What each column of the camera changes at each of its nodes, px of the plane.
    at_rest: Vec<Vec<Point>>,
    /// The zones that stay as they are.
    still: Option<StillZones>,
    /// Whether each node is mapped; all are, without.
    only: Option<Vec<bool>>,
}

impl Rectifier {
    /// Of the fields on `mesh`, in raw px.
    ///
    /// # Errors
    /// [`CameraError::Folds`] where a node, or an element, has no place in the plane; a still zone that is not there.
    pub fn new(camera: Camera, mesh: &Arc<Mesh<Px>>) -> Result<Self, CameraError> {
        let raw = Arc::clone(mesh);
        let still = |plane: &Mesh<Px>| StillZones::new(&camera.shape().still, &raw, plane.nodes());
        if camera.is_plain() {
            let at_rest = changes(&camera, raw.nodes(), |_| true);
            return Ok(Self { still: still(&raw)?, camera, plane: Arc::clone(&raw), at_rest, raw, only: None });
        }
        let place = |&[x, y]: &Point| camera.plane([x, y]).ok_or(CameraError::Folds { x, y });
        let places = mesh.nodes().iter().map(place).collect::<Result<Vec<_>, _>>()?;
        let [x, y] = mesh.nodes().first().copied().unwrap_or_default();
        let plane = mesh.with_nodes(&places).map_err(|_| CameraError::Folds { x, y })?;
        let at_rest = changes(&camera, plane.nodes(), |_| true);
        Ok(Self { still: still(&plane)?, camera, raw, plane: Arc::new(plane), at_rest, only: None })
    }

    /// The same where these nodes alone are read of what it maps: the displacements of the others are no numbers.
    /// Still zones need all nodes.
    pub fn only(&self, nodes: Option<Vec<bool>>) -> Self {
        Self { only: nodes.filter(|_| self.still.is_none()), ..self.clone() }
    }

    fn is_mapped(&self, node: usize) -> bool {
        self.only.as_ref().is_none_or(|only| only[node])
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The mesh in the image.
    pub fn raw_mesh(&self) -> &Arc<Mesh<Px>> {
        &self.raw
    }

    /// The mesh in the plane, px.
    pub fn mesh(&self) -> &Arc<Mesh<Px>> {
        &self.plane
    }

    /// The field in the plane: `U = P^-1(x + u) - P^-1(x)`, with standard uncertainties turned and scaled by
    /// `dP^-1/dx`; then less the motion of the still zones. A node whose place has left what the camera maps is no
    /// longer measured, nor is any where the still zones show nothing.
    pub fn rectify<'f>(&self, field: &'f Measurement<Px>) -> Cow<'f, Measurement<Px>> {
        let plane = self.mapped(field);
        let Some(still) = &self.still else { return plane };
        let mut plane = plane.into_owned();
        match still.fit(&plane, &plane.displacement) {
            Some(similarity) => map_nodes(&mut plane, |node, u, _| {
                let at = self.plane.nodes()[node];
                let (to, slope) = similarity.undone([at[0] + u[0], at[1] + u[1]]);
                Some(([to[0] - at[0], to[1] - at[1]], slope))
            }),
            None => map_nodes(&mut plane, |_, _, _| None),
        }
        Cow::Owned(plane)
    }

    /// How the still zones seem to move in a field that is in raw px; none where there are none, or too little of them
    /// is measured.
    pub fn still_motion(&self, field: &Measurement<Px>) -> Option<StillMotion> {
        let still = self.still.as_ref()?;
        let plane = self.mapped(field);
        Some(still.fit(&plane, &plane.displacement)?.motion())
    }

    /// Whether zones are stated that stay as they are.
    pub fn has_still(&self) -> bool {
        self.still.is_some()
    }

    /// As the camera maps it.
    fn mapped<'f>(&self, field: &'f Measurement<Px>) -> Cow<'f, Measurement<Px>> {
        if self.camera.is_plain() {
            return Cow::Borrowed(field);
        }
        let mut plane = field.clone();
        map_nodes(&mut plane, |node, u, near| {
            if !self.is_mapped(node) {
                return Some(([f64::NAN; 2], [[f64::NAN; 2]; 2]));
            }
            let ([x, y], [a, b]) = (self.raw.nodes()[node], self.plane.nodes()[node]);
            let (to, slope) = self.camera.plane_near([x + u[0], y + u[1]], [a + near[0], b + near[1]])?;
            Some(([to[0] - a, to[1] - b], slope))
        });
        plane.mesh = Arc::clone(&self.plane);
        Cow::Owned(plane)
    }

    /// The displacements of the plane on the mesh of the image, to be drawn there.
    pub fn displaced(&self, field: &Measurement<Px>) -> Measurement<Px> {
        Measurement { mesh: Arc::clone(&self.raw), ..self.rectify(field).into_owned() }
    }

    /// What the uncertainty of the camera does to a field, which is in the plane: [`rectify`](Self::rectify) has made
    /// it. Nodes that are not measured have none.
    pub fn terms(&self, plane: &Measurement<Px>) -> Vec<CameraTerm> {
        let (shape, n) = (self.camera.shape(), plane.measured.len());
        let moved =
            self.plane.nodes().iter().zip(&plane.displacement).map(|(from, u)| [from[0] + u[0], from[1] + u[1]]);
        let places: Vec<Point> = moved.collect();
        let measured = |node: &usize| plane.measured[*node] && self.is_mapped(*node);
        let changed =
            changes(&self.camera, &places, measured).into_iter().zip(&self.at_rest).map(|(mut change, at_rest)| {
                for node in (0..n).filter(measured) {
                    let ([x, y], [a, b]) = (change[node], at_rest[node]);
                    change[node] = [x - a, y - b];
                }
                change
            });
        let names = shape.covariance.of.iter().map(|&k| NAMES[k]);
        let mut terms: Vec<_> = names.zip(changed).map(|(name, change)| CameraTerm { name, change }).collect();
        let Some(still) = &self.still else {
            if shape.distance_std > 0.0 {
                let nearer = |at: &Point| [0, 1].map(|c| shape.distance_std * (at[c] - shape.theta[5 + c]));
                let change = places.iter().zip(&plane.measured).map(|(at, of)| if *of { nearer(at) } else { [0.0; 2] });
                terms.push(CameraTerm { name: "distance", change: change.collect() });
            }
            return terms;
        };
        let similarity = still.fit(plane, &plane.displacement);
        // Of what the camera is off the still zones take their part.
        for term in &mut terms {
            let Some(part) = still.fit(plane, &term.change) else { continue };
            for (v, &to) in term.change.iter_mut().zip(&places) {
                let of_zones = part.displacement(to);
                *v = [v[0] - of_zones[0], v[1] - of_zones[1]];
            }
        }
        terms.extend(similarity.map_or_else(|| Similarity::no_terms(places.len()), |found| found.terms(&places)));
        for term in &mut terms {
            term.change.iter_mut().zip(&plane.measured).filter(|(_, of)| !**of).for_each(|(v, _)| *v = [0.0; 2]);
        }
        terms
    }
}

/// What each column of the camera changes at places of the plane, px; zero at those that are not wanted.
fn changes(camera: &Camera, places: &[Point], is_wanted: impl Fn(&usize) -> bool) -> Vec<Vec<Point>> {
    let columns = camera.columns();
    let mut changes = vec![vec![[0.0; 2]; places.len()]; columns.len()];
    for place in (0..places.len()).filter(|place| !columns.is_empty() && is_wanted(place)) {
        let of_place = camera.plane_changes(places[place], columns).into_iter().flatten();
        changes.iter_mut().zip(of_place).for_each(|(list, change)| list[place] = change);
    }
    changes
}

/// Brings the displacement of each measured node to what `map` makes of it, which gives its slope as well; a node where
/// that is nothing is no longer measured. What `map` takes last is about what it will give.
fn map_nodes(field: &mut Measurement<Px>, map: impl Fn(usize, Point, Point) -> Option<(Point, [[f64; 2]; 2])>) {
    for node in 0..field.measured.len() {
        if !field.measured[node] {
            continue;
        }
        let u = field.displacement[node];
        let Some((moved, slope)) = map(node, u, u) else {
            field.measured[node] = false;
            (field.displacement[node], field.sigma[node]) = ([0.0; 2], [0.0; 2]);
            continue;
        };
        let spread = |sigma: Point| slope.map(|row| ((row[0] * sigma[0]).powi(2) + (row[1] * sigma[1]).powi(2)).sqrt());
        (field.displacement[node], field.sigma[node]) = (moved, spread(field.sigma[node]));
        if let Some(ModelError { nodes, .. }) = &mut field.model_error {
            nodes[node] = spread(nodes[node]);
        }
        if let Some(PointField { displacement, sigma, .. }) = &mut field.points {
            let value = displacement[node];
            let [x, y] = times(slope, [value[0] - u[0], value[1] - u[1]]);
            let near = [moved[0] + x, moved[1] + y];
            displacement[node] = map(node, value, near).map_or(moved, |(moved, _)| moved);
            sigma[node] = spread(sigma[node]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{CameraShape, Covariance};
    use crate::field::{Extensometer, NodalNoise, Quantities, Region, Segment, Status};
    use crate::mesh::{Roi, Zone};

    fn field(mesh: Mesh<Px>, u: impl Fn(Point) -> Point) -> Measurement<Px> {
        let displacement: Vec<_> = mesh.nodes().iter().map(|&x| u(x)).collect();
        let n = displacement.len();
        Measurement {
            status: Status::Converged,
            sigma: vec![[0.01, 0.02]; n],
            measured: vec![true; n],
            element_residual: vec![1.0; mesh.n_elements()],
            model_error: None,
            marks: None,
            points: None,
            mesh: mesh.into(),
            displacement,
        }
    }

    fn bent(std: f64) -> Camera {
        let mut shape = CameraShape::plain([512, 512]);
        shape.theta = [0.02, -0.01, 1e-3, -1e-3, 0.002, 250.0, 262.0, 5e-5, 2e-5, -0.001, 0.0005];
        shape.covariance = Covariance::of_std(&shape.theta.map(|v| std * v.abs()));
        Camera::new(shape).unwrap()
    }

    fn mesh() -> Mesh<Px> {
        Mesh::on_zones(&[Zone::rectangle("all", Roi { x0: 20.0, y0: 20.0, x1: 480.0, y1: 480.0 })], 32, 512, 512)
            .unwrap()
    }

    #[test]
    fn a_plane_that_only_moved_has_moved_alike_everywhere_and_one_that_stretched_alike() {
        let camera = bent(0.0);
        for (shift, stretch) in [([13.0, -7.0], 0.0), ([-3.0, 5.0], 0.01)] {
            let truth = |at: Point| [0, 1].map(|c| shift[c] + stretch * (at[c] - 250.0));
            let seen = field(mesh(), |x| {
                let at = camera.plane(x).unwrap();
                let u = truth(at);
                let to = camera.pixel([at[0] + u[0], at[1] + u[1]]);
                [to[0] - x[0], to[1] - x[1]]
            });
            let rectifier = Rectifier::new(camera.clone(), &seen.mesh).unwrap();
            let plane = rectifier.rectify(&seen);
            for (&at, u) in plane.mesh.nodes().iter().zip(&plane.displacement) {
                let want = truth(at);
                // Newton ends at 1e-10 of half a diagonal.
                assert!((u[0] - want[0]).hypot(u[1] - want[1]) < 1e-7, "{at:?} {u:?} {want:?}");
            }
        }
    }

    #[test]
    fn a_term_is_what_a_camera_that_is_off_by_a_standard_uncertainty_changes() {
        let camera = bent(1e-4);
        let seen = field(mesh(), |[x, y]| [20.0 + 0.01 * x, -5.0 - 0.02 * y]);
        let before = Rectifier::new(camera.clone(), &seen.mesh).unwrap();
        let plane = before.rectify(&seen);
        let terms = before.terms(&plane);
        assert_eq!(terms.len(), PARAMETERS.len());
        for (term, theta) in terms.iter().zip(camera.columns()) {
            let mut shape = camera.shape().clone();
            shape.theta.iter_mut().zip(theta).for_each(|(a, b)| *a += b);
            let after = Rectifier::new(Camera::new(shape).unwrap(), &seen.mesh).unwrap().rectify(&seen);
            let largest = term.change.iter().flatten().fold(0.0f64, |most, v| most.max(v.abs()));
            for ((a, b), change) in after.displacement.iter().zip(&plane.displacement).zip(&term.change) {
                for c in 0..2 {
                    // To first order: a ten-thousandth of the parameter, squared, and Newton's 1e-10.
                    assert!((a[c] - b[c] - change[c]).abs() < 2e-3 * largest + 1e-8, "{theta:?}");
                }
            }
        }
    }

    #[test]
    fn what_is_read_at_places_needs_the_nodes_around_them_alone() {
        let camera = bent(1e-4);
        let mut seen = field(mesh(), |[x, y]| [20.0 + 0.01 * x + 1e-5 * y * y, -5.0 - 0.02 * y]);
        seen.measured[50] = false; // near the line
        let whole = Rectifier::new(camera, &seen.mesh).unwrap();
        let quantities = Quantities {
            points: vec![("a".to_owned(), [251.0, 243.0]), ("out".to_owned(), [5.0, 5.0])],
            lines: vec![("b".to_owned(), Segment::new([70.0, 70.0], [200.0, 70.0], 8.0).unwrap())],
            extensometers: vec![("c".to_owned(), Extensometer::new([60.0, 400.0], [300.0, 400.0], 50.0).unwrap())],
            ..Quantities::default()
        };
        let nodes = quantities.nodes(whole.mesh()).unwrap();
        assert!(nodes.contains(&true) && nodes.contains(&false));
        let drawn = [whole.only(Some(nodes)), whole].map(|rectifier| {
            let plane = rectifier.rectify(&seen);
            let noise = NodalNoise::of(&*plane).mapped_from(rectifier.raw_mesh());
            let read = |field: &Measurement<Px>| quantities.draw(field, &noise, None);
            let changed = rectifier.terms(&plane).into_iter().map(|term| {
                let add = |(u, by): (&Point, Point)| [u[0] + by[0], u[1] + by[1]];
                let displacement = plane.displacement.iter().zip(term.change).map(add).collect();
                read(&Measurement { displacement, ..plane.clone().into_owned() })
            });
            [read(&plane)].into_iter().chain(changed).collect::<Vec<_>>()
        });
        assert!(drawn[0][0].extensometers[0].is_some() && drawn[0][0].points[0].is_some());
        assert!(drawn[0].len() == 1 + PARAMETERS.len() && drawn[0] == drawn[1]);
        let of_zone = Quantities { regions: vec![("d".to_owned(), Region::of_zone(0))], ..quantities };
        assert_eq!(of_zone.nodes(&seen.mesh), None);
    }

    /// A specimen between two rails.
    fn between_rails() -> Mesh<Px> {
        let zone = |name: &str, x0, x1| Zone::rectangle(name, Roi { x0, y0: 20.0, x1, y1: 480.0 });
        let zones = [zone("specimen", 120.0, 392.0), zone("left", 20.0, 84.0), zone("right", 424.0, 488.0)];
        Mesh::on_zones(&zones, 16, 512, 512).unwrap()
    }

    fn held(std: f64) -> Camera {
        let shape = CameraShape { still: vec!["left".into(), "right".into()], ..bent(std).shape().clone() };
        Camera::new(shape).unwrap()
    }

    /// What is seen of rails that the camera moved, and of a specimen that was stretched besides.
    fn seen_between_rails(camera: &Camera, rails_measured: bool) -> Measurement<Px> {
        let moved = |[x, y]: Point| {
            [250.0 + 3.0 + 1.002 * (x - 250.0) - 0.01 * y, 262.0 - 2.0 + 1.002 * (y - 262.0) + 0.01 * x]
        };
        let stretched = |[x, y]: Point| [x + 0.5 + 0.01 * (x - 250.0), y];
        let mesh = between_rails();
        let specimen = mesh.zone_nodes(0);
        let mut seen = field(mesh, |x| {
            let at = camera.plane(x).unwrap();
            let is_rail = !(100.0..410.0).contains(&x[0]);
            let to = camera.pixel(moved(if is_rail { at } else { stretched(at) }));
            [to[0] - x[0], to[1] - x[1]]
        });
        seen.measured.iter_mut().enumerate().for_each(|(node, of)| *of = rails_measured || specimen.contains(&node));
        seen
    }

    #[test]
    fn what_the_still_zones_seem_to_do_is_taken_off_the_specimen() {
        let camera = held(0.0);
        let seen = seen_between_rails(&camera, true);
        let rectifier = Rectifier::new(camera.clone(), &seen.mesh).unwrap();
        let plane = rectifier.rectify(&seen);
        for (node, u) in plane.displacement.iter().enumerate() {
            let [x, _] = plane.mesh.nodes()[node];
            let want = if plane.mesh.zone_nodes(0).contains(&node) { 0.5 + 0.01 * (x - 250.0) } else { 0.0 };
            assert!((u[0] - want).abs() < 1e-6 && u[1].abs() < 1e-6, "{node} {u:?} {want}");
        }
        let motion = rectifier.still_motion(&seen).unwrap();
        let turned = 0.01f64.atan2(1.002);
        assert!((motion.growth.value - (1.002f64.hypot(0.01) - 1.0)).abs() < 1e-9, "{motion:?}");
        assert!((motion.turn_rad.value - turned).abs() < 1e-9 && motion.strain.value.abs() < 1e-9, "{motion:?}");
        // 5 by 30 nodes on each side: of the order of sigma over the distance and the root of their number.
        assert!(motion.growth.sigma > 1e-6 && motion.growth.sigma < 1e-5 && motion.squares < 1e-9, "{motion:?}");
    }

    #[test]
    fn of_a_camera_that_is_off_the_still_zones_take_their_part() {
        let seen = seen_between_rails(&held(0.0), true);
        let camera = held(1e-4);
        let before = Rectifier::new(camera.clone(), &seen.mesh).unwrap();
        let plane = before.rectify(&seen);
        let terms = before.terms(&plane);
        let names: Vec<_> = terms.iter().map(|term| term.name).collect();
        assert_eq!(names[PARAMETERS.len()..], ["distance", "still_turn", "still_x", "still_y"]);
        for (term, theta) in terms.iter().zip(camera.columns()) {
            let mut shape = camera.shape().clone();
            shape.theta.iter_mut().zip(theta).for_each(|(a, b)| *a += b);
            let after = Rectifier::new(Camera::new(shape).unwrap(), &seen.mesh).unwrap().rectify(&seen);
            for node in plane.mesh.zone_nodes(0) {
                let change = [0, 1].map(|c| after.displacement[node][c] - plane.displacement[node][c]);
                let off = (change[0] - term.change[node][0]).hypot(change[1] - term.change[node][1]);
                // The places of the zones move as well, by as little as the camera is off: a hundredth of 20 px of motion.
                assert!(off < 1e-2 * term.change[node][0].hypot(term.change[node][1]) + 2e-5, "{} {off}", term.name);
            }
        }
        let motion = before.still_motion(&seen).unwrap();
        let of_distance = &terms[PARAMETERS.len()];
        let [x, y] = plane.mesh.nodes()[0];
        let far = (x - motion.centre[0] + 0.01 * x).hypot(y - motion.centre[1]);
        let change = of_distance.change[0][0].hypot(of_distance.change[0][1]);
        assert!((change / (motion.growth.sigma * far) - 1.0).abs() < 0.02, "{change} {motion:?}");
    }

    #[test]
    fn without_what_is_still_nothing_is_known_in_the_plane() {
        let camera = held(1e-4);
        let seen = seen_between_rails(&camera, false);
        let rectifier = Rectifier::new(camera.clone(), &seen.mesh).unwrap();
        let plane = rectifier.rectify(&seen);
        assert!(!plane.measured.contains(&true) && rectifier.still_motion(&seen).is_none());
        let terms = rectifier.terms(&plane);
        assert!(terms.len() == PARAMETERS.len() + 4 && terms.iter().flat_map(|t| &t.change).all(|v| *v == [0.0; 2]));
        let other = CameraShape { still: vec!["rail".into()], ..camera.shape().clone() };
        let refused = Rectifier::new(Camera::new(other).unwrap(), &seen.mesh).unwrap_err();
        assert!(refused.to_string().contains("no zone 'rail'; there are specimen, left, right"), "{refused}");
    }
}
