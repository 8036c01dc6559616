//! A joint that is turned in the image is the same joint: `quadrille run` finds its law wherever it lies.

use quadrille::imaging::Image;
use quadrille::io::images::write_image;
use quadrille::mechanics::cohesive::ExtendedXuNeedleman;
use quadrille::mechanics::substrate::{LinearElastic, PlaneState, SubstrateLaw};
use quadrille::mechanics::{BoundaryHistory, ForwardOptions, JointMesh, JointParts, Model, ModelOptions};
use quadrille::report::fit::FitRecord;
use quadrille::run::{CaseRun, Event, Stop, identify, run_case};
use quadrille::synth::{GridField, Motion, RenderOptions, Strips, Texture, render};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Elements along the joint and rows of them in each strip; side of an element, distance of the faces, px.
const COLUMNS: usize = 16;
const ROWS: usize = 5;
const STEP: f64 = 16.0;
const GAP: f64 = 24.0;
const PIXEL_MM: f64 = 0.004;
const INSTANTS: usize = 5;
const SIZE: [usize; 2] = [360, 344];
const CENTRE: [f64; 2] = [180.0, 172.0];
const TRUTH: [(&str, f64); 3] = [("phi_n", 1.0), ("delta_n", 0.005), ("delta_t", 0.02)];

/// Left end of the strips, and the rows where the upper strip begins and ends and the lower one begins and ends; px
/// about the centre.
const LEFT: f64 = -0.5 * STEP * COLUMNS as f64;
const EDGES: [f64; 4] = [-0.5 * GAP - STEP * ROWS as f64, -0.5 * GAP, 0.5 * GAP, 0.5 * GAP + STEP * ROWS as f64];

/// A motion, turned about the centre of the image; a positive angle turns x towards y (down).
struct Turned {
    inner: Strips,
    turn: Turn,
}

#[derive(Clone, Copy)]
struct Turn([f64; 2]);

impl Turn {
    fn new(degrees: f64) -> Self {
        // A quarter of a turn takes whole pixels to whole pixels.
        let cos = if degrees == 90.0 { 0.0 } else { degrees.to_radians().cos() };
        Self([cos, degrees.to_radians().sin()])
    }

    fn out(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [cos, sin] = self.0;
        [cos * x - sin * y, sin * x + cos * y]
    }

    fn back(self, v: [f64; 2]) -> [f64; 2] {
        Self([self.0[0], -self.0[1]]).out(v)
    }

    /// From a place about the centre to one in the image.
    fn place(self, x: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.out(x);
        [CENTRE[0] + x, CENTRE[1] + y]
    }

    fn local(self, [x, y]: [f64; 2]) -> [f64; 2] {
        self.back([x - CENTRE[0], y - CENTRE[1]])
    }
}

impl Motion for Turned {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        self.turn.out(self.inner.displacement(self.turn.local(x)))
    }

    fn at(&self, fraction: f64) -> Self {
        Self { inner: self.inner.at(fraction), turn: self.turn }
    }

    fn n_bodies(&self) -> usize {
        self.inner.n_bodies()
    }

    fn is_smooth(&self) -> bool {
        self.inner.is_smooth()
    }

    fn body_holds(&self, body: usize, x: [f64; 2]) -> bool {
        self.inner.body_holds(body, self.turn.local(x))
    }

    fn body_displacement(&self, body: usize, x: [f64; 2]) -> [f64; 2] {
        self.turn.out(self.inner.body_displacement(body, self.turn.local(x)))
    }

    fn body_gradient(&self, body: usize, x: [f64; 2]) -> [[f64; 2]; 2] {
        // R G R^T.
        let g = self.inner.body_gradient(body, self.turn.local(x));
        let columns = [0, 1].map(|c| self.turn.out([g[0][c], g[1][c]]));
        [0, 1].map(|r| self.turn.out([columns[0][r], columns[1][r]]))
    }
}

