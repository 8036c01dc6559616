//! How the two zones of a joint face each other: found from where they lie, whatever they are called.
//!
//! Positions are px of the image, y down, but for [`Faces::normal`].

#![expect(
    clippy::indexing_slicing,
    reason = "zones, axes and corners are arrays of two and four, counted as such; nodes are numbers of a mesh that Mesh::from_zones has checked"
)]

use crate::case::{CaseElements, CaseFile, CaseGuard, CaseZone};
use crate::field::Facing;
use crate::mesh::{Mesh, ZoneElements};
use crate::mesh_file::read_mesh;
use crate::plane::{Point, cross, dot, minus, unit};
use crate::units::Px;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Largest less smallest thickness of an adhesive, by the mean, for faces that count as parallel.
const EVEN: f64 = 0.1;
/// Cosine of the largest angle at which two straight sides still are what a user means by facing edges: 37 degrees.
const FACING: f64 = 0.8;
/// Corners that move by less are not spoken of, px.
const UNSAID: f64 = 0.05;

/// What is known of the faces of the adhesive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Faces {
    /// Their distance, px.
    pub gap_px: f64,
    /// Unit normal from the first to the second zone, the mean along the joint; x to the right, y **up**.
    pub normal: Point,
}

/// Checks that `names` face each other, begins their elements at the facing edges, and leaves `guard` px out there.
pub(super) fn face_each_other(
    case: &mut CaseFile,
    names: &[String; 2],
    guard: f64,
    element: f64,
    notes: &mut Vec<String>,
) -> Result<Faces, String> {
    let meshes = expand_groups(&mut case.zones, &case.base)?;
    let still = case.camera.as_ref().and_then(|camera| camera.still.clone()).unwrap_or_default();
    let at = numbers(&case.zones, names, &still, case.reduction.is_some())?;
    let shapes = [0, 1].map(|k| shape(&case.zones[at[k]], meshes[at[k]].as_ref()));
    let [first, second] = shapes;
    let joint = Joint { names, guard, element };
    // The zones in the order of their names.
    let mut zones = at.map(|at| case.zones[at].clone());
    let faces = match (first?, second?) {
        (Shape::Rectangle(first), Shape::Rectangle(second)) => {
            joint.between_rectangles(&mut zones, [first, second], notes)?
        }
        (Shape::Mesh(first), Shape::Mesh(second)) => joint.between_meshes(&mut zones, [first, second], notes)?,
        (Shape::Mesh(_), _) | (_, Shape::Mesh(_)) => {
            return Err(format!(
                "[interface] one of the zones \"{}\" and \"{}\" has a mesh file and the other has none: the nodes of their faces \
                 have to lie opposite each other; give both a mesh file, or none",
                names[0], names[1]
            ));
        }
        (first, second) => {
            let corners = [(0, first), (1, second)].map(|(k, shape)| as_polygon(&mut zones[k], &shape));
            joint.between_polygons(&mut zones, corners, notes)?
        }
    };
    for (at, zone) in at.into_iter().zip(zones) {
        case.zones[at] = zone;
    }
    Ok(faces)
}

/// Makes one zone of each group of a mesh file, named as by a correlation, with their elements, if any.
fn expand_groups(zones: &mut Vec<CaseZone>, base: &Path) -> Result<Vec<Option<ZoneElements>>, String> {
    let mut meshes = Vec::new();
    let mut all = Vec::new();
    for zone in zones.drain(..) {
        let Some(file) = &zone.mesh else {
            all.push(zone);
            meshes.push(None);
            continue;
        };
        let path = base.join(file);
        let file = read_mesh(&path).map_err(|error| error.to_string())?;
        let groups = match &zone.group {
            Some(group) => vec![file.group(group, &path).map_err(|error| error.to_string())?],
            None => file.zones,
        };
        let alone = groups.len() == 1;
        for mut elements in groups {
            let group = elements.name.clone();
            if let Some(name) = &zone.name {
                elements.name = if alone { name.clone() } else { format!("{name} {group}") };
            }
            all.push(CaseZone { name: Some(elements.name.clone()), group: Some(group), ..zone.clone() });
            meshes.push(Some(elements));
        }
    }
    *zones = all;
    Ok(meshes)
}

/// The places of the two zones called `names`, which have to be all there are beside those that are `still`; where `more`
/// are allowed, for the load points of a reduction, the first.
fn numbers(zones: &[CaseZone], names: &[String; 2], still: &[String], more: bool) -> Result<[usize; 2], String> {
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
            "[interface] zones names \"{}\" twice; name the zones on both sides of the adhesive",
            names[0]
        ));
    }
    let is_part = |zone: &&CaseZone| zone.name.as_ref().is_none_or(|name| !still.contains(name));
    if more && at.iter().any(|at| *at > 1) {
        return Err(format!("list the zones of [interface] first; there are {there}"));
    }
    if !more && zones.iter().filter(is_part).count() != 2 {
        return Err(format!(
            "there are {} zones ({there}); a joint has two, those of [interface]; [camera] still may name others, and [reduction] those \
             where loads act",
            zones.len()
        ));
    }
    Ok(at)
}

