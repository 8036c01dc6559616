//! What is drawn from every field of a series.

use super::{
    CrackLine, CrackValues, Elongation, Extensometer, Facing, Jump, NodalNoise, PointValues, Region, RegionValues,
    RemoveRigid, RigidRemoved, Segment, TensionGauges, Value, at_point, remove_rigid,
};
use crate::field::{Measurement, StrainDefinition, StrainWindow, StrainWindows, TensorStrain};
use crate::mesh::Mesh;
use crate::units::Length;

/// What is read at a point is a sum over the nodes of its element and of so many rings of elements around it, at most:
/// values at points reach three from a node.
const RINGS: usize = 4;

/// The quantities asked for, each with its name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Quantities {
    /// How strains are made.
    pub strain: StrainDefinition,
    /// Window of nodes over which strains are taken as well.
    pub window: Option<StrainWindow>,
    /// Poisson's ratio, with which the strain through the thickness follows from that in the plane (plane stress).
    pub poisson: Option<f64>,
    /// Window over which quantities are smoothed and derived by time, s.
    pub rate_window_s: Option<f64>,
    /// The rigid motion that is taken off each field before anything is drawn from it.
    pub remove_rigid: Option<RemoveRigid>,
    /// Points.
    pub points: Vec<(String, [f64; 2])>,
    /// Lines.
    pub lines: Vec<(String, Segment)>,
    /// Extensometers.
    pub extensometers: Vec<(String, Extensometer)>,
    /// Regions.
    pub regions: Vec<(String, Region)>,
    /// Openings between two zones.
    pub openings: Vec<(String, Facing)>,
    /// Cracks along which the mesh is cut.
    pub cracks: Vec<(String, CrackLine)>,
    /// The tensile test that extensometers and regions are gauges of.
    pub tension: Option<TensionGauges>,
}

/// What [`Quantities`] come to in one field, each in the order of its list.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameQuantities {
    /// The rigid motions taken off.
    pub removed: Vec<RigidRemoved>,
    /// At the points.
    pub points: Vec<Option<PointValues>>,
    /// At the points of each line.
    pub lines: Vec<Vec<Option<PointValues>>>,
    /// Of the extensometers.
    pub extensometers: Vec<Option<Elongation>>,
    /// Of the regions.
    pub regions: Vec<Option<RegionValues>>,
    /// Of the openings.
    pub openings: Vec<OpeningValues>,
    /// Of the cracks.
    pub cracks: Vec<CrackValues>,
}

/// An opening in one field.
#[derive(Debug, Clone, PartialEq)]
pub struct OpeningValues {
    /// At each of its points.
    pub points: Vec<Option<Jump>>,
    /// Their mean.
    pub mean: Option<Jump>,
}

/// One quantity against another, ready to be drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Whose: `point1`, `upper-lower`.
    pub name: String,
    /// What, with its unit where it has one: `ux_px`, `exx`, `opening_px`.
    pub quantity: String,
    /// Against what, with its unit: `load_N`, `frame`, `along_px`.
    pub against: String,
    /// Abscissae.
    pub x: Vec<f64>,
    /// Ordinates.
    pub y: Vec<f64>,
    /// Standard uncertainty of each ordinate.
    pub sigma: Vec<f64>,
}

impl Quantities {
    /// Whether nothing is asked for.
    pub fn is_empty(&self) -> bool {
        self.remove_rigid.is_none()
            && self.points.is_empty()
            && self.lines.is_empty()
            && self.extensometers.is_empty()
            && self.regions.is_empty()
            && self.openings.is_empty()
            && self.cracks.is_empty()
    }

