//! Everything that reads files of others, each as a function of bytes that must not panic, abort or ask for memory
//! without bounds. `fuzz/` calls them guided by coverage, `tests/commands/fuzz.rs` with seeds that are changed at
//! random.

use quadrille::field::{Measurement, Status, StrainDefinition, StrainField};
use quadrille::io::case::{CaseDocument, parse_case, write_case};
use quadrille::io::csv::read_displacements;
use quadrille::io::foreign::{FieldOptions, LengthUnit, YAxis, parse_points, read_node_table};
use quadrille::io::images::{Accepted, PagedFile};
use quadrille::io::joint::{
    MeshInput, parse_boundary, parse_identify, parse_joint_mesh, parse_measurement, parse_table,
};
use quadrille::io::load::{FrameTimes, parse_frame_times, parse_load, parse_record};
use quadrille::io::mask::parse_mask;
use quadrille::io::mesh_file::{parse_mesh, read_model};
use quadrille::io::npz::read_npz;
use quadrille::io::opencv::parse_opencv;
use quadrille::io::store::{Store, StoreHeader, StoreWriter};
use quadrille::mechanics::{Joint, JointMesh, JointParts};
use quadrille::mesh::{Mesh, Roi, Zone, elements_of_points};
use quadrille::units::{PixelSize, Px};
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A reader as a function of bytes.
pub type Reader = fn(&[u8]);

/// The readers by the names of their folders of seeds.
pub const ALL: [(&str, Reader); 9] = [
    ("images", images),
    ("masks", masks),
    ("meshes", meshes),
    ("fields", fields),
    ("cases", cases),
    ("joints", joints),
    ("tables", tables),
    ("store", store),
    ("state", state),
];

/// A folder of this thread: what takes a path finds its file there. In `TMPDIR`, best in memory.
fn in_folder<T>(of: impl FnOnce(&Path) -> T) -> T {
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a temporary folder");
    }
    FOLDER.with(|folder| of(folder.path()))
}

/// Images of every format, all pages; films, and the description of one.
pub fn images(data: &[u8]) {
    let _ = PagedFile::of("image.cih".into(), data.to_vec());
    let Ok(mut file) = PagedFile::of("image".into(), data.to_vec()) else { return };
    let accepted = Accepted { max_mpx: 4, size: None };
    for page in file.images().unwrap_or_default().into_iter().chain([0]).take(4) {
        if let Ok(loaded) = file.read(page, accepted) {
            let pixels = loaded.image.width() * loaded.image.height();
            assert!(pixels > 0 && pixels <= 4_000_000);
            assert!(loaded.image.grey(loaded.image.width() - 1, loaded.image.height() - 1).is_finite());
        }
    }
}

/// Images as masks of a reference of 16 x 16 px.
pub fn masks(data: &[u8]) {
    if let Ok(loaded) = parse_mask(data.to_vec(), "mask".as_ref(), 16, 16) {
        assert!(loaded.share > 0.0 && loaded.share <= 1.0);
    }
}

/// Mesh files (Gmsh with groups, VTU, JSON of a joint), laid over an image and made a joint of.
pub fn meshes(data: &[u8]) {
    if let Ok(file) = parse_joint_mesh(data, "mesh".as_ref())
        && file.elements.len() < 500
        && file.nodes.len() < 2000
    {
        let listed = file.faces.iter().chain(file.prescribed.iter().flatten()).chain(file.selected.iter().flatten());
        assert!(listed.chain(file.node_groups.values().flatten()).all(|&node| (node as usize) < file.nodes.len()));
        let parts = JointParts {
            nodes: file.nodes,
            elements: file.elements,
            interfaces: file.interfaces.unwrap_or_default(),
            faces: file.faces,
            groups: file.groups,
            element_group: file.element_group,
            ..JointParts::default()
        };
        let _ = JointMesh::new(parts.clone());
        let _ = JointMesh::from_strips(parts);
    }
    let Ok(file) = parse_mesh(data, "mesh".as_ref()) else { return };
    if file.zones.iter().map(|zone| zone.elements.len()).sum::<usize>() > 500 {
        return;
    }
    let zones: Vec<Zone> = file
        .zones
        .into_iter()
        .map(|elements| Zone { name: elements.name.clone(), elements: Some(elements.into()), ..Zone::default() })
        .collect();
    if let Ok(mesh) = Mesh::on_zones(&zones, 16, 64, 64) {
        assert!(mesh.nodes().iter().flatten().all(|v| v.is_finite()));
        for zone in 0..zones.len() {
            let _ = mesh.locate(zone, 20.0, 20.0);
        }
    }
}