/// What a zone is for a joint.
enum Shape {
    /// x0, y0, x1, y1.
    Rectangle([f64; 4]),
    Polygon([Point; 4]),
    Mesh(ZoneElements),
}

fn shape(zone: &CaseZone, elements: Option<&ZoneElements>) -> Result<Shape, String> {
    let name = zone.name.as_deref().unwrap_or("");
    if zone.in_mm.is_some() {
        return Err(format!("zone \"{name}\": the zones of a joint are given in px; take in_mm away"));
    }
    if let Some(elements) = elements {
        return Ok(Shape::Mesh(elements.clone()));
    }
    match (&zone.polygon, zone.roi) {
        _ if zone.mask.is_some() => {}
        (Some(polygon), None) => {
            let Ok(corners) = <[Point; 4]>::try_from(polygon.as_slice()) else {
                return Err(format!(
                    "zone \"{name}\": its polygon has {} corners; quadrille run lays elements along the sides of a rectangle or of a \
                     polygon with four; for another shape give a mesh file (mesh = \"strips.msh\")",
                    polygon.len()
                ));
            };
            return Ok(Shape::Polygon(corners));
        }
        (None, Some(corners)) => {
            if !(corners.iter().all(|v| v.is_finite()) && corners[0] < corners[2] && corners[1] < corners[3]) {
                return Err(format!(
                    "zone \"{name}\": roi = {corners:?} is not a rectangle; give x0, y0, x1, y1 with x0 < x1 and y0 < y1"
                ));
            }
            return Ok(Shape::Rectangle(corners));
        }
        _ => {}
    }
    Err(format!(
        "zone \"{name}\": quadrille run needs a rectangle, roi = [x0, y0, x1, y1], or a polygon with four corners, or a mesh file, and \
         no mask"
    ))
}

/// The corners of a rectangle or polygon; a zone that was a rectangle becomes a polygon.
fn as_polygon(zone: &mut CaseZone, shape: &Shape) -> [Point; 4] {
    match shape {
        Shape::Polygon(corners) => *corners,
        #[expect(clippy::unreachable, reason = "the caller has told meshes apart")]
        Shape::Mesh(_) => unreachable!("meshes are asked for before"),
        &Shape::Rectangle([x0, y0, x1, y1]) => {
            zone.roi = None;
            if let Some(CaseGuard::Rectangle { left, top, right, bottom }) = zone.guard_px {
                zone.guard_px = Some(CaseGuard::Sides(vec![top, right, bottom, left]));
            }
            [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
        }
    }
}

/// What the interface asks for.
struct Joint<'a> {
    names: &'a [String; 2],
    guard: f64,
    element: f64,
}