/// The displacements (px, y down) of the nodes of the upper and of the lower strip, row by row from the top, at every
/// instant.
fn solved() -> &'static Vec<[Vec<[f64; 2]>; 2]> {
    static SOLVED: OnceLock<Vec<[Vec<[f64; 2]>; 2]>> = OnceLock::new();
    SOLVED.get_or_init(|| {
        let mesh = JointMesh::rectangular(COLUMNS, ROWS, STEP * PIXEL_MM, GAP * PIXEL_MM).unwrap();
        let nodes = mesh.outer_nodes();
        let length = STEP * COLUMNS as f64 * PIXEL_MM;
        // Opens towards the right, up to four times delta_n, and slides.
        let of = |k: usize, node: u32| {
            let [x, y] = mesh.nodes()[node as usize];
            let (side, t) = (y.signum(), k as f64 / INSTANTS as f64);
            [side * 0.006 * t, side * t * (0.0005 + 0.0095 * x / length)]
        };
        let instants = (1..=INSTANTS).map(|k| nodes.iter().map(|&node| of(k, node)).collect()).collect();
        let boundary = BoundaryHistory::new(nodes, instants).unwrap();
        let model = Model::new(mesh, substrate(), boundary.nodes(), ModelOptions::default()).unwrap();
        let solution = model.forward(&law(), &boundary, &ForwardOptions::default()).unwrap();
        let per_row = COLUMNS + 1;
        let per_strip = per_row * (ROWS + 1);
        let strip = |u: &[[f64; 2]], first: usize| -> Vec<[f64; 2]> {
            let rows = (0..=ROWS).rev().flat_map(|row| (0..per_row).map(move |column| first + row * per_row + column));
            rows.map(|node| [u[node][0] / PIXEL_MM, -u[node][1] / PIXEL_MM]).collect()
        };
        let both = |u: &Vec<[f64; 2]>| [strip(u, per_strip), strip(u, 0)];
        solution
            .instants
            .iter()
            .map(|instant| {
                assert!(instant.status.converged());
                both(&instant.displacement)
            })
            .collect()
    })
}

fn law() -> ExtendedXuNeedleman {
    ExtendedXuNeedleman::new(TRUTH[0].1, TRUTH[1].1, TRUTH[2].1, 4.0).unwrap()
}

fn substrate() -> Vec<Arc<dyn SubstrateLaw>> {
    let law: Arc<dyn SubstrateLaw> = Arc::new(LinearElastic::new(8000.0, 0.35, PlaneState::PlaneStress).unwrap());
    vec![Arc::clone(&law), law]
}

/// Writes the reference and the frames of the joint turned by `turn`.
fn photograph(folder: &Path, turn: Turn) {
    let texture = Texture::new(5, 4.5).unwrap();
    let still = [0, 1].map(|_| vec![[0.0; 2]; (COLUMNS + 1) * (ROWS + 1)]);
    let images = folder.join("images");
    std::fs::create_dir_all(&images).unwrap();
    for (k, [upper, lower]) in std::iter::once(&still).chain(solved()).enumerate() {
        let grid = |top: f64, u: &[[f64; 2]]| GridField::new([LEFT, top], STEP, [COLUMNS, ROWS], u.to_vec()).unwrap();
        let motion = Turned { inner: Strips::new(grid(EDGES[0], upper), grid(EDGES[2], lower)), turn };
        let options = RenderOptions { noise: 1.0, seed: 3, frame: k as u64, ..RenderOptions::new(SIZE[0], SIZE[1]) };
        let image: Image = render(&texture, &motion, &options).unwrap();
        write_image(&images.join(format!("{k:06}.png")), &image).unwrap();
    }
}

/// The corners of the upper and the lower strip in the image.
fn corners(turn: Turn) -> [[[f64; 2]; 4]; 2] {
    [0, 2].map(|k| {
        let (x, y) = ([LEFT, -LEFT], [EDGES[k], EDGES[k + 1]]);
        [[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]].map(|at| turn.place(at))
    })
}

/// A mesh file of both strips with the groups `upper` and `lower`.
fn mesh_file(turn: Turn) -> String {
    let per_row = COLUMNS + 1;
    let n = per_row * (ROWS + 1);
    let mut text =
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 1 \"upper\"\n2 2 \"lower\"\n$EndPhysicalNames\n"
            .to_owned();
    write!(text, "$Nodes\n{}\n", 2 * n).unwrap();
    for (strip, top) in [EDGES[0], EDGES[2]].into_iter().enumerate() {
        for k in 0..n {
            let at = [LEFT + STEP * (k % per_row) as f64, top + STEP * (k / per_row) as f64];
            let [x, y] = turn.place(at);
            writeln!(text, "{} {x} {y} 0", strip * n + k + 1).unwrap();
        }
    }
    write!(text, "$EndNodes\n$Elements\n{}\n", 2 * COLUMNS * ROWS).unwrap();
    for k in 0..2 * COLUMNS * ROWS {
        let (strip, cell) = (k / (COLUMNS * ROWS), k % (COLUMNS * ROWS));
        let a = strip * n + cell / COLUMNS * per_row + cell % COLUMNS + 1;
        let group = strip + 1;
        writeln!(text, "{} 3 2 {group} {group} {a} {} {} {}", k + 1, a + 1, a + 1 + per_row, a + per_row).unwrap();
    }
    text + "$EndElements\n"
}