/// Fields of other programs, models and their displacements; a mesh is made of the points.
pub fn fields(data: &[u8]) {
    let scale = PixelSize::new(0.05);
    let options =
        FieldOptions { unit: Some(LengthUnit::Px), y: Some(YAxis::Up), pixel_size: scale, ..FieldOptions::default() };
    for frame in parse_points(data, "field".as_ref(), &options).unwrap_or_default().into_iter().take(4) {
        let points: Vec<[f64; 2]> = frame.points.iter().take(2000).map(|point| point.position).collect();
        if let Some((zones, places)) = elements_of_points(&points) {
            assert_eq!(zones.iter().map(|zone| zone.nodes.len()).sum::<usize>(), places.len());
            let _ = Mesh::<Px>::from_zones(zones);
        }
    }
    in_folder(|folder| {
        let file = folder.join("model");
        fs::write(&file, data).expect("a file");
        let _ = read_model(&file, None, LengthUnit::M);
        let _ = read_node_table(&file);
    });
}

/// Case files of every command.
pub fn cases(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = parse_opencv(text);
    let path = Path::new("case.toml");
    // Read once for all: `parse_case` and `parse_run_case` do no more than this.
    let Ok(document) = CaseDocument::parse(text, path) else { return };
    if let Ok(case) = document.clone().correlation() {
        // What is accepted can be written down and read again.
        let written = write_case(&case);
        let again = parse_case(&written, path).unwrap_or_else(|error| panic!("{error}\n{written}"));
        assert_eq!(again.zones.len(), case.zones.len());
    }
    if let Ok(case) = document.clone().run() {
        assert!(case.thickness_mm.is_finite());
        CaseDocument::parse(&case.joint_case("run", true), path).unwrap_or_else(|error| panic!("{error}"));
    }
    if let Some(camera) = &document.case.camera {
        let _ = camera.camera([64, 48]);
    }
    let _ = document.joint();
}

/// The files beside the case of [`joints`].
const BESIDE: [(&str, &str); 5] = [
    (
        "mesh.json",
        r#"{"nodes":[[0,0],[1,0],[1,1],[0,1],[0,1.1],[1,1.1],[1,2],[0,2]],"quads":[[0,1,2,3],[4,5,6,7]],"groups":["lower","upper"],"quad_group":[0,1],"node_groups":{"grip":[6,7]}}"#,
    ),
    ("border.csv", "instant,node,x_mm,y_mm,ux_mm,uy_mm\n1,0,0,0,0,0\n1,1,1,0,0,0\n1,6,1,2,0,0.001\n1,7,0,2,0,0.001\n"),
    ("force.csv", "time_s,load_N\n0,0\n1,10\n2,20\n"),
    ("curve.csv", "strain,stress_MPa\n0.001,70\n0.01,120\n"),
    ("measured.csv", "instant,node,ux_mm,uy_mm\n1,2,0,0\n1,3,0,0\n1,4,0,0.001\n1,5,0,0.001\n"),
];

/// A joint of a case, with every file that it names: supports, loads, groups, materials with curves, a load cell.
pub fn joints(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    // What one may write into one's own case is not what is attacked: other folders, and models as large as one likes.
    if text.contains(['/', '\\']) || text.contains("store") || text.contains("file = \".") {
        return;
    }
    let read = in_folder(|folder| {
        let folder = folder.join("joint");
        if !folder.exists() {
            fs::create_dir(&folder).expect("a temporary folder");
            for (name, text) in BESIDE {
                fs::write(folder.join(name), text).expect("a temporary file");
            }
        }
        parse_identify(text, &folder.join("case.toml"))
    });
    let Ok(quadrille::io::joint::IdentifyInput::One(input)) = read else { return };
    let small = match &input.mesh {
        MeshInput::Rectangle { columns, rows, .. } => columns.saturating_mul(*rows) < 50,
        _ => true,
    };
    if small && input.case.mesh.refine.unwrap_or(1) <= 3 && input.drives.n_instants() < 1000 {
        let _ = Joint::new(&input);
    }
}

/// Load files and records of machines, times of frames, tables of displacements, tables and borders of a joint, arrays.
pub fn tables(data: &[u8]) {
    let Some((&kind, data)) = data.split_first() else { return };
    let path = Path::new("table.csv");
    match kind % 9 {
        0 => drop(parse_load(&String::from_utf8_lossy(data), path, 5)),
        1 => drop(parse_record(&String::from_utf8_lossy(data), path, "time", &FrameTimes::every(0.5, 0.0, 5))),
        2 => drop(read_displacements(data)),
        3 => drop(read_npz(Cursor::new(data))),
        4 => drop(parse_table(data, path)),
        5 => drop(parse_boundary(data, path)),
        6 => drop(parse_measurement(data, path, Some(0.002))),
        7 => drop(parse_measurement(data, path, None)),
        _ => drop(parse_frame_times(&String::from_utf8_lossy(data), path, 3)),
    }
}