impl Joint<'_> {
    /// Names in messages: `"first" and "second"`.
    fn both(&self) -> String {
        format!("\"{}\" and \"{}\"", self.names[0], self.names[1])
    }

    fn overlap(&self) -> String {
        format!("[interface] zones {} overlap; leave the gap of the adhesive between them", self.both())
    }

    fn not_facing(&self) -> String {
        format!(
            "[interface] zones {} have no edges that face each other across a gap; draw them on both sides of the adhesive",
            self.both()
        )
    }

    /// The faces with this normal (y down) from the first to the second zone. Where one of them is above the other the
    /// first has to be the one below, since that is how a case begins that takes y for pointing up.
    fn faces(&self, gap_px: f64, normal: Point) -> Result<Faces, String> {
        let [first, second] = self.names;
        if normal[1] > 0.0 && normal[1] >= normal[0].abs() {
            return Err(format!(
                "[interface] zone \"{first}\" does not lie below zone \"{second}\" with a gap between them; y is down: swap the names, \
                 zones = [\"{second}\", \"{first}\"]"
            ));
        }
        Ok(Faces { gap_px, normal: [normal[0], 0.0 - normal[1]] })
    }

    /// What was found, where it is not what every case has: two rectangles one below the other.
    fn note(&self, faces: &Faces, edges: [&str; 2]) -> String {
        let [first, second] = self.names;
        let degrees = faces.normal[1].atan2(faces.normal[0]).to_degrees();
        // No -0.0 in a sentence.
        let degrees = (10.0 * degrees).round() / 10.0 + 0.0;
        format!(
            "the joint lies between {} of zone \"{first}\" and {} of zone \"{second}\", {:.2} px apart; its normal points from \
             \"{first}\" to \"{second}\", {degrees:.1} degrees from x towards y (up)",
            edges[0], edges[1], faces.gap_px
        )
    }

    fn between_rectangles(
        &self,
        zones: &mut [CaseZone; 2],
        mut boxes: [[f64; 4]; 2],
        notes: &mut Vec<String>,
    ) -> Result<Faces, String> {
        let [first, second] = boxes;
        let share = [0, 1].map(|c| first[c] < second[c + 2] && second[c] < first[c + 2]);
        // The axis across the joint.
        let c = match share {
            [true, true] => return Err(self.overlap()),
            [false, false] => return Err(self.not_facing()),
            [true, false] => 1,
            [false, true] => 0,
        };
        // Whole elements are laid from the left or upper edge of a rectangle: of the zone whose face is its other edge
        // they begin there, and the rectangle with them.
        let ahead = usize::from(first[c] >= second[c + 2]);
        let gap_px = boxes[1 - ahead][c] - boxes[ahead][c + 2];
        let mut normal = [0.0; 2];
        normal[c] = if ahead == 0 { 1.0 } else { -1.0 };
        let faces = self.faces(gap_px, normal)?;
        if c == 0 {
            let edges =
                if ahead == 0 { ["the right edge", "the left edge"] } else { ["the left edge", "the right edge"] };
            notes.push(self.note(&faces, edges));
        }
        let corners = &mut boxes[ahead];
        let n = ((corners[c + 2] - corners[c]) / self.element + 1e-9).floor();
        let begin = corners[c + 2] - n * self.element;
        if n >= 1.0 && (begin - corners[c]).abs() > 1e-9 {
            let (edge, key) = [("right", "x0"), ("lower", "y0")][c];
            notes.push(format!(
                "zone \"{}\": its elements are laid from its {edge} edge, the face of the adhesive; {key} = {begin}",
                self.names[ahead]
            ));
            corners[c] = begin;
        }
        // Rounding must not take the last row away.
        corners[c + 2] = corners[c] + n.max(1.0) * self.element;
        for (k, (zone, corners)) in zones.iter_mut().zip(boxes).enumerate() {
            zone.roi = Some(corners);
            if zone.guard_px.is_none() {
                let mut sides = [0.0; 4];
                sides[if k == ahead { c + 2 } else { c }] = self.guard;
                let [left, top, right, bottom] = sides;
                zone.guard_px = Some(CaseGuard::Rectangle { left, top, right, bottom });
            }
        }
        Ok(faces)
    }

    fn between_polygons(
        &self,
        zones: &mut [CaseZone; 2],
        corners: [[Point; 4]; 2],
        notes: &mut Vec<String>,
    ) -> Result<Faces, String> {
        for (name, corners) in self.names.iter().zip(&corners) {
            let turns: [f64; 4] = std::array::from_fn(|k| {
                cross(minus(corners[(k + 1) % 4], corners[k]), minus(corners[(k + 2) % 4], corners[(k + 1) % 4]))
            });
            let convex = turns.iter().all(|t| *t > 0.0) || turns.iter().all(|t| *t < 0.0);
            if !(convex && corners.iter().flatten().all(|v| v.is_finite())) {
                return Err(format!(
                    "zone \"{name}\": a corner of its polygon points inwards, or its sides cross; give four corners in order around the \
                     strip, or a mesh file"
                ));
            }
        }
        if overlap(&corners) {
            return Err(self.overlap());
        }
        let sides = (0..4).flat_map(|i| (0..4).map(move |j| [i, j]));
        let between = sides.filter_map(|sides| Between::new(&corners, sides));
        let nearest = between.min_by(|a, b| a.mean().total_cmp(&b.mean())).ok_or_else(|| self.not_facing())?;
        let Between { sides, normal, tangent, common, gaps } = nearest;
        if (gaps[1] - gaps[0]).abs() > EVEN * nearest.mean() {
            let [a, b] = [0, 1].map(|k| unit(side(&corners[k], sides[k])));
            return Err(format!(
                "[interface] the facing edges of zones {} are {:.2} degrees from parallel: the adhesive would be {:.2} px thick at one \
                 end and {:.2} px at the other, more than a tenth of its thickness; draw the edges where its faces are",
                self.both(),
                cross(a, b).abs().asin().to_degrees(),
                gaps[0],
                gaps[1]
            ));
        }
        if common[1] - common[0] < self.element {
            return Err(format!(
                "[interface] the facing edges of zones {} lie side by side over {:.1} px only, less than an element of {} px",
                self.both(),
                common[1] - common[0],
                self.element
            ));
        }
        let faces = self.faces(nearest.mean(), normal)?;
        let mut edges = [String::new(), String::new()];
        for (k, zone) in zones.iter_mut().enumerate() {
            let mut around = corners[k];
            around.rotate_left(sides[k]);
            if let Some(CaseGuard::Sides(widths)) = &mut zone.guard_px
                && widths.len() == 4
            {
                widths.rotate_left(sides[k]);
            }
            let [x0, y0, x1, y1] = [around[0][0], around[0][1], around[1][0], around[1][1]];
            edges[k] = format!("the edge from ({x0}, {y0}) to ({x1}, {y1})");
            let cut = cut(around, tangent, common);
            let moved =
                cut.iter().zip(around).map(|(a, b)| minus(*a, b)).fold(0.0_f64, |most, d| most.max(d[0].hypot(d[1])));
            if moved > UNSAID {
                let list: Vec<String> = cut.iter().map(|[x, y]| format!("[{x:.2}, {y:.2}]")).collect();
                notes.push(format!(
                    "zone \"{}\": its elements end where both faces do; polygon = [{}]",
                    self.names[k],
                    list.join(", ")
                ));
            }
            zone.polygon = Some(cut.to_vec());
            zone.elements = Some(CaseElements::Mapped);
            if zone.guard_px.is_none() {
                zone.guard_px = Some(CaseGuard::Along { along: cut[..2].to_vec(), width: self.guard });
            }
        }
        notes.push(self.note(&faces, [&edges[0], &edges[1]]));
        Ok(faces)
    }

    fn between_meshes(
        &self,
        zones: &mut [CaseZone; 2],
        meshes: [ZoneElements; 2],
        notes: &mut Vec<String>,
    ) -> Result<Faces, String> {
        let mesh: Mesh<Px> = Mesh::from_zones(meshes.into()).map_err(|error| error.to_string())?;
        let [first, second] = self.names;
        let opposite = Opposite::new(&mesh);
        // What sees the other zone has to have a node opposite: else the faces are cut differently.
        for (k, [plus, minus]) in [[first, second], [second, first]].into_iter().enumerate() {
            let seen = Facing::between(&mesh, plus, minus).map_err(|_| self.not_facing())?;
            if let Some(lone) = seen.points().iter().find(|point| !opposite.faced.contains(&(point.node() as u32))) {
                let [x, y] = mesh.nodes()[lone.node()];
                return Err(format!(
                    "[interface] the nodes on the facing edges of zones {} do not lie opposite each other: that at ({x:.1}, {y:.1}) px \
                     of zone \"{}\" has none; cut both faces alike",
                    self.both(),
                    self.names[k]
                ));
            }
        }
        let faces = match opposite.faces.as_slice() {
            [faces] => faces,
            [] => return Err(self.not_facing()),
            faces => {
                return Err(format!(
                    "[interface] zones {} face each other in {} places; a joint has one pair of faces",
                    self.both(),
                    faces.len()
                ));
            }
        };
        let at = |&node: &u32| mesh.nodes()[node as usize];
        let lines = [0, 1].map(|k| faces.iter().map(|pair| at(&pair[k])).collect::<Vec<Point>>());
        let (mut sum, mut gaps) = ([0.0; 2], Vec::new());
        for (a, b) in lines[0].windows(2).zip(lines[1].windows(2)) {
            let [dx, dy] = [0, 1].map(|c| 0.5 * (a[1][c] + b[1][c] - a[0][c] - b[0][c]));
            // Along an edge of the first zone what lies outside is on this side.
            let normal = unit([dy, -dx]);
            sum = [sum[0] + dy, sum[1] - dx];
            gaps.extend((0..2).map(|k| dot(minus(b[k], a[k]), normal)));
        }
        let gap_px = gaps.iter().sum::<f64>() / gaps.len() as f64;
        let [thin, thick] = gaps.iter().fold([f64::INFINITY, 0.0], |[low, high], gap| [gap.min(low), gap.max(high)]);
        if thin < 0.0 {
            return Err(self.overlap());
        }
        if thick - thin > EVEN * gap_px {
            return Err(format!(
                "[interface] the facing edges of zones {} are not parallel: the adhesive would be {thin:.2} to {thick:.2} px thick, \
                 which differ by more than a tenth; mesh the strips up to its faces",
                self.both()
            ));
        }
        let found = self.faces(gap_px, unit(sum))?;
        let edges = lines.each_ref().map(|line| format!("the border of {} nodes", line.len()));
        for (zone, along) in zones.iter_mut().zip(lines) {
            if zone.guard_px.is_none() {
                zone.guard_px = Some(CaseGuard::Along { along, width: self.guard });
            }
        }
        notes.push(self.note(&found, [&edges[0], &edges[1]]));
        Ok(found)
    }
}