/// The case with these zones; the interface names `first` and `second`.
fn case(zones: &str, [first, second]: [&str; 2]) -> String {
    format!(
        "[images]\nreference = 'images/000000.png'\ndeformed = 'images/*.png'\npixel_size_mm = {PIXEL_MM}\n\
         [correlation]\nelement_size_px = {STEP}\n{zones}\
         [interface]\nzones = ['{first}', '{second}']\nguard_px = 3\n\
         [substrate]\nmodel = 'linear-elastic'\nplane = 'stress'\nE_MPa = 8000.0\nnu = 0.35\nexact = true\n\
         [cohesive]\nmodel = 'extended-xu-needleman'\nphi_n_N_per_mm = 1.3\ndelta_n_mm = 0.004\ndelta_t_mm = 0.03\nr = 4.0\nexact = true\n\
         [output]\nfigures = []\n\
         [measurement]\nnodes = 'free'\nweights = 'covariance'\nboundary = 'measured'\n\
         [fit]\nparameters = ['phi_n', 'delta_n', 'delta_t']\nexact = ['thickness', 'faces', 'pixel_size']\ndiscretisation = 'off'\n"
    )
}

/// Value and standard uncertainty of each parameter, and what was noted.
type Found = (BTreeMap<String, [f64; 2]>, Vec<String>);

fn values(fit: &FitRecord) -> BTreeMap<String, [f64; 2]> {
    assert_eq!(fit.status, "converged", "{}", fit.reason);
    fit.parameters.iter().map(|(name, p)| (name.to_string(), [p.value, p.std.expect("an uncertainty")])).collect()
}

/// Runs `case`, whose images are beside it.
#[track_caller]
fn run(folder: &Path, name: &str, case: &str) -> Found {
    let file = folder.join(format!("{name}.toml"));
    std::fs::write(&file, case).unwrap();
    let (mut found, mut notes) = (BTreeMap::new(), Vec::new());
    let mut watcher = |event: Event<'_>| match event {
        Event::Identified { fit, .. } => found = values(fit),
        Event::Remark(remark) => notes.push(remark.text.clone()),
        _ => {}
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    run_case(&CaseRun::new(&file, folder.join(name)), &pool, &mut watcher).unwrap();
    assert_eq!(found.len(), 3);
    (found, notes)
}

fn zone(name: &str, region: &str) -> String {
    format!("[[zone]]\nname = '{name}'\n{region}\n")
}

#[track_caller]
fn assert_true(found: &BTreeMap<String, [f64; 2]>, what: &str) {
    for (name, truth) in TRUTH {
        let [value, std] = found[name];
        // One draw of the noise: three standard uncertainties, which have to be worth something.
        assert!((value - truth).abs() < 3.0 * std, "{what}, {name}: {value} +- {std}, truth {truth}");
        assert!(std < 0.05 * truth, "{what}, {name}: {std}");
    }
}

/// Whether both are the same but for round-off and what ends a fit: steps of 1e-9 of the scale of a parameter.
#[track_caller]
fn assert_same(a: &BTreeMap<String, [f64; 2]>, b: &BTreeMap<String, [f64; 2]>, what: &str) {
    for (name, [value, std]) in a {
        assert!((value - b[name][0]).abs() < 1e-3 * std, "{what}, {name}: {value} and {}", b[name][0]);
    }
}

fn box_of(corners: [[f64; 2]; 4]) -> String {
    let least = |k: usize| corners.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
    let most = |k: usize| corners.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
    format!("roi = [{:?}, {:?}, {:?}, {:?}]", least(0), least(1), most(0), most(1))
}

/// All curves of opening and sliding in the report of a run: place along the joint, mm, jump, um, and half the width of
/// its band: two standard uncertainties, zero of what is computed.
fn jumps(run: &Path) -> [Vec<[f64; 3]>; 2] {
    let html = std::fs::read_to_string(run.join("report.html")).unwrap();
    ["Opening along the joint", "Sliding along the joint"].map(|title| {
        let figure = html.split("<figure data-title=\"").find(|rest| rest.starts_with(title)).expect(title);
        let data = figure.split("data-series=\"").nth(1).unwrap().split('"').next().unwrap();
        let series: serde_json::Value =
            serde_json::from_str(&data.replace("&quot;", "\"").replace("&amp;", "&")).unwrap();
        let list = |one: &serde_json::Value, key: &str| -> Vec<f64> {
            one[key].as_array().into_iter().flatten().map(|v| v.as_f64().unwrap()).collect()
        };
        let of = |one: &serde_json::Value| -> Vec<[f64; 3]> {
            let (x, y, high) = (list(one, "x"), list(one, "y"), list(one, "high"));
            (0..x.len()).map(|k| [x[k], y[k], high.get(k).map_or(0.0, |high| high - y[k])]).collect()
        };
        series.as_array().unwrap().iter().flat_map(of).collect()
    })
}