    /// Which nodes of `mesh` they are read from, and perhaps some more; `None` is all of them.
    pub fn nodes<U: Length>(&self, mesh: &Mesh<U>) -> Option<Vec<bool>> {
        let of_all = self.remove_rigid.is_some() || self.window.is_some() || !self.regions.is_empty();
        if of_all || !self.openings.is_empty() || !self.cracks.is_empty() {
            return None;
        }
        let on_lines = self.lines.iter().flat_map(|(_, line)| line.points()).map(|(_, at)| at);
        let of_gauges = self.extensometers.iter().flat_map(|(_, gauge)| gauge.places(mesh));
        let places = self.points.iter().map(|(_, at)| *at).chain(on_lines).chain(of_gauges);
        let mut is_in = vec![false; mesh.n_elements()];
        places.filter_map(|[x, y]| mesh.find(x, y)).for_each(|(element, ..)| is_in[element] = true);
        let nodes_of = |is_in: &[bool]| {
            let mut nodes = vec![false; mesh.n_nodes()];
            let elements = mesh.elements().iter().zip(is_in).filter(|(_, is_in)| **is_in);
            elements.flat_map(|(of, _)| of).for_each(|&node| nodes[node as usize] = true);
            nodes
        };
        for _ in 0..RINGS {
            let nodes = nodes_of(&is_in);
            is_in = mesh.elements().iter().map(|of| of.iter().any(|&node| nodes[node as usize])).collect();
        }
        Some(nodes_of(&is_in))
    }

    /// Draws them from one field; strains over a window where `windows` makes them.
    pub fn draw<U: Length>(
        &self,
        field: &Measurement<U>,
        noise: &NodalNoise,
        windows: Option<&StrainWindows>,
    ) -> FrameQuantities {
        let registered;
        let (field, removed) = match self.remove_rigid {
            Some(which) => {
                let (left, removed) = remove_rigid(field, which);
                registered = left;
                (&registered, removed)
            }
            None => (field, Vec::new()),
        };
        let over_window = windows.map(|windows| windows.of(field, self.strain));
        let at = |point: [f64; 2]| {
            let values = at_point(field, noise, self.strain, point)?;
            Some(match &over_window {
                Some(strains) => values.with_window(&field.mesh, point, strains),
                None => values,
            })
        };
        let opening = |facing: &Facing| OpeningValues {
            points: facing.points().iter().map(|point| point.read(field, noise)).collect(),
            mean: facing.mean(field, noise),
        };
        FrameQuantities {
            removed,
            points: self.points.iter().map(|(_, point)| at(*point)).collect(),
            lines: self.lines.iter().map(|(_, line)| line.points().into_iter().map(|(_, x)| at(x)).collect()).collect(),
            extensometers: self.extensometers.iter().map(|(_, extensometer)| extensometer.read(field, noise)).collect(),
            regions: self.regions.iter().map(|(_, region)| region.read(field, noise, self.strain)).collect(),
            openings: self.openings.iter().map(|(_, facing)| opening(facing)).collect(),
            cracks: self.cracks.iter().map(|(_, crack)| crack.read(field, noise)).collect(),
        }
    }

    /// Profiles of one frame: displacements and strains along each line, opening and sliding along each joint (part by
    /// part) and crack, against the distance along it. Points without a value are left out, empty profiles as well.
    pub fn profiles(&self, drawn: &FrameQuantities) -> Vec<Curve> {
        let mut curves = Vec::new();
        for ((name, line), values) in self.lines.iter().zip(&drawn.lines) {
            let places: Vec<f64> = line.points().into_iter().map(|(s, _)| s).collect();
            for &(quantity, value) in PointValues::quantities(self.window) {
                let along = places.iter().zip(values).map(|(&s, at)| (s, at.as_ref().and_then(value)));
                curves.extend(Curve::new(name, quantity, "along_px", along));
            }
        }
        for ((name, facing), values) in self.openings.iter().zip(&drawn.openings) {
            let n_parts = facing.points().last().map_or(0, |point| point.part + 1);
            for part in 0..n_parts {
                let name = if n_parts == 1 { name.clone() } else { format!("{name}, part {}", part + 1) };
                let points = facing.points().iter().zip(&values.points).filter(|(point, _)| point.part == part);
                curves.extend(jump_curves(&name, points.map(|(point, jump)| (point.along, jump))));
            }
        }
        for ((name, crack), values) in self.cracks.iter().zip(&drawn.cracks) {
            let along = crack.points().iter().map(|point| point.along);
            curves.extend(jump_curves(name, along.zip(&values.points)));
        }
        curves
    }
}