/// Nodes of two zones of a mesh that lie opposite each other, as the mechanics pairs them.
struct Opposite {
    /// The faces: pairs of a node of the first and one of the second zone, in the order around the first.
    faces: Vec<Vec<[u32; 2]>>,
    /// All nodes of pairs.
    faced: HashSet<u32>,
}

impl Opposite {
    fn new(mesh: &Mesh<Px>) -> Self {
        let borders = [0, 1].map(|zone| mesh.boundary(zone));
        let nearest = |from: usize| -> HashMap<u32, u32> {
            let distance = |a: u32, b: u32| {
                let [x, y] = minus(mesh.nodes()[a as usize], mesh.nodes()[b as usize]);
                x * x + y * y
            };
            let beside = |&[node, _]: &[u32; 2]| {
                let others = borders[1 - from].iter().map(|edge| edge[0]);
                let order = |a: &u32, b: &u32| distance(node, *a).total_cmp(&distance(node, *b)).then(a.cmp(b));
                others.min_by(order).map(|other| (node, other))
            };
            borders[from].iter().filter_map(beside).collect()
        };
        let (ours, theirs) = (nearest(0), nearest(1));
        let paired = |node: u32| ours.get(&node).copied().filter(|other| theirs.get(other) == Some(&node));
        let across: HashSet<[u32; 2]> = borders[1].iter().copied().collect();
        let mut next: HashMap<u32, u32> = HashMap::new();
        let (mut ends, mut faced) = (HashSet::new(), HashSet::new());
        for &[a, b] in &borders[0] {
            if let (Some(pa), Some(pb)) = (paired(a), paired(b))
                && across.contains(&[pb, pa])
            {
                next.insert(a, b);
                ends.insert(b);
                faced.extend([a, b, pa, pb]);
            }
        }
        let begins =
            borders[0].iter().map(|edge| edge[0]).filter(|node| next.contains_key(node) && !ends.contains(node));
        let face = |begin: u32| {
            let nodes = std::iter::successors(Some(begin), |node| next.get(node).copied());
            nodes.filter_map(|node| Some([node, paired(node)?])).collect()
        };
        Self { faces: begins.map(face).collect(), faced }
    }
}