#[test]
fn the_law_of_a_joint_is_found_however_the_joint_is_turned_and_its_zones_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    // As it was: one below the other.
    let (level, folder_of) = (Turn::new(0.0), |name: &str| folder.path().join(name));
    photograph(&folder_of("level"), level);
    let [upper, lower] = corners(level).map(box_of);
    let zones = zone("lower", &lower) + &zone("upper", &upper);
    let (unturned, notes) = run(&folder_of("level"), "run", &case(&zones, ["lower", "upper"]));
    assert_true(&unturned, "level");
    assert!(!notes.iter().any(|note| note.contains("normal")), "{notes:?}");

    // Side by side.
    let upright = Turn::new(90.0);
    photograph(&folder_of("upright"), upright);
    let [right, left] = corners(upright).map(box_of);
    let zones = zone("one", &left) + &zone("other", &right);
    let (found, notes) = run(&folder_of("upright"), "run", &case(&zones, ["one", "other"]));
    assert_true(&found, "upright");
    assert!(notes[0].contains("right edge of zone \"one\"") && notes[0].contains("0.0 degrees"), "{notes:?}");
    // The normal the other way round: the same law.
    let text = std::fs::read_to_string(folder_of("upright").join("run/identify.toml")).unwrap();
    assert!(text.contains("zones = [\"one\", \"other\"]"), "{text}");
    let swapped = folder_of("upright").join("run/swapped.toml");
    std::fs::write(&swapped, text.replace("[\"one\", \"other\"]", "[\"other\", \"one\"]")).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let input = quadrille::io::joint::read_joint(&swapped).unwrap();
    let out = folder_of("upright").join("swapped");
    let (fit, _) = identify(&input, &swapped, &out, false, &pool, &Stop::default(), &mut |_| ()).unwrap();
    assert_same(&found, &values(&fit), "swapped");

    // Tilted, as polygons: their corners in any order around.
    let tilted = Turn::new(27.0);
    photograph(&folder_of("tilted"), tilted);
    let [mut upper, lower] = corners(tilted);
    upper.rotate_left(3);
    upper.reverse();
    let zones = zone("lower", &format!("polygon = {lower:?}")) + &zone("upper", &format!("polygon = {upper:?}"));
    let (polygons, notes) = run(&folder_of("tilted"), "polygons", &case(&zones, ["lower", "upper"]));
    assert_true(&polygons, "tilted");
    // On the screen the joint is turned clockwise, its normal from upwards to the right.
    assert!(notes[0].contains("63.0 degrees"), "{notes:?}");
    let report = std::fs::read_to_string(folder_of("tilted").join("polygons/report.html")).unwrap();
    assert!(report.contains("squares of 16 px"), "elements along the sides of rectangles, however tilted");

    // The same as groups of a mesh file, with the same nodes.
    std::fs::write(folder_of("tilted").join("strips.msh"), mesh_file(tilted)).unwrap();
    let groups = case("[[zone]]\nmesh = 'strips.msh'\n", ["lower", "upper"]);
    let (meshed, notes) = run(&folder_of("tilted"), "groups", &groups);
    assert!(notes[0].contains("17 nodes") && notes[0].contains("63.0 degrees"), "{notes:?}");
    assert_same(&polygons, &meshed, "mesh file");

    // Jumps across the joint and places along it are the same, measured and computed, but for noise: four standard
    // uncertainties of the difference of two, where computed jumps have at most those of the measured ends of the
    // joint, which are prescribed.
    let level = jumps(&folder_of("level").join("run"));
    let largest = level.iter().flatten().fold(0.0, |most: f64, jump| most.max(jump[2]));
    assert!(level[0].len() == 2 * 3 * 17 && level[0].iter().any(|jump| jump[1] > 15.0), "{:?}", level[0]);
    assert!(largest > 0.0 && largest < 0.7, "{largest} um, of openings of up to 20 um");
    for run in ["upright/run", "tilted/polygons", "tilted/groups"] {
        for (found, wanted) in jumps(&folder_of(run)).iter().flatten().zip(level.iter().flatten()) {
            let band = if found[2] > 0.0 { found[2].hypot(wanted[2]) } else { 2f64.sqrt() * largest };
            let off = [found[0] - wanted[0], found[1] - wanted[1]].map(f64::abs);
            assert!(off[0] < 1e-9 && off[1] < 2.0 * band, "{run}: {found:?} {wanted:?}");
        }
    }

    // Other pixels and other noise: as far apart as both uncertainties allow.
    for (what, found) in [("upright", &found), ("tilted", &polygons)] {
        for (name, [value, std]) in found {
            let [other, other_std] = unturned[name];
            assert!((value - other).abs() < 3.0 * std.hypot(other_std), "{what}, {name}: {value} and {other}");
            // The texture is the same, turned zones lie on other parts of it.
            assert!((std / other_std - 1.0).abs() < 0.2, "{what}, {name}: {std} and {other_std}");
        }
    }
}