/// Opening and sliding against the distance along a joint or crack.
fn jump_curves<'a>(name: &str, jumps: impl Iterator<Item = (f64, &'a Option<Jump>)> + Clone) -> Vec<Curve> {
    let of = |(quantity, value): Named<Jump, Value>| {
        let points = jumps.clone().map(|(along, jump)| (along, jump.as_ref().map(value)));
        Curve::new(name, quantity, "along_px", points)
    };
    Jump::QUANTITIES.into_iter().filter_map(of).collect()
}

/// A quantity by its name in tables.
pub type Named<T, V> = (&'static str, fn(&T) -> V);

impl PointValues {
    /// Its numbers with their names in tables.
    const QUANTITIES: [Named<Self, Option<Value>>; 8] = [
        ("ux_px", |v| Some(Value { value: v.displacement[0], sigma: v.sigma[0] })),
        ("uy_px", |v| Some(Value { value: v.displacement[1], sigma: v.sigma[1] })),
        ("exx", |v| component(v.strain, 0)),
        ("eyy", |v| component(v.strain, 1)),
        ("exy", |v| component(v.strain, 2)),
        ("exx_window", |v| component(v.window, 0)),
        ("eyy_window", |v| component(v.window, 1)),
        ("exy_window", |v| component(v.window, 2)),
    ];

    /// Its numbers with their names in tables, those over a window where there is one.
    pub fn quantities(window: Option<StrainWindow>) -> &'static [Named<Self, Option<Value>>] {
        &Self::QUANTITIES[..if window.is_some() { 8 } else { 5 }]
    }
}

fn component(strain: Option<(TensorStrain, [f64; 3])>, k: usize) -> Option<Value> {
    strain.map(|(strain, sigma)| Value { value: strain.components()[k], sigma: sigma[k] })
}

impl Jump {
    /// Its numbers with their names in tables.
    pub const QUANTITIES: [Named<Self, Value>; 2] =
        [("opening_px", |jump| jump.opening), ("sliding_px", |jump| jump.sliding)];
}

impl Elongation {
    /// Its numbers with their names in tables.
    pub const QUANTITIES: [Named<Self, Value>; 3] = [
        ("elongation_px", |e| e.elongation),
        ("strain_engineering", |e| e.engineering),
        ("strain_true", |e| e.logarithmic),
    ];
}

impl Curve {
    /// Name and unit of the quantity as they are read: `opening`, `px`; without unit `1`.
    pub fn quantity_in_words(&self) -> (String, String) {
        // What is drawn is in px or has no unit, and may have blanks in its name: `strain_engineering`.
        let (quantity, rate) = self.quantity.strip_suffix("_per_s").map_or((&*self.quantity, ""), |of| (of, " rate"));
        let (name, unit) = quantity.strip_suffix("_px").map_or((quantity, "1"), |name| (name, "px"));
        let unit = if rate.is_empty() { unit.to_owned() } else { format!("{unit}/s") };
        (format!("{}{rate}", name.replace('_', " ")), unit)
    }

    /// Name and unit of what it is against: `load`, `N`; of the frame `1`.
    pub fn against_in_words(&self) -> (String, String) {
        let (name, unit) = self.against.rsplit_once('_').unwrap_or((&self.against, "1"));
        (name.replace('_', " "), unit.to_owned())
    }

    /// Whether it is against what a machine did, a load or a stress: not against frame, time or place.
    pub fn is_against_load(&self) -> bool {
        !["1", "s", "px"].contains(&self.against_in_words().1.as_str())
    }

    /// The curve through the points that have a value; `None` without any.
    pub fn new(
        name: &str,
        quantity: &str,
        against: &str,
        points: impl Iterator<Item = (f64, Option<Value>)>,
    ) -> Option<Self> {
        let (name, quantity, against) = (name.to_owned(), quantity.to_owned(), against.to_owned());
        let mut curve = Self { name, quantity, against, x: Vec::new(), y: Vec::new(), sigma: Vec::new() };
        for (x, value) in points {
            if let Some(Value { value, sigma }) = value {
                curve.x.push(x);
                curve.y.push(value);
                curve.sigma.push(sigma);
            }
        }
        (!curve.x.is_empty()).then_some(curve)
    }
}