/// Two sides of polygons that look at each other.
struct Between {
    /// Number of the side of each.
    sides: [usize; 2],
    /// Unit normal from the first to the second.
    normal: Point,
    tangent: Point,
    /// Where both are, along the tangent.
    common: [f64; 2],
    /// Their distance at both ends of that.
    gaps: [f64; 2],
}

impl Between {
    /// `None` where they do not look at each other.
    fn new(corners: &[[Point; 4]; 2], sides: [usize; 2]) -> Option<Self> {
        let outward = [0, 1].map(|k| {
            let area: f64 = (0..4).map(|i| cross(corners[k][i], corners[k][(i + 1) % 4])).sum();
            let [dx, dy] = unit(side(&corners[k], sides[k]));
            if area > 0.0 { [dy, -dx] } else { [-dy, dx] }
        });
        if dot(outward[0], outward[1]) > -FACING {
            return None;
        }
        let normal = unit(minus(outward[0], outward[1]));
        let tangent = [-normal[1], normal[0]];
        let ends = [0, 1].map(|k| [corners[k][sides[k]], corners[k][(sides[k] + 1) % 4]]);
        let reach = ends.map(|ends| {
            let [a, b] = ends.map(|end| dot(end, tangent));
            [a.min(b), a.max(b)]
        });
        let common = [reach[0][0].max(reach[1][0]), reach[0][1].min(reach[1][1])];
        let height = |k: usize, s: f64| dot(on(ends[k], tangent, s), normal);
        let gaps = common.map(|s| height(1, s) - height(0, s));
        (common[0] < common[1] && gaps[0] + gaps[1] > 0.0).then_some(Self { sides, normal, tangent, common, gaps })
    }

    fn mean(&self) -> f64 {
        0.5 * (self.gaps[0] + self.gaps[1])
    }
}

/// The quadrilateral, first side the face, as far as the face lies in `common` along the tangent; both sides cut alike.
fn cut(around: [Point; 4], tangent: Point, common: [f64; 2]) -> [Point; 4] {
    let [a, b, c, d] = around;
    let [from, to] = [a, b].map(|end| dot(end, tangent));
    // Ends that are meant stay where they are, to the bit.
    let snapped = |t: f64| if (t - t.round()).abs() < 1e-9 { t.round() } else { t };
    let mut shares = common.map(|s| snapped((s - from) / (to - from)));
    shares.sort_by(f64::total_cmp);
    let between = |p: Point, q: Point, t: f64| [0, 1].map(|k| (1.0 - t) * p[k] + t * q[k]);
    let [low, high] = shares;
    [between(a, b, low), between(a, b, high), between(d, c, high), between(d, c, low)]
}

/// Whether two convex polygons have a point in common: no side of either has the other beyond it.
fn overlap(corners: &[[Point; 4]; 2]) -> bool {
    let parted = |k: usize| {
        let area: f64 = (0..4).map(|i| cross(corners[k][i], corners[k][(i + 1) % 4])).sum();
        (0..4).any(|i| {
            let along = side(&corners[k], i);
            corners[1 - k].iter().all(|p| cross(along, minus(*p, corners[k][i])) * area <= 0.0)
        })
    };
    !(parted(0) || parted(1))
}

/// From corner `k` to the next.
fn side(corners: &[Point; 4], k: usize) -> Point {
    minus(corners[(k + 1) % 4], corners[k])
}