#[test]
fn a_turned_joint_has_the_turned_solution_and_its_results_follow_it_from_end_to_end() {
    let mesh = JointMesh::rectangular(COLUMNS, ROWS, STEP * PIXEL_MM, GAP * PIXEL_MM).unwrap();
    let length = STEP * COLUMNS as f64 * PIXEL_MM;
    let nodes = mesh.outer_nodes();
    let of = |node: u32| {
        let [x, y] = mesh.nodes()[node as usize];
        [y.signum() * 0.004, y.signum() * (0.0005 + 0.0065 * x / length)]
    };
    // Positions and displacements turned, y up; strips paired by geometry.
    let solved = |degrees: f64, lower: Option<u32>| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let out = move |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
        let parts = JointParts {
            nodes: mesh.nodes().iter().map(|&x| out(x)).collect(),
            elements: mesh.elements().to_vec(),
            groups: mesh.groups().to_vec(),
            element_group: mesh.element_group().to_vec(),
            lower,
            ..JointParts::default()
        };
        let turned = JointMesh::from_strips(parts).unwrap();
        let field = nodes.iter().map(|&node| out(of(node))).collect();
        let boundary = BoundaryHistory::new(nodes.clone(), vec![field]).unwrap();
        let model = Model::new(turned, substrate(), boundary.nodes(), ModelOptions::default()).unwrap();
        let mut solution = model.forward(&law(), &boundary, &ForwardOptions::default()).unwrap();
        assert!(solution.instants[0].status.converged(), "{degrees}");
        let u = solution.instants.swap_remove(0).displacement;
        let back = u.iter().map(|[x, y]| [cos * x + sin * y, cos * y - sin * x]).collect::<Vec<_>>();
        let (jumps, normals, places) = (model.jumps(&u), model.pair_normals(), model.pair_positions());
        (back, jumps, normals, places, model.crack_front(&law(), &u), out)
    };
    let (wanted, jumps, ..) = solved(0.0, None);
    for degrees in [27.0, 63.0, 90.0, 117.0, 180.0, 270.0, 341.0] {
        for lower in [0u32, 1] {
            let (found, turned_jumps, normals, places, _, out) = solved(degrees, Some(lower));
            // Displacements of 0.01 mm; Newton ends at 1e-10 of them or at round-off.
            let off = wanted
                .iter()
                .flatten()
                .zip(found.iter().flatten())
                .fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
            assert!(off < 1e-11, "{degrees}, {lower}: {off:e}");
            let side = if lower == 0 { 1.0 } else { -1.0 };
            let up = out([0.0, side]);
            for (k, normal) in normals.iter().enumerate() {
                assert!((normal[0] - up[0]).hypot(normal[1] - up[1]) < 1e-12, "{degrees}, {lower}: {normal:?}");
                // Along the tangent, which has the normal to its left: from the other end when the normal is turned
                // round.
                let of_level = if lower == 0 { k } else { jumps.len() - 1 - k };
                let along = places[k].1 - STEP * PIXEL_MM * k as f64;
                assert!(along.abs() < 1e-12, "{degrees}, {lower}, pair {k}: {along:e}");
                let (a, b) = (turned_jumps[k], jumps[of_level]);
                assert!(
                    (a.normal - b.normal).abs() < 1e-11 && (a.tangential - b.tangential).abs() < 1e-11,
                    "{degrees}"
                );
            }
        }
    }
    // Nothing said: the lower of two strips is the one further down, of two side by side that to the left.
    for (degrees, side) in [(27.0, 1.0), (-63.0, 1.0), (90.0, -1.0), (-90.0, 1.0), (180.0, -1.0), (200.0, -1.0)] {
        let (_, _, normals, places, _, out) = solved(degrees, None);
        let up = out([0.0, side]);
        assert!((normals[3][0] - up[0]).hypot(normals[3][1] - up[1]) < 1e-12, "{degrees}: {:?}", normals[3]);
        assert!((places[COLUMNS].1 - length).abs() < 1e-12, "{degrees}: {places:?}");
    }
}