/// Two elements.
fn small_mesh() -> Arc<Mesh<Px>> {
    let roi = Roi { x0: 16.0, y0: 16.0, x1: 48.0, y1: 32.0 };
    Arc::new(Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 64, 64).expect("a mesh"))
}

/// The store of a run of two frames, in `path`; gives its files, in the order of their names.
pub fn whole_store(path: &Path) -> Vec<PathBuf> {
    let mesh = small_mesh();
    let header = StoreHeader {
        quadrille: "0.1.0".into(),
        device: "cpu".into(),
        mesh: mesh.clone(),
        image_size_px: [64, 64],
        reference: vec!["ref.tif".into()],
        reference_sha256: vec![String::new()],
        frames: vec!["a.tif".into(), "b.tif".into()],
        pixel_size: None,
        range_grey: 255.0,
        element_size_px: 16.0,
        strain: StrainDefinition::default(),
        strain_window: None,
        case: String::new(),
    };
    let (n, elements) = (mesh.n_nodes(), mesh.n_elements());
    let field = Measurement {
        mesh,
        status: Status::Converged,
        displacement: vec![[0.1, -2.0]; n],
        sigma: vec![[0.01; 2]; n],
        measured: vec![true; n],
        element_residual: vec![1.5; elements],
        model_error: None,
        marks: None,
        points: None,
    };
    let writer = StoreWriter::create(path, &header).expect("a store");
    for number in [1, 2] {
        writer.write(number, &field, &StrainField::of(&field, header.strain)).expect("a frame");
    }
    let (mut folders, mut files) = (vec![path.to_owned()], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder").flatten() {
            if entry.path().is_dir() { folders.push(entry.path()) } else { files.push(entry.path()) }
        }
    }
    files.sort();
    files
}

/// A whole store, and what is in it.
struct Whole {
    store: Store,
    /// The files, what they hold, and the frame that they are of.
    files: Vec<(PathBuf, Vec<u8>, Option<usize>)>,
}

impl Whole {
    fn in_folder(folder: &Path) -> Self {
        let path = folder.join("fields.zarr");
        let files = whole_store(&path);
        let store = Store::open(path).expect("a store");
        let is_of = |number: usize, file: &PathBuf| {
            store.status_file(number) == *file || store.field_files(number).contains(file)
        };
        let about = |file: PathBuf| {
            let frame = (1..=store.n_frames()).find(|&number| is_of(number, &file));
            let content = fs::read(&file).expect("a file of the store");
            (file, content, frame)
        };
        Self { files: files.into_iter().map(about).collect(), store }
    }
}

/// A store of which one file is another: the first byte says which, the second whether the rest is its content or pairs
/// of a place and a byte that is put there.
pub fn store(data: &[u8]) {
    let [which, kind, rest @ ..] = data else { return };
    thread_local! {
        static WHOLE: Whole = in_folder(Whole::in_folder);
    }
    let read = |store: &Store, number| {
        let _ = (store.check(number), store.noise(number), store.without_field(number));
    };
    WHOLE.with(|whole| {
        let (file, content, frame) = &whole.files[usize::from(*which) % whole.files.len()];
        let changed = if kind % 2 == 0 {
            rest.to_vec()
        } else {
            let mut changed = content.clone();
            for edit in rest.chunks_exact(3) {
                let n = changed.len().max(1);
                let at = (usize::from(edit[0]) * 256 + usize::from(edit[1])) % n;
                if let Some(byte) = changed.get_mut(at) {
                    *byte = edit[2];
                }
            }
            changed
        };
        fs::write(file, changed).expect("a file of the store");
        match frame {
            // Nobody has looked into the files of a frame when the store is open.
            Some(number) => read(&whole.store, *number),
            None => {
                if let Ok(store) = Store::open(whole.store.path()) {
                    let _ = (store.normal_matrices(), store.gradient_noise(), store.penalty());
                    (1..=store.n_frames().min(3)).for_each(|number| read(&store, number));
                }
            }
        }
        fs::write(file, content).expect("a file of the store");
    });
}

/// What a restart reads: the state of a chain of references, the record of a frame.
pub fn state(data: &[u8]) {
    thread_local! {
        static MESH: Arc<Mesh<Px>> = small_mesh();
    }
    let _ = MESH.with(|mesh| quadrille::run::is_of_a_restart(data, mesh));
}