/// The point of the line through `ends` at `s` along the tangent.
fn on([a, b]: [Point; 2], tangent: Point, s: f64) -> Point {
    let [from, to] = [a, b].map(|end| dot(end, tangent));
    let t = (s - from) / (to - from);
    [0, 1].map(|k| (1.0 - t) * a[k] + t * b[k])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run_case::{RunCase, parse_run_case};

    const REST: &str = "[interface]\nzones = ['a', 'b']\n[substrate]\nE_MPa = 1.0\n[cohesive]\nr = 4.0\n";

    fn case_in(folder: &Path, zones: &str) -> Result<RunCase, String> {
        let text = format!("[images]\ndeformed = 'x*.png'\npixel_size_mm = 0.002\n{zones}{REST}");
        parse_run_case(&text, &folder.join("case.toml")).map_err(|error| error.to_string())
    }

    fn case(a: &str, b: &str) -> Result<RunCase, String> {
        case_in(Path::new(""), &format!("[[zone]]\nname = 'a'\n{a}\n[[zone]]\nname = 'b'\n{b}\n"))
    }

    #[track_caller]
    fn refused(a: &str, b: &str, words: &[&str]) {
        let message = case(a, b).map(|case| format!("{:?}", case.correlation.zones)).unwrap_err();
        words.iter().for_each(|word| assert!(message.contains(word), "'{word}' in: {message}"));
    }

    /// Two strips of 96 by 40 px, 30 px apart, turned by `degrees` (x towards y) about (200, 200): below, above.
    fn turned(degrees: f64) -> [[Point; 4]; 2] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [[15.0, 55.0], [-55.0, -15.0]].map(|[top, bottom]| {
            [[-48.0, top], [48.0, top], [48.0, bottom], [-48.0, bottom]]
                .map(|[x, y]| [200.0 + cos * x - sin * y, 200.0 + sin * x + cos * y])
        })
    }

    #[test]
    fn zones_side_by_side_face_each_other_in_either_order_and_elements_begin_at_the_faces() {
        let (left, right) = ("roi = [10, 20, 60, 100]", "roi = [90, 20, 140, 100]");
        let sides = |left, right| Some(CaseGuard::Rectangle { left, top: 0.0, right, bottom: 0.0 });
        for (case, at, normal) in [(case(left, right), [0, 1], [1.0, 0.0]), (case(right, left), [1, 0], [-1.0, 0.0])] {
            let case = case.unwrap();
            let [left, right] = at.map(|k| &case.correlation.zones[k]);
            // 50 px hold three elements of 16: columns from 60 back to 12, and from 90 on.
            assert_eq!((left.roi, &left.guard_px), (Some([12.0, 20.0, 60.0, 100.0]), &sides(0.0, 3.0)));
            assert_eq!((right.roi, &right.guard_px), (Some([90.0, 20.0, 140.0, 100.0]), &sides(3.0, 0.0)));
            assert!((case.thickness_mm - 0.06).abs() < 1e-12);
            assert_eq!(case.normal, normal);
            assert!(case.notes[0].contains("points from \"a\" to \"b\""), "{:?}", case.notes);
            assert!(case.notes[1].contains("right edge") && case.notes[1].contains("x0 = 12"), "{:?}", case.notes);
            let joint = case.joint_case("s", false);
            assert!(joint.contains("zones = [\"a\", \"b\"]"), "{joint}");
        }
        let level = case("roi = [10, 90, 90, 140]", "roi = [10, 12, 90, 60]").unwrap();
        assert!(level.normal == [0.0, 1.0] && !level.joint_case("s", false).contains("zones"));
    }

    #[test]
    fn polygons_face_each_other_at_any_angle_wherever_their_corners_begin() {
        for (turn, degrees) in [-40.0, 0.0, 27.0, 44.0, 90.0, -90.0].into_iter().enumerate() {
            let [mut below, mut above] = turned(degrees);
            below.rotate_left(turn % 4);
            above.rotate_left((2 * turn + 1) % 4);
            if turn % 2 == 1 {
                above.reverse();
            }
            let case = case(&format!("polygon = {below:?}"), &format!("polygon = {above:?}")).unwrap();
            assert!((case.thickness_mm - 0.06).abs() < 1e-12, "{degrees}: {}", case.thickness_mm);
            let (sin, cos) = degrees.to_radians().sin_cos();
            let wanted = [sin, cos];
            assert!(minus(case.normal, wanted).iter().all(|v| v.abs() < 1e-12), "{degrees}: {:?}", case.normal);
            let [a, b] = &case.correlation.zones[..] else { panic!() };
            for (zone, faces) in [
                (a, [turned(degrees)[0][0], turned(degrees)[0][1]]),
                (b, [turned(degrees)[1][3], turned(degrees)[1][2]]),
            ] {
                assert_eq!(zone.elements, Some(CaseElements::Mapped));
                let Some(CaseGuard::Along { along, width }) = &zone.guard_px else { panic!("{:?}", zone.guard_px) };
                assert_eq!((along.as_slice(), *width), (&zone.polygon.as_ref().unwrap()[..2], 3.0));
                let on_face = |p: &Point| faces.iter().any(|face| minus(*p, *face).iter().all(|v| v.abs() < 1e-9));
                assert!(along.iter().all(on_face), "{degrees}: {along:?} {faces:?}");
            }
        }
    }

    #[test]
    fn faces_of_different_length_end_together_and_guards_stay_with_their_sides() {
        let a = "polygon = [[10, 100], [110, 100], [110, 140], [10, 140]]\nguard_px = [1, 2, 3, 4]";
        let case = case(a, "polygon = [[30, 40], [130, 40], [140, 80], [20, 80]]").unwrap();
        let [a, b] = &case.correlation.zones[..] else { panic!() };
        assert_eq!(a.polygon.as_deref().unwrap(), [[20.0, 100.0], [110.0, 100.0], [110.0, 140.0], [20.0, 140.0]]);
        assert_eq!(a.guard_px, Some(CaseGuard::Sides(vec![1.0, 2.0, 3.0, 4.0])));
        let [c, d, e, f] = b.polygon.as_deref().unwrap() else { panic!() };
        // From (140, 80) to (20, 80), cut at 110, a quarter of that side: a quarter of that behind, from 130 to 30.
        for (found, wanted) in [(c, [110.0, 80.0]), (d, [20.0, 80.0]), (e, [30.0, 40.0]), (f, [105.0, 40.0])] {
            assert!(minus(*found, wanted).iter().all(|v| v.abs() < 1e-9), "{found:?} {wanted:?}");
        }
        assert!(case.notes[0].contains("zone \"a\": its elements end") && case.notes.len() == 3, "{:?}", case.notes);
        // A rectangle beside a polygon, with its guard.
        let mixed = self::case(
            "roi = [10, 100, 90, 140]\nguard_px = { top = 2 }",
            "polygon = [[10, 40], [90, 40], [90, 80], [10, 80]]",
        );
        let zones = mixed.unwrap().correlation.zones;
        assert_eq!((zones[0].roi, &zones[0].guard_px), (None, &Some(CaseGuard::Sides(vec![2.0, 0.0, 0.0, 0.0]))));
    }

    /// A mesh file with a group for each list of rows of nodes: rows from face to back.
    fn msh(groups: &[(&str, Vec<Vec<Point>>)]) -> String {
        let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n{}\n", groups.len());
        let (mut nodes, mut elements) = (Vec::new(), Vec::new());
        for (group, (name, rows)) in (1..).zip(groups) {
            text += &format!("2 {group} \"{name}\"\n");
            let first = nodes.len() + 1;
            nodes.extend(rows.iter().flatten().copied());
            let n = rows[0].len();
            for k in (0..(rows.len() - 1) * n).filter(|k| k % n + 1 < n) {
                let a = first + k;
                elements.push(format!("3 2 {group} {group} {a} {} {} {}", a + 1, a + 1 + n, a + n));
            }
        }
        text += &format!("$EndPhysicalNames\n$Nodes\n{}\n", nodes.len());
        (1..).zip(&nodes).for_each(|(k, [x, y])| text += &format!("{k} {x} {y} 0\n"));
        text += &format!("$EndNodes\n$Elements\n{}\n", elements.len());
        (1..).zip(&elements).for_each(|(k, element)| text += &format!("{k} {element}\n"));
        text + "$EndElements\n"
    }

    /// Rows of nodes at these distances from the middle of a joint on a circle of 300 px.
    fn arc(distances: [f64; 3], n: usize) -> Vec<Vec<Point>> {
        let at = |d: f64, k: usize| {
            let angle = -0.4 + 0.8 * k as f64 / (n - 1) as f64;
            [400.0 + (300.0 + d) * angle.sin(), 500.0 - (300.0 + d) * angle.cos()]
        };
        distances.map(|d| (0..n).map(|k| at(d, k)).collect()).into()
    }

    #[test]
    fn the_facing_borders_of_a_mesh_file_are_found_where_they_are_curved() {
        let folder = tempfile::tempdir().unwrap();
        let strips = [("a", arc([-15.0, -31.0, -47.0], 13)), ("b", arc([15.0, 31.0, 47.0], 13))];
        std::fs::write(folder.path().join("strips.msh"), msh(&strips)).unwrap();
        let one = case_in(folder.path(), "[[zone]]\nmesh = 'strips.msh'\n").unwrap();
        let each = |name, group| format!("[[zone]]\nname = '{name}'\nmesh = 'strips.msh'\ngroup = '{group}'\n");
        let two = case_in(folder.path(), &(each("a", "a") + &each("b", "b"))).unwrap();
        assert_eq!(one.correlation.zones, two.correlation.zones);
        // Along the normal of the chord between two nodes: 30 cos(0.8/24).
        assert!((one.thickness_mm / 0.002 - 30.0 * (0.4f64 / 12.0).cos()).abs() < 1e-9, "{}", one.thickness_mm / 0.002);
        assert!(minus(one.normal, [0.0, 1.0]).iter().all(|v| v.abs() < 1e-9), "{:?}", one.normal);
        for (zone, (_, rows)) in one.correlation.zones.iter().zip(&strips) {
            let Some(CaseGuard::Along { along, width: 3.0 }) = &zone.guard_px else { panic!("{:?}", zone.guard_px) };
            let mut face = along.clone();
            face.sort_by(|a, b| a[0].total_cmp(&b[0]));
            assert_eq!(face, rows[0]);
            assert_eq!((&zone.group, &zone.elements), (&zone.name, &None));
        }
        let refused = |name: &str, groups: &[(&str, Vec<Vec<Point>>)], words: &[&str]| {
            std::fs::write(folder.path().join(name), msh(groups)).unwrap();
            let message = case_in(folder.path(), &format!("[[zone]]\nmesh = '{name}'\n")).unwrap_err();
            words.iter().for_each(|word| assert!(message.contains(word), "'{word}' in: {message}"));
        };
        let [(_, below), (_, above)] = strips;
        refused(
            "finer.msh",
            &[("a", below.clone()), ("b", arc([15.0, 31.0, 47.0], 17))],
            &["opposite each other: that at", "alike"],
        );
        let wedge: Vec<Vec<Point>> =
            above.iter().map(|row| row.iter().map(|[x, y]| [*x, y - 0.03 * (x - 200.0)]).collect()).collect();
        refused("wedge.msh", &[("a", below.clone()), ("b", wedge)], &["not parallel", "px thick"]);
        refused("swapped.msh", &[("b", below.clone()), ("a", above)], &["does not lie below", "swap"]);
        refused("one.msh", &[("a", below)], &["names \"b\"", "has \"a\"", "add a [[zone]]"]);
        let message = case_in(folder.path(), "[[zone]]\nmesh = 'none.msh'\n").unwrap_err();
        assert!(message.contains("none.msh") && message.contains("no such mesh file"), "{message}");
        let roi = "[[zone]]\nname = 'b'\nroi = [0, 0, 90, 40]\n";
        let message = case_in(folder.path(), &(each("a", "a") + roi)).unwrap_err();
        assert!(message.contains("the other has none"), "{message}");
    }

    #[test]
    fn zones_that_make_no_joint_are_refused_with_what_to_do() {
        let box_of = |x: f64, y: f64| {
            format!("polygon = [[{x}, {y}], [{}, {y}], [{}, {}], [{x}, {}]]", x + 80.0, x + 80.0, y + 40.0, y + 40.0)
        };
        // Corner to corner, as rectangles and as polygons.
        refused(
            "roi = [10, 90, 60, 140]",
            "roi = [90, 10, 140, 60]",
            &["\"a\" and \"b\"", "no edges that face", "both sides"],
        );
        refused(&box_of(10.0, 90.0), &box_of(120.0, 10.0), &["no edges that face"]);
        refused("roi = [10, 90, 60, 140]", "roi = [40, 60, 140, 100]", &["overlap", "gap"]);
        refused(&box_of(10.0, 90.0), &box_of(40.0, 60.0), &["overlap", "gap"]);
        refused(&box_of(10.0, 10.0), &box_of(10.0, 90.0), &["does not lie below", "swap", "[\"b\", \"a\"]"]);
        // Over 80 px the gap grows from 30 to 36 px: 4.3 degrees.
        let tilted = "polygon = [[10, 20], [90, 20], [90, 54], [10, 60]]";
        refused(&box_of(10.0, 90.0), tilted, &["4.29 degrees", "30.0", "35.9", "parallel"]);
        refused(&box_of(10.0, 90.0), &box_of(80.0, 20.0), &["10.0 px only"]);
        let five = "polygon = [[10, 90], [90, 90], [95, 110], [90, 130], [10, 130]]";
        refused(five, &box_of(10.0, 20.0), &["zone \"a\"", "5 corners", "mesh = \"strips.msh\""]);
        let dart = "polygon = [[10, 90], [90, 90], [30, 100], [10, 130]]";
        refused(dart, &box_of(10.0, 20.0), &["zone \"a\"", "inwards"]);
        let drawn = "roi = [0, 0, 4, 2]\nin_mm = { origin_px = [10, 90] }";
        refused(drawn, &box_of(10.0, 20.0), &["zone \"a\"", "given in px", "in_mm"]);
        refused("mask = 'm.png'", &box_of(10.0, 20.0), &["zone \"a\"", "four corners", "no mask"]);
    }
}
