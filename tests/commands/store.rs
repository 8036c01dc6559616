//! The store of record: what is written reads back, here and in Python; what is damaged is refused by name.

#![cfg(feature = "cli")]

use crate::program;
use program::{Desk, INSIDE, moved};
use quadrille::correlate::Regularisation;
use quadrille::field::{
    ElementMark, Measurement, ModelError, PointField, Status, StrainDefinition, StrainField, StrainWindow,
    StrainWindows, TensorStrain,
};
use quadrille::io::arrays::{ArrayFile, ArrayFileError, Number, Shape, Values};
use quadrille::io::mat::MatWriter;
use quadrille::io::npz::NpzWriter;
use quadrille::io::store::{Place, Store, StoreError, StoreHeader, StoreWriter, Variable, remove_store};
use quadrille::mesh::{Mesh, MeshError, Roi, Zone, ZoneElements};
use quadrille::units::{PixelSize, Px};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use tempfile::TempDir;

/// Frames of the series that the tests write.
const N_FRAMES: usize = 5;

fn mesh() -> Arc<Mesh<Px>> {
    let zones = [
        Zone::rectangle("upper, \"left\"", Roi { x0: 0.5, y0: 2.0, x1: 33.0, y1: 35.0 }),
        Zone::rectangle("lower ü", Roi { x0: 4.0, y0: 40.25, x1: 52.0, y1: 57.0 }),
    ];
    Mesh::on_zones(&zones, 16, 64, 64).unwrap().into()
}

/// A field whose numbers need all their digits, with a node that is not measured (its numbers are not zero,
/// which nothing may show).
fn field(number: usize, status: Status) -> Measurement<Px> {
    let mesh = mesh();
    let n = mesh.n_nodes();
    let awkward = |k: usize| ((k + number) as f64 + 0.1).sin() / 7.0;
    let mut measured = vec![true; n];
    measured[number] = false;
    Measurement {
        status,
        displacement: (0..n).map(|k| [awkward(k), -awkward(k + 1)]).collect(),
        sigma: (0..n).map(|k| [0.01 + awkward(k).abs(), 0.02 / 3.0]).collect(),
        measured,
        element_residual: (0..mesh.n_elements()).map(|e| 1.25 + e as f64 / 3.0).collect(),
        model_error: Some(ModelError {
            nodes: (0..n).map(|k| [awkward(k + 2).abs(), 0.03 / 7.0]).collect(),
            misfit: (0..mesh.n_elements()).map(|e| 0.1 / (e + 3) as f64).collect(),
        }),
        marks: Some((0..mesh.n_elements()).map(|e| ElementMark::from_code((e % 7) as u8).unwrap()).collect()),
        points: Some(PointField {
            displacement: (0..n).map(|k| [awkward(k + 3), -awkward(k + 4)]).collect(),
            sigma: (0..n).map(|k| [0.007 + awkward(k).abs(), 0.01 / 3.0]).collect(),
            is_value: (0..n).map(|k| k % 3 != 0).collect(),
        }),
        mesh,
    }
}

fn strain(field: &Measurement<Px>) -> StrainField {
    let windows = StrainWindows::new(&field.mesh, StrainWindow::new(3).unwrap(), false);
    let window = Some(windows.of(field, StrainDefinition::Hencky));
    StrainField { window, ..StrainField::of(field, StrainDefinition::Hencky) }
}

fn header() -> StoreHeader {
    StoreHeader {
        quadrille: "0.1.0".into(),
        device: "cpu (avx2)".into(),
        mesh: mesh(),
        image_size_px: [64, 62],
        reference: vec!["ref 1.tif".into(), "ref \"2\" 😀.tif".into()],
        reference_sha256: vec!["0a".into(), "0b".into()],
        frames: (1..=N_FRAMES).map(|k| format!("frames/ü{k}.tif")).collect(),
        pixel_size: PixelSize::new(0.00193125),
        range_grey: 231.3,
        element_size_px: 16.0,
        strain: StrainDefinition::Hencky,
        strain_window: StrainWindow::new(3),
        case: "[correlation]\nnoise = 2.0\n".into(),
    }
}

/// A store whose frames ended in all ways: 1 converged, 2 diverged, 3 unreadable, 4 partly out of the image,
/// 5 not done.
fn written() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fields.zarr");
    let writer = StoreWriter::create(&path, &header()).unwrap();
    for (number, status) in [(1, Status::Converged), (2, Status::Diverged), (4, Status::LeftImage)] {
        let field = field(number, status);
        writer.write(number, &field, &strain(&field)).unwrap();
    }
    writer.mark(3, Status::Unreadable).unwrap();
    (folder, path)
}

#[track_caller]
fn refusal(path: &Path) -> StoreError {
    Store::open(path).err().unwrap_or_else(|| panic!("{}: the store is opened", path.display()))
}

fn rewrite(file: &Path, change: impl Fn(&str) -> String) {
    let text = fs::read_to_string(file).unwrap();
    let changed = change(&text);
    assert_ne!(changed, text, "{}: nothing to change", file.display());
    fs::write(file, changed).unwrap();
}

// ---- what is written reads back ----

#[test]
fn a_penalty_reads_back_whether_it_couples_neighbours_or_their_neighbours() {
    let mesh = mesh();
    let gradient = vec![30.0; mesh.zones().len()];
    for held in [
        Regularisation::Tikhonov { cutoff_px: 64.0 },
        Regularisation::EquilibriumGap { cutoff_px: 64.0, poisson: Regularisation::POISSON },
    ] {
        let (_folder, path) = written();
        assert!(Store::open(&path).unwrap().penalty().unwrap().is_none(), "of a run that is not regularised");
        let penalty = held.penalty(&mesh, &gradient).unwrap();
        StoreWriter::create_or_open(&path, &header()).unwrap().write_penalty(&penalty).unwrap();
        let read = Store::open(&path).unwrap().penalty().unwrap().unwrap();
        assert_eq!((read.blocks(), read.pattern().columns()), (penalty.blocks(), penalty.pattern().columns()));
        let metadata = fs::read_to_string(path.join("penalty_nodes/zarr.json")).unwrap();
        assert!(metadata.contains("row and column of each block"), "{metadata}");
    }
}

#[test]
fn fields_and_header_read_back_to_the_same_bits() {
    let (folder, path) = written();
    for named in [folder.path(), &path] {
        let store = Store::open(named).unwrap();
        assert_eq!(store.path(), path);
        let read = store.header();
        assert_eq!(read.mesh.nodes(), header().mesh.nodes());
        assert_eq!(read.mesh.elements(), header().mesh.elements());
        assert_eq!(read.mesh.node_zone(), header().mesh.node_zone());
        assert_eq!(read.mesh.element_zone(), header().mesh.element_zone());
        assert_eq!(read.mesh.zones(), header().mesh.zones());
        assert_eq!((0..2).map(|z| read.mesh.zone_nodes(z)).collect::<Vec<_>>(), [0..9, 9..17]);
        // The mesh is read as a free one, without its grids; everything else is equal as it stands.
        assert_eq!(&StoreHeader { mesh: read.mesh.clone(), ..header() }, read);
        assert_eq!(store.n_frames(), N_FRAMES);
        let statuses: Vec<_> = (1..=N_FRAMES).map(|number| store.status(number).unwrap()).collect();
        let wanted = [Status::Converged, Status::Diverged, Status::Unreadable, Status::LeftImage].map(Some);
        assert_eq!(statuses, [&wanted[..], &[None]].concat());

        for number in [2, 3, 5] {
            assert!(store.frame(number).unwrap().is_none() && store.strain(number).unwrap().is_none(), "{number}");
            assert!(store.values(number, Variable::Sigma).unwrap().is_none(), "{number}");
        }
        for (number, status) in [(1, Status::Converged), (4, Status::LeftImage)] {
            let (read, wanted) = (store.frame(number).unwrap().unwrap(), field(number, status));
            assert_eq!((read.number, &read.file), (number, &header().frames[number - 1]));
            let read = read.measurement;
            assert_eq!((read.status, &read.measured), (status, &wanted.measured));
            let bits = |pairs: &[[f64; 2]], node: usize| pairs[node].map(f64::to_bits);
            let short = |v: f64| f64::from(v as f32).to_bits();
            for node in 0..wanted.mesh.n_nodes() {
                if wanted.measured[node] {
                    assert_eq!(bits(&read.displacement, node), bits(&wanted.displacement, node));
                    assert_eq!(bits(&read.sigma, node), wanted.sigma[node].map(short));
                } else {
                    assert_eq!((read.displacement[node], read.sigma[node]), ([0.0; 2], [0.0; 2]));
                }
            }
            let (model, wanted_model) = (read.model_error.as_ref().unwrap(), wanted.model_error.as_ref().unwrap());
            for (node, error) in model.nodes.iter().enumerate() {
                let known = if wanted.measured[node] { wanted_model.nodes[node].map(short) } else { [0; 2] };
                assert_eq!(error.map(f64::to_bits), known);
            }
            assert_eq!(read.marks, wanted.marks);
            let (points, wanted_points) = (read.points.as_ref().unwrap(), wanted.points.as_ref().unwrap());
            for node in 0..wanted.mesh.n_nodes() {
                let measured = wanted.measured[node];
                assert_eq!(points.is_value[node], measured && wanted_points.is_value[node]);
                let known = if measured { wanted_points.displacement[node] } else { [0.0; 2] };
                assert_eq!(bits(&points.displacement, node), known.map(f64::to_bits));
                let known = if measured { wanted_points.sigma[node].map(short) } else { [0; 2] };
                assert_eq!(points.sigma[node].map(f64::to_bits), known);
            }
            let misfit: Vec<u64> = model.misfit.iter().map(|v| v.to_bits()).collect();
            assert_eq!(misfit, wanted_model.misfit.iter().map(|&v| short(v)).collect::<Vec<_>>());
            let residual: Vec<u64> = read.element_residual.iter().map(|v| v.to_bits()).collect();
            assert_eq!(residual, wanted.element_residual.iter().map(|&v| short(v)).collect::<Vec<_>>());
            let (read, wanted) = (store.strain(number).unwrap().unwrap(), strain(&wanted));
            assert_eq!((read.definition, read.length_px), (wanted.definition, wanted.length_px));
            let rounded = |all: &[Option<TensorStrain>]| -> Vec<_> {
                all.iter().map(|strain| strain.map(|strain| strain.components().map(short))).collect()
            };
            assert_eq!(rounded(&read.elements), rounded(&wanted.elements));
            assert_eq!(rounded(&read.nodes), rounded(&wanted.nodes));
            assert!(read.elements.iter().any(Option::is_none) && read.elements.iter().any(Option::is_some));
        }
    }
}

#[test]
fn a_free_mesh_with_triangles_reads_back() {
    let zone = |name: &str, x: f64| ZoneElements {
        name: name.into(),
        nodes: vec![[x, 0.0], [x + 9.5, 1.0], [x + 10.0, 8.0], [x - 1.0, 9.0], [x + 17.0, 4.0]],
        elements: vec![[0, 1, 2, 3], [1, 4, 2, 2]],
    };
    let mesh = Arc::new(Mesh::from_zones(vec![zone("a", 1.0), zone("b", 31.0)]).unwrap());
    let folder = tempfile::tempdir().unwrap();
    StoreWriter::create(&folder.path().join("fields.zarr"), &StoreHeader { mesh: mesh.clone(), ..header() }).unwrap();
    let store = Store::open(folder.path()).unwrap();
    assert_eq!(**store.mesh(), *mesh);
}

#[test]
fn the_hashes_of_the_frames_come_at_the_end_and_nothing_else_changes() {
    let (_folder, path) = written();
    let store = Store::open(&path).unwrap();
    assert_eq!((store.frame_sha256(0), store.frame_sha256(1), store.frame_sha256(9)), (None, None, None));
    let writer = StoreWriter::create(&path, &header()).unwrap();
    writer.mark(3, Status::Unreadable).unwrap();
    writer.finish(vec![Some("aa".into()), Some("bb".into()), None]).unwrap();
    let store = Store::open(&path).unwrap();
    assert_eq!((store.frame_sha256(2), store.frame_sha256(3), store.frame_sha256(5)), (Some("bb"), None, None));
    assert_eq!(store.status(3).unwrap(), Some(Status::Unreadable));
    assert_eq!(store.status(1).unwrap(), None, "a frame of the store before is left");
}

/// The lengths that the metadata of the arrays by frame say.
fn lengths(path: &Path) -> Vec<u64> {
    let names = Variable::ALL.map(Variable::name).into_iter().chain(["status"]);
    let read = |name: &str| fs::read_to_string(path.join(name).join("zarr.json")).unwrap();
    names.map(|name| serde_json::from_str::<Value>(&read(name)).unwrap()["shape"][0].as_u64().unwrap()).collect()
}

#[test]
fn a_series_that_grows_ends_as_the_store_of_the_whole_and_can_be_read_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    let [grown, whole] = ["grown", "whole"].map(|name| folder.path().join(name));
    let header = StoreHeader { frames: (1..=200).map(|k| format!("{k}.tif")).collect(), ..header() };
    let empty = StoreHeader { frames: Vec::new(), case: "# none yet".into(), ..header.clone() };
    let writer = StoreWriter::create(&grown, &empty).unwrap();
    let early = Store::open(&grown).unwrap();
    assert_eq!(early.n_frames(), 0);
    assert!(matches!(writer.mark(1, Status::Diverged).unwrap_err(), StoreError::NoFrame { number: 1, n_frames: 0 }));
    let field = field(1, Status::Converged);
    for (number, name) in (1..100).zip(&header.frames) {
        writer.extend([name.clone()], format!("{number} frames")).unwrap();
        writer.write(number, &field, &strain(&field)).unwrap();
        let store = Store::open(&grown).unwrap();
        assert_eq!((store.n_frames(), store.header().case.as_str()), (number, format!("{number} frames").as_str()));
        let read = store.frame(number).unwrap().unwrap().measurement;
        assert!(
            read.measured == field.measured && read.displacement[0] == field.displacement[0],
            "frame {number} is another"
        );
        assert!(matches!(store.status(number + 1), Err(StoreError::NoFrame { .. })));
        assert!(lengths(&grown).iter().all(|&length| length >= number as u64));
    }
    // As another process that goes on.
    let writer = StoreWriter::open(&grown).unwrap();
    writer.extend(header.frames[99..].iter().cloned(), header.case.clone()).unwrap();
    assert!(lengths(&grown).iter().all(|&length| length > 200), "there is no room ahead");
    let of_whole = StoreWriter::create(&whole, &header).unwrap();
    for writer in [&writer, &of_whole] {
        for number in [100, 200] {
            writer.write(number, &field, &strain(&field)).unwrap();
        }
        writer.finish(vec![None; 200]).unwrap();
    }
    for name in ["zarr.json", "status/zarr.json", "sigma_px/zarr.json", "sigma_px/c.199.0.0", "measured/c.99.0"] {
        assert_eq!(fs::read(grown.join(name)).unwrap(), fs::read(whole.join(name)).unwrap(), "{name}");
    }
}

#[test]
fn what_a_frame_was_measured_from_is_kept_where_the_reference_is_renewed() {
    let (_folder, path) = written();
    assert_eq!(Store::open(&path).unwrap().reference_frame(1).unwrap(), None);
    let writer = StoreWriter::open(&path).unwrap();
    for (number, from) in [(1, 0), (4, 70_000)] {
        writer.write_reference_frame(number, from).unwrap();
    }
    assert!(matches!(writer.write_reference_frame(6, 0), Err(StoreError::NoFrame { number: 6, n_frames: N_FRAMES })));
    let store = Store::open(&path).unwrap();
    let all: Vec<Option<usize>> = (1..=N_FRAMES).map(|number| store.reference_frame(number).unwrap()).collect();
    assert_eq!(all, [Some(0), None, None, Some(70_000), None]);
    assert!(store.reference_frame(6).is_err());
    let file = store.reference_frame_file(4);
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[1..]).unwrap();
    assert!(matches!(store.check(4), Err(StoreError::DamagedChunk { frame: Some(4), .. })));
    fs::remove_file(&file).unwrap();
    assert!(matches!(store.check(4), Err(StoreError::MissingChunk { frame: Some(4), .. })));
    store.check(1).unwrap();
    // Taken back, and once more.
    writer.unmark(1).unwrap();
    writer.unmark(1).unwrap();
    assert_eq!(store.status(1).unwrap(), None);
    remove_store(&path).unwrap();
    assert!(!path.exists());
}

#[test]
fn every_array_says_its_unit_its_meaning_and_its_axes() {
    let (_folder, path) = written();
    let metadata = |name: &str| -> Value {
        serde_json::from_slice(&fs::read(path.join(name).join("zarr.json")).unwrap()).unwrap()
    };
    let mut arrays = vec![
        ("node_position_px", "px", vec!["node", "component"]),
        ("element_nodes", "1", vec!["element", "corner"]),
        ("node_zone", "1", vec!["node"]),
        ("element_zone", "1", vec!["element"]),
        ("status", "1", vec!["frame"]),
    ];
    for variable in Variable::ALL {
        let place = if variable.place() == Place::Nodes { "node" } else { "element" };
        let mut axes = vec!["frame", place];
        axes.extend((!variable.components().is_empty()).then(|| variable.axis_of_components()));
        arrays.push((variable.name(), variable.unit(), axes));
    }
    for (name, unit, axes) in &arrays {
        let array = metadata(name);
        assert_eq!(array["attributes"]["unit"], *unit, "{name}");
        assert!(array["attributes"]["description"].as_str().unwrap().len() > 20, "{name}");
        assert_eq!(array["dimension_names"], json!(axes), "{name}");
        let by_frame = axes[0] == "frame";
        assert_eq!(array["chunk_grid"]["configuration"]["chunk_shape"][0] == 1, by_frame, "{name}");
        let codecs: Vec<_> = array["codecs"].as_array().unwrap().iter().map(|codec| &codec["name"]).collect();
        assert_eq!(codecs.last().unwrap().as_str(), Some("crc32c"), "{name}");
    }
    let group: Value = serde_json::from_slice(&fs::read(path.join("zarr.json")).unwrap()).unwrap();
    let about = &group["attributes"];
    assert_eq!(about["quadrille_store"], 1);
    assert_eq!(about["status_codes"]["255"], "not done");
    assert!(about["frame_of_reference"].as_str().unwrap().contains("y down"));
    assert_eq!(about["strain"]["definition"], "hencky");
    assert_eq!(about["strain"]["node_length_px"], 32.0);
    assert!(about["sigma"].as_str().unwrap().contains("2 sigma^2 M^-1"));
    assert_eq!(about["pixel_size_mm"], 0.00193125);
    assert_eq!(about["run_toml"], header().case);
    // No folder by frame: one file for each chunk.
    for variable in Variable::ALL {
        let entries = fs::read_dir(path.join(variable.name())).unwrap();
        let names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        assert_eq!(names.len(), 3, "{names:?}"); // two frames with a field, and the metadata
    }
}

#[test]
fn a_store_of_before_the_model_error_is_read_and_goes_on_without_it() {
    let (_folder, path) = written();
    for name in ["model_error_px", "misfit_px", "mark", "displacement_point_px", "sigma_point_px", "is_point_value"] {
        fs::remove_dir_all(path.join(name)).unwrap();
    }
    let store = Store::open(&path).unwrap();
    let read = store.frame(1).unwrap().unwrap().measurement;
    assert_eq!((read.model_error.clone(), read.misfit(), read.marks.clone()), (None, None, None));
    assert_eq!((&read.points, read.at_points()), (&None, read.displacement.as_slice()));
    assert!(!store.has(Variable::ModelError) && store.has(Variable::Sigma));
    assert!(store.values(1, Variable::ModelError).unwrap().is_none());
    store.check(1).unwrap();
    let other = field(2, Status::Converged);
    let writer = StoreWriter::open(&path).unwrap();
    writer.write(2, &other, &strain(&other)).unwrap();
    writer.extend(["later.tif".to_owned()], "# more".into()).unwrap();
    let store = Store::open(&path).unwrap();
    assert!(store.frame(2).unwrap().unwrap().measurement.model_error.is_none());
    assert!(store.field_files(2).iter().all(|file| file.is_file()));
    // A field of which nobody knows it stays one in a store that could hold it.
    let (_folder, path) = written();
    let unknown = Measurement { model_error: None, marks: None, points: None, ..other };
    StoreWriter::open(&path).unwrap().write(2, &unknown, &strain(&unknown)).unwrap();
    let read = Store::open(&path).unwrap().frame(2).unwrap().unwrap().measurement;
    assert_eq!((read.model_error, read.marks), (None, None));
}

#[test]
fn a_frame_without_the_mark_of_its_status_is_not_done() {
    let (_folder, path) = written();
    fs::remove_file(path.join("status/c.0")).unwrap();
    let store = Store::open(&path).unwrap();
    assert_eq!(store.status(1).unwrap(), None);
    assert!(store.frame(1).unwrap().is_none());
    assert!(store.frame(4).unwrap().is_some());
    // Files that a killed run leaves are passed over.
    fs::write(path.join("status/c.4.part"), b"half").unwrap();
    assert_eq!(store.status(5).unwrap(), None);
}

#[test]
fn opening_a_long_series_reads_no_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fields.zarr");
    let frames: Vec<String> = (1..=100_000).map(|k| format!("frames/img_{k}.tif")).collect();
    let writer = StoreWriter::create(&path, &StoreHeader { frames, ..header() }).unwrap();
    let field = field(1, Status::Converged);
    writer.write(99_999, &field, &strain(&field)).unwrap();
    // Every chunk of a frame is a folder: whoever opens one fails.
    writer.write(7, &field, &strain(&field)).unwrap();
    for name in Variable::ALL.map(Variable::name).into_iter().chain(["status"]) {
        for entry in fs::read_dir(path.join(name)).unwrap() {
            let file = entry.unwrap().path();
            if file.file_name().unwrap().to_string_lossy().starts_with("c.6") {
                fs::remove_file(&file).unwrap();
                fs::create_dir(&file).unwrap();
            }
        }
    }
    let store = Store::open(&path).unwrap();
    assert_eq!(store.n_frames(), 100_000);
    assert_eq!(store.frame(99_999).unwrap().unwrap().file, "frames/img_99999.tif");
    assert!(matches!(store.status(7).unwrap_err(), StoreError::Read { file, .. } if file.ends_with("status/c.6")));
}

// ---- what cannot be read ----

#[test]
fn a_folder_without_a_store_is_refused_with_what_to_name() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    for path in [folder.path().to_owned(), folder.path().join("none"), folder.path().join("file")] {
        let error = refusal(&path);
        assert!(matches!(&error, StoreError::NotFound { path: named } if *named == path), "{error:?}");
        assert!(error.to_string().contains("quadrille correlate"), "{error}");
    }
}

#[test]
fn something_else_at_the_place_of_the_store_is_neither_read_nor_replaced() {
    let (_folder, path) = written();
    let group = path.join("zarr.json");
    for text in [
        "{}",
        "[1]",
        r#"{"zarr_format": 2, "node_type": "group"}"#,
        r#"{"zarr_format": 3, "node_type": "array", "attributes": {"quadrille_store": 1}}"#,
        r#"{"zarr_format": 3, "node_type": "group", "attributes": {"title": "mine"}}"#,
    ] {
        fs::write(&group, text).unwrap();
        assert!(matches!(refusal(&path), StoreError::NotAStore { .. }), "{text}");
        let error = StoreWriter::create(&path, &header()).unwrap_err();
        assert!(matches!(error, StoreError::NotAStore { .. }), "{text}");
    }
    fs::remove_file(&group).unwrap();
    assert!(matches!(refusal(&path), StoreError::NotFound { .. }));
    let error = remove_store(&path).unwrap_err();
    assert!(matches!(&error, StoreError::NotAStore { reason, .. } if reason.contains("no zarr.json")), "{error:?}");
    assert!(path.join("status/c.0").exists(), "something was removed");
}

#[test]
fn a_store_of_another_version_is_refused_with_both_and_can_be_replaced() {
    let (_folder, path) = written();
    rewrite(&path.join("zarr.json"), |text| {
        text.replace("\"quadrille_store\": 1", "\"quadrille_store\": 2").replace("\"0.1.0\"", "\"7.8.9\"")
    });
    let error = refusal(&path);
    assert!(matches!(error, StoreError::Version { found: 2, .. }), "{error:?}");
    for wanted in ["version 2", "quadrille 7.8.9", "reads version 1"] {
        assert!(error.to_string().contains(wanted), "{error}");
    }
    StoreWriter::create(&path, &header()).unwrap();
    assert_eq!(Store::open(&path).unwrap().status(1).unwrap(), None);
}

#[test]
fn removing_a_store_leaves_what_is_not_of_it() {
    let (_folder, path) = written();
    fs::write(path.join("notes.txt"), "mine").unwrap();
    remove_store(&path).unwrap();
    let left: Vec<_> = fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["notes.txt"]);
    remove_store(&path.join("none")).unwrap();
}

#[test]
fn metadata_cut_anywhere_is_refused() {
    let (_folder, path) = written();
    for name in ["zarr.json", "sigma_px/zarr.json", "element_nodes/zarr.json", "status/zarr.json"] {
        let file = path.join(name);
        let whole = fs::read(&file).unwrap();
        for length in (0..whole.len() - 2).step_by(1 + whole.len() / 100) {
            fs::write(&file, &whole[..length]).unwrap();
            let error = refusal(&path);
            assert!(
                matches!(&error, StoreError::Metadata { file: named, .. } if *named == file),
                "{length}: {error:?}"
            );
        }
        fs::remove_file(&file).unwrap();
        assert!(matches!(refusal(&path), StoreError::Metadata { .. } | StoreError::NotFound { .. }), "{name}");
        fs::write(&file, whole).unwrap();
    }
    Store::open(&path).unwrap();
}

#[test]
fn metadata_that_does_not_fit_the_layout_is_refused_with_the_file() {
    let cases = [
        ("zarr.json", "\"pixel_size_mm\": 0.00193125", "\"pixel_size_mm\": -1", "pixel_size_mm"),
        ("zarr.json", "\"range_grey\": 231.3", "\"range_grey\": 0", "range_grey"),
        ("zarr.json", "\"range_grey\": 231.3", "\"range_grey\": null", "f64"),
        ("zarr.json", "\"element_size_px\": 16.0", "\"element_size_px\": \"16\"", "f64"),
        ("zarr.json", "\"hencky\"", "\"logarithmic\"", "logarithmic"),
        ("zarr.json", "\"device\"", "\"gadget\"", "device"),
        ("zarr.json", "\"n_nodes\": 17", "\"n_nodes\": 99999999999", "more than a mesh can have"),
        ("node_zone/zarr.json", "17", "18", "shape"),
        ("sigma_px/zarr.json", "5,", "4,", "shape"),
        ("sigma_px/zarr.json", "float32", "float64", "numbers"),
        ("status/zarr.json", "uint8", "uint16", "numbers"),
        ("displacement_px/zarr.json", "\"crc32c\"", "\"crc64\"", "describes no array"),
    ];
    for (name, old, new, wanted) in cases {
        let (_folder, path) = written();
        rewrite(&path.join(name), |text| text.replacen(old, new, 1));
        let error = refusal(&path);
        assert!(
            matches!(&error, StoreError::Metadata { file, .. } if *file == path.join(name)),
            "{name}, {new}: {error:?}"
        );
        assert!(error.to_string().contains(wanted), "{name}, {new}: {error}");
    }
    let (_folder, path) = written();
    rewrite(&path.join("sigma_px/zarr.json"), |text| text.replacen("        1,", "        5,", 1));
    assert!(refusal(&path).to_string().contains("chunks"), "{}", refusal(&path));
}

#[test]
fn a_chunk_that_is_cut_changed_or_missing_is_refused_by_name_and_the_other_frames_are_read() {
    let (_folder, path) = written();
    let store = Store::open(&path).unwrap();
    for variable in Variable::ALL {
        let name = if variable.components().is_empty() { "c.0.0" } else { "c.0.0.0" };
        let file = path.join(variable.name()).join(name);
        let whole = fs::read(&file).unwrap();
        let assert_damaged = |what: &str| {
            let error = match variable {
                Variable::StrainElement | Variable::StrainNode => store.strain(1).unwrap_err(),
                _ if variable.is_of_window() => store.values(1, variable).unwrap_err(),
                _ => store.frame(1).unwrap_err(),
            };
            let named =
                matches!(&error, StoreError::DamagedChunk { file: named, frame: Some(1), .. } if *named == file);
            assert!(named, "{variable:?}, {what}: {error:?}");
            assert!(store.values(1, variable).is_err(), "{variable:?}, {what}");
        };
        for length in 0..whole.len() {
            fs::write(&file, &whole[..length]).unwrap();
            assert_damaged(&format!("cut to {length}"));
        }
        for at in 0..whole.len() {
            let mut changed = whole.clone();
            changed[at] ^= 0x40;
            fs::write(&file, changed).unwrap();
            assert_damaged(&format!("byte {at} changed"));
        }
        fs::remove_file(&file).unwrap();
        let error = store.values(1, variable).unwrap_err();
        let named = matches!(&error, StoreError::MissingChunk { file: named, frame: Some(1) } if *named == file);
        assert!(named, "{error:?}");
        assert!(error.to_string().contains("frame 1 is lost"), "{error}");
        assert!(store.frame(4).unwrap().is_some() && store.strain(4).unwrap().is_some());
        fs::write(&file, whole).unwrap();
    }
    store.frame(1).unwrap().unwrap();
    fs::write(path.join("status/c.0"), b"").unwrap();
    assert!(matches!(store.status(1).unwrap_err(), StoreError::DamagedChunk { frame: Some(1), .. }));
}

/// Writes a chunk with the crate's own store, as a foreign program would.
fn foreign_chunk<T: zarrs::array::Element>(path: &Path, array: &str, at: &[u64], values: &[T]) {
    let storage = Arc::new(zarrs::filesystem::FilesystemStore::new(path).unwrap());
    let array = zarrs::array::Array::open(storage, &format!("/{array}")).unwrap();
    array.store_chunk(at, values).unwrap();
}

#[test]
fn whole_chunks_with_impossible_numbers_are_refused() {
    let assert_damaged = |wanted: &str, change: &dyn Fn(&Path)| {
        let (_folder, path) = written();
        change(&path);
        let error = match Store::open(&path) {
            Err(error) => error,
            Ok(store) => store.frame(1).unwrap_err(),
        };
        assert!(matches!(error, StoreError::DamagedChunk { .. }), "{wanted}: {error:?}");
        assert!(error.to_string().contains(wanted), "{wanted}: {error}");
    };
    let mesh = mesh();
    let mut positions = mesh.nodes().as_flattened().to_vec();
    positions[5] = f64::INFINITY;
    assert_damaged("node 2", &|path| foreign_chunk(path, "node_position_px", &[0, 0], &positions));
    let mut corners = mesh.elements().as_flattened().to_vec();
    corners[2] = 16; // a node of the other zone
    assert_damaged("element 0 has the node 16", &|path| foreign_chunk(path, "element_nodes", &[0, 0], &corners));
    let mut zones = mesh.node_zone().to_vec();
    zones[0] = 1;
    assert_damaged("not numbered in order", &|path| foreign_chunk(path, "node_zone", &[0], &zones));
    let zones = vec![2u32; mesh.n_elements()];
    assert_damaged("below 2", &|path| foreign_chunk(path, "element_zone", &[0], &zones));
    assert_damaged("not a status", &|path| foreign_chunk(path, "status", &[0], &[77u8]));
    let marks = vec![3u8; mesh.n_nodes()];
    assert_damaged("mark of node 0 is 3", &|path| foreign_chunk(path, "measured", &[0, 0], &marks));
    let mut lost = vec![f64::NAN; 2 * mesh.n_nodes()];
    lost[7] = 0.5; // a chunk of nothing but fill values would be left out
    // Node 1 is the one that is not measured.
    assert_damaged("node 0 is measured", &|path| foreign_chunk(path, "displacement_px", &[0, 0, 0], &lost));
    let residual = vec![f32::INFINITY; mesh.n_elements()];
    assert_damaged("residual of element 0", &|path| foreign_chunk(path, "residual_grey", &[0, 0], &residual));
}

#[test]
fn a_mesh_that_is_none_is_refused_with_the_element() {
    let (_folder, path) = written();
    foreign_chunk(&path, "node_position_px", &[0, 0], &vec![1.0f64; 2 * mesh().n_nodes()]);
    let error = refusal(&path);
    assert!(matches!(&error, StoreError::Mesh { source: MeshError::BadElement { element: 0, .. }, .. }), "{error:?}");
}

#[test]
fn a_mesh_without_its_chunk_is_refused() {
    for name in ["node_position_px/c.0.0", "element_nodes/c.0.0", "node_zone/c.0", "element_zone/c.0"] {
        let (_folder, path) = written();
        fs::remove_file(path.join(name)).unwrap();
        let error = refusal(&path);
        let named = matches!(&error, StoreError::MissingChunk { file, frame: None } if *file == path.join(name));
        assert!(named && error.to_string().contains("quadrille correlate"), "{error:?}");
    }
}

#[test]
fn frames_beyond_the_series_and_fields_of_another_mesh_are_refused() {
    let (_folder, path) = written();
    let store = Store::open(&path).unwrap();
    let writer = StoreWriter::create(&path, &header()).unwrap();
    let field = field(1, Status::Converged);
    for number in [0, N_FRAMES + 1] {
        for error in [
            store.status(number).unwrap_err(),
            store.frame(number).unwrap_err(),
            store.strain(number).unwrap_err(),
            writer.mark(number, Status::Diverged).unwrap_err(),
            writer.write(number, &field, &strain(&field)).unwrap_err(),
        ] {
            assert!(matches!(error, StoreError::NoFrame { n_frames: N_FRAMES, .. }), "{error:?}");
        }
    }
    let mut short = field.clone();
    short.element_residual.pop();
    let error = writer.write(1, &short, &strain(&field)).unwrap_err();
    assert!(matches!(error, StoreError::WrongSize { number: 1, found: 6, wanted: 7, .. }), "{error:?}");
    assert!(!path.join("residual_grey/c.0.0").exists());
}

#[test]
fn a_write_that_fails_is_named_and_the_frame_is_not_done() {
    let (_folder, path) = written();
    let writer = StoreWriter::create(&path, &header()).unwrap();
    let field = field(1, Status::Converged);
    writer.write(1, &field, &strain(&field)).unwrap();
    fs::create_dir(path.join("strain_node/c.1.0.0.part")).unwrap();
    let error = writer.write(2, &field, &strain(&field)).unwrap_err();
    let named = matches!(&error, StoreError::Write { file, .. } if file.ends_with("strain_node/c.1.0.0"));
    assert!(named, "{error:?}");
    let store = Store::open(&path).unwrap();
    assert_eq!((store.status(1).unwrap(), store.status(2).unwrap()), (Some(Status::Converged), None));
    // A device that is always full, where there is one.
    #[cfg(target_os = "linux")]
    {
        std::os::unix::fs::symlink("/dev/full", path.join("sigma_px/c.2.0.0.part")).unwrap();
        let error = writer.write(3, &field, &strain(&field)).unwrap_err();
        assert!(error.to_string().contains("sigma_px/c.2.0.0: cannot be written: No space left"), "{error}");
        assert!(!path.join("sigma_px/c.2.0.0.part").is_symlink(), "the unfinished file is left");
    }
}

// ---- files of arrays ----

#[test]
fn a_variable_that_a_mat_file_cannot_hold_is_refused_with_what_to_do() {
    let shape = Shape { frames: Some(70_000), rows: 4_000, components: 2 };
    let error = MatWriter::<Vec<u8>>::check("displacement_px", Number::F64, shape).unwrap_err();
    assert!(matches!(error, ArrayFileError::TooLarge { bytes: 4_480_000_000, .. }), "{error:?}");
    for wanted in ["displacement_px", "4.48 GB", "--split", "npz"] {
        assert!(error.to_string().contains(wanted), "{error}");
    }
    let mut file = MatWriter::new(Vec::new(), "test").unwrap();
    assert!(matches!(file.begin("u", Number::F64, shape), Err(ArrayFileError::TooLarge { .. })));
    NpzWriter::<std::io::Cursor<Vec<u8>>>::check("displacement_px", Number::F64, shape).unwrap();
}

fn assert_blocks_are_held_to_their_beginning<F: ArrayFile>(mut file: F) {
    let shape = Shape { frames: Some(2), rows: 3, components: 1 };
    file.begin("a", Number::F32, shape).unwrap();
    for wrong in [Values::F64(vec![0.0; 3]), Values::F32(vec![0.0; 4]), Values::U8(vec![0; 3]), Values::U32(vec![])] {
        assert!(matches!(file.block(&wrong), Err(ArrayFileError::WrongBlock { .. })), "{wrong:?}");
    }
    file.block(&Values::F32(vec![0.0; 3])).unwrap();
    let early = file.begin("b", Number::F32, shape).unwrap_err();
    assert!(matches!(early, ArrayFileError::WrongBlock { wanted: 3, found: 0, .. }), "{early:?}");
}

#[test]
fn blocks_of_an_array_are_held_to_what_its_beginning_said() {
    assert_blocks_are_held_to_their_beginning(NpzWriter::new(std::io::Cursor::new(Vec::new())));
    assert_blocks_are_held_to_their_beginning(MatWriter::new(Vec::new(), "test").unwrap());
}

#[test]
fn a_full_disk_is_an_error_of_arrays_too() {
    // A slice without room stands for the disk.
    assert!(matches!(MatWriter::new(&mut [][..], "test").err().unwrap(), ArrayFileError::Write(_)));
}

// ---- the program ----

#[test]
fn a_run_writes_the_store_and_exports_from_it_are_those_of_the_run() {
    let desk = Desk::with_series();
    desk.write("broken.png", "no image");
    // Frame 2 leaves the image in part, frame 3 is none.
    desk.image("far.png", &moved([-3.0, 24.0]));
    let flags = "--roi 16,16,112,48 --roi 16.5,50,112,80 --element-size 8 --strain hencky --pixel-size 0.00193125";
    desk.correlate(&format!("{flags} --export csv,vtu --output out ref.png a.png far.png broken.png b.png"))
        .incomplete();
    let store = Store::open(desk.path("out")).unwrap();
    let statuses: Vec<_> = (1..=4).map(|number| store.status(number).unwrap().unwrap()).collect();
    let summary = desk.json("out/summary.json");
    for (status, frame) in statuses.iter().zip(summary["frames"].as_array().unwrap()) {
        assert_eq!(frame["status"], status.name());
    }
    assert_eq!((statuses[0], statuses[2]), (Status::Converged, Status::Unreadable));
    let header = store.header();
    assert_eq!((header.strain, header.image_size_px), (StrainDefinition::Hencky, [128, 96]));
    assert_eq!(header.frames, ["a.png", "far.png", "broken.png", "b.png"]);
    assert_eq!(header.mesh.zones(), ["zone1", "zone2"]);
    let case: toml::Table = header.case.parse().unwrap();
    assert_eq!(case["correlation"]["element_size_px"].as_integer(), Some(8));
    let images: toml::Table = desk.read("out/run.toml").parse().unwrap();
    let image = |k: usize| images["run"]["image"][k].get("sha256").map(|sha256| sha256.as_str().unwrap().to_owned());
    assert_eq!(header.reference_sha256, [image(0).unwrap()]);
    for number in 1..=4 {
        assert_eq!(store.frame_sha256(number).map(str::to_owned), image(number), "frame {number}");
    }

    let ran = desk.run("export out --to csv,vtu --output again").fine();
    assert!(ran.stderr.contains("without a field left out") && ran.stderr.contains("again"), "{ran}");
    let made = desk.files("again");
    assert!(made.len() >= 5, "{made:?}");
    for name in &made {
        assert_eq!(desk.read(&format!("again/{name}")), desk.read(&format!("out/{name}")), "{name}");
    }
    let of_run: Vec<_> =
        desk.files("out").into_iter().filter(|name| !["run.toml", "summary.json"].contains(&name.as_str())).collect();
    assert_eq!(made, of_run);
    // The strains are there: the motion is a translation.
    let row = &desk.rows("again/csv/000001.csv")[0];
    assert!(row.strain.unwrap().components().iter().all(|e| e.abs() < 0.01), "{row:?}");
}

#[test]
fn the_store_has_the_same_chunks_for_any_number_of_threads() {
    let desk = Desk::with_series();
    for threads in ["1", "2"] {
        desk.correlate(&format!("{INSIDE} --threads {threads} --export none --output t{threads} ref.png a.png b.png"))
            .fine();
    }
    let files = desk.all_files("t1");
    assert_eq!(files, desk.all_files("t2"));
    let chunks: Vec<_> = files.iter().filter(|name| name.contains("/c.")).collect();
    assert_eq!(chunks.len(), 6 + 2 * 14, "{chunks:?}");
    for name in chunks {
        assert!(desk.bytes(&format!("t1/{name}")) == desk.bytes(&format!("t2/{name}")), "{name}");
    }
}

#[test]
fn chosen_frames_are_exported_and_those_without_a_field_are_named() {
    let desk = Desk::with_series();
    desk.write("broken.png", "no image");
    desk.correlate(&format!("{INSIDE} --export none --output out ref.png a.png broken.png b.png c.png")).incomplete();
    desk.run("export out --to csv --frames 3-4,1 --output some").fine();
    assert_eq!(desk.files("some"), ["csv/000001.csv", "csv/000003.csv", "csv/000004.csv"]);
    let ran = desk.run("export out --to vtu --frames 1,2 --output named").incomplete();
    assert!(ran.stderr.contains("frame 2 has no field: unreadable"), "{ran}");
    assert_eq!(desk.files("named"), ["series.pvd", "vtu/000001.vtu"]);
    // A second call adds to the list of the series.
    desk.run("export out --to vtu --frames 4,3 --output named").fine();
    let series = desk.read("named/series.pvd");
    let listed: Vec<_> = series.split("file=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert_eq!(listed, ["vtu/000001.vtu", "vtu/000003.vtu", "vtu/000004.vtu"]);
    desk.run("export out --to csv --frames last --output last --quiet").fine();
    assert_eq!(desk.files("last"), ["csv/000004.csv"]);
    desk.run("export out --to csv --frames 2 --output no --quiet").refused(&["fields.zarr", "none of 1 frame"]);
    desk.run("export out --to csv --frames 3-9 --output no").refused(&["frame 9", "the series has 4"]);
    desk.run("export out --to csv --frames 0 --output no").refused(&["'0' is not a frame", "1,5-20"]);
    desk.run("export out --to xlsx").refused(&["xlsx", "csv, vtu, npz, mat"]);
    desk.run("export nowhere --to csv").refused(&["nowhere: there is no fields.zarr here"]);
    assert!(desk.files("no").is_empty());
}

#[test]
fn files_that_are_there_are_replaced_only_when_that_is_asked_for() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png")).fine();
    let table = desk.bytes("out/csv/000001.csv");
    desk.write("out/csv/000001.csv", "# mine\n");
    desk.run("export out --to csv").refused(&["out/csv/000001.csv: is there already", "--overwrite", "--output"]);
    assert_eq!(desk.read("out/csv/000001.csv"), "# mine\n");
    desk.run("export out --to csv --overwrite").fine();
    assert!(desk.bytes("out/csv/000001.csv") == table);
    desk.run("export out --to npz").fine();
    desk.run("export out --to npz").refused(&["out/fields.npz"]);
    desk.run("export out --to mat --split").fine();
    assert!(desk.files("out").contains(&"mat/000001.mat".to_owned()));
}

#[test]
fn a_damaged_store_ends_the_export_with_the_name_of_the_chunk() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --export none --output out ref.png a.png b.png")).fine();
    desk.write("out/fields.zarr/sigma_px/c.1.0.0", "short");
    for to in ["csv", "npz", "mat"] {
        let ran = desk.run(&format!("export out --to {to} --output made --overwrite"));
        ran.refused(&["sigma_px/c.1.0.0", "damaged", "frame 2 is lost"]);
    }
    assert_eq!(desk.files("made"), ["csv/000001.csv"]);
}

/// Reads all of the store in `path` that can be read.
fn read_all(path: &Path) {
    let Ok(store) = Store::open(path) else { return };
    for number in 1..=store.n_frames().min(2 * N_FRAMES) {
        let _ = (store.status(number), store.frame(number), store.without_field(number), store.check(number));
        let _ = (store.reference_frame(number), store.noise(number));
    }
    let _ = (store.normal_matrices(), store.gradient_noise());
}

/// Damages one byte after the other of every `step`-th place of every file of a store, in three ways, and reads it.
fn damage(step: usize) {
    let (_folder, path) = written();
    let mut files = vec![path.join("zarr.json")];
    let arrays = fs::read_dir(&path).unwrap().flatten().map(|entry| entry.path()).filter(|path| path.is_dir());
    for array in arrays {
        files.extend(fs::read_dir(array).unwrap().flatten().map(|entry| entry.path()));
    }
    files.sort();
    for file in files {
        let whole = fs::read(&file).unwrap();
        for at in (whole.len() % step..whole.len()).step_by(step) {
            let mut damaged = whole.clone();
            // A bit, a digit or sign in place of another, a cut.
            damaged[at] ^= 1 << (at % 8);
            let other = b"0919-.e\"[]{},:"[at % 14];
            let digit = [&whole[..at], &[other], &whole[at + 1..]].concat();
            for bytes in [damaged, digit, whole[..at].to_vec()] {
                fs::write(&file, bytes).unwrap();
                read_all(&path);
            }
        }
        fs::write(&file, &whole).unwrap();
    }
    assert!(Store::open(&path).unwrap().frame(1).unwrap().is_some());
}

#[test]
fn no_damage_makes_the_reader_of_stores_panic() {
    damage(97);
}

#[test]
#[ignore = "minutes"]
fn no_damage_of_any_byte_makes_the_reader_of_stores_panic() {
    damage(1);
}

#[test]
fn what_is_not_a_store_is_not_overwritten_by_a_run() {
    let desk = Desk::with_series();
    desk.write("out/fields.zarr/notes.txt", "mine");
    let line = format!("{INSIDE} --output out ref.png a.png");
    desk.correlate(&line).refused(&["out: holds the results of another run"]);
    desk.correlate(&format!("--overwrite {line}")).refused(&["out/fields.zarr", "not a store of quadrille"]);
    assert_eq!(desk.read("out/fields.zarr/notes.txt"), "mine");
}

#[test]
fn many_frames_are_written_to_the_store_alone_unless_tables_are_asked_for() {
    let desk = Desk::with_series();
    let n = 1001;
    fs::create_dir(desk.path("many")).unwrap();
    for k in 0..n {
        let image = desk.path(["a.png", "b.png"][k % 2]);
        let name = desk.path(&format!("many/{k:04}.png"));
        fs::hard_link(&image, &name).or_else(|_| fs::copy(&image, &name).map(|_| ())).unwrap();
    }
    let line = "--roi 32,32,64,64 --reference ref.png --output";
    let ran = desk.correlate(&format!("{line} out many/*.png")).fine();
    assert!(ran.stderr.contains("more than 1000 frames") && ran.stderr.contains("quadrille export"), "{ran}");
    assert_eq!(desk.files("out"), ["run.toml", "summary.json"]);
    assert_eq!(Store::open(desk.path("out")).unwrap().status(n).unwrap(), Some(Status::Converged));
    desk.run("export out --to csv --frames 1000-1001").fine();
    assert_eq!(desk.files("out/csv"), ["001000.csv", "001001.csv"]);
    desk.correlate(&format!("{line} asked --export csv many/*.png")).fine();
    assert_eq!(desk.files("asked/csv").len(), n);
}

#[test]
fn a_run_that_fills_the_disk_ends_with_exit_2_and_earlier_frames_stay() {
    let desk = Desk::with_series();
    let names: Vec<String> = (0..60).map(|k| format!("many/{k:02}.png")).collect();
    fs::create_dir(desk.path("many")).unwrap();
    names.iter().for_each(|name| fs::copy(desk.path("a.png"), desk.path(name)).map(|_| ()).unwrap());
    fs::create_dir(desk.path("disk")).unwrap();
    // A small disk of its own in a name space of its own: nothing is left mounted.
    let script = "mount -t tmpfs -o size=600k tmpfs disk || exit 99
        \"$1\" correlate --quiet --export none --reference ref.png --roi 16,16,112,80 --element-size 8 --output disk/out 'many/*.png'
        code=$?
        \"$1\" export disk/out --to csv --output saved >&2
        exit $code";
    let program = env!("CARGO_BIN_EXE_quadrille");
    let run = Command::new("unshare")
        .args(["--map-root-user", "--mount", "sh", "-c", script, "sh", program])
        .current_dir(desk.path(""))
        .output();
    let Ok(run) = run else { return println!("SKIPPED: there is no unshare") };
    let said = String::from_utf8_lossy(&run.stderr);
    if run.status.code() == Some(99) || said.contains("unshare: ") {
        return println!("SKIPPED: no file system can be mounted here: {said}");
    }
    assert_eq!(run.status.code(), Some(2), "{said}");
    assert!(said.contains("disk/out/") && said.contains("No space left"), "{said}");
    let saved = desk.files("saved/csv");
    assert!(saved.len() > 3 && saved.len() < names.len(), "{} of {} frames: {said}", saved.len(), names.len());
    assert_eq!(desk.rows("saved/csv/000001.csv").len(), 13 * 9);
}

// ---- other people's readers ----

/// The Python to read with; `None`, after saying so, when it has no zarr and nobody asked for it.
pub fn python() -> Option<(String, PathBuf)> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/read_store.py");
    let asked = std::env::var("QUADRILLE_PYTHON").ok();
    let python = asked.clone().unwrap_or_else(|| "python3".into());
    let why = match Command::new(&python).arg(&script).arg("--available").output() {
        Ok(output) if output.status.success() => return Some((python, script)),
        // Too old for zarr 3: not a matter of what is installed.
        Ok(output) if output.status.code() == Some(3) => {
            println!("SKIPPED: {python}: {}", String::from_utf8_lossy(&output.stderr));
            return None;
        }
        Ok(output) => String::from_utf8_lossy(&output.stderr).into_owned(),
        Err(error) => error.to_string(),
    };
    assert!(asked.is_none(), "QUADRILLE_PYTHON is '{python}', which cannot import zarr 3, numpy and scipy: {why}");
    println!("SKIPPED: {python}: {why}; pip install -r scripts/requirements.txt and set QUADRILLE_PYTHON");
    None
}

#[track_caller]
fn read_in_python(kind: &str, path: &Path) -> Option<Value> {
    let (python, script) = python()?;
    let output = Command::new(python).arg(script).arg(kind).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

/// The bits of `values` as a Python reader prints them.
fn bits(values: &Values) -> Value {
    match values {
        Values::F64(values) => json!(values.iter().map(|v| v.to_bits()).collect::<Vec<_>>()),
        Values::F32(values) => json!(values.iter().map(|v| v.to_bits()).collect::<Vec<_>>()),
        Values::U32(values) => json!(values),
        Values::U8(values) => json!(values),
    }
}

fn type_name(number: Number) -> &'static str {
    match number {
        Number::F64 => "float64",
        Number::F32 => "float32",
        Number::U32 => "uint32",
        Number::U8 => "uint8",
    }
}

fn rows(variable: Variable) -> usize {
    if variable.place() == Place::Nodes { mesh().n_nodes() } else { mesh().n_elements() }
}

#[test]
fn zarr_python_reads_the_store_to_the_same_bits() {
    let (_folder, path) = written();
    let Some(read) = read_in_python("zarr", &path) else { return };
    let store = Store::open(&path).unwrap();
    assert_eq!(read["attributes"]["quadrille_store"], 1);
    assert_eq!(read["attributes"]["frames"], json!(header().frames));
    assert_eq!(read["attributes"]["zones"], json!(mesh().zones()));
    assert_eq!(read["status"]["values"], json!([0, 2, 4, 3, 255]));
    assert_eq!(read["status"]["dimensions"], json!(["frame"]));
    assert_eq!(read["node_position_px"]["values"], bits(&Values::F64(mesh().nodes().as_flattened().to_vec())));
    assert_eq!(read["element_nodes"]["values"], bits(&Values::U32(mesh().elements().as_flattened().to_vec())));
    assert_eq!(read["element_nodes"]["shape"], json!([mesh().n_elements(), 4]));
    assert_eq!(read["node_zone"]["values"], json!(mesh().node_zone()));
    assert_eq!(read["element_zone"]["values"], json!(mesh().element_zone()));
    for variable in Variable::ALL {
        let array = &read[variable.name()];
        assert_eq!(array["type"], type_name(variable.number()), "{variable:?}");
        assert_eq!(array["attributes"]["unit"], variable.unit(), "{variable:?}");
        let block = rows(variable) * variable.n_components();
        let values = array["values"].as_array().unwrap();
        assert_eq!(values.len(), N_FRAMES * block, "{variable:?}");
        for number in 1..=N_FRAMES {
            let frame = json!(values[(number - 1) * block..number * block]);
            match store.values(number, variable).unwrap() {
                Some(wanted) => assert_eq!(frame, bits(&wanted), "{variable:?}, frame {number}"),
                // What is not written is NaN, or 0 where it says what was measured.
                None => {
                    let fill = match variable.number() {
                        Number::F64 => json!(f64::NAN.to_bits()),
                        Number::F32 => json!(f32::NAN.to_bits()),
                        _ => json!(0),
                    };
                    assert!(frame.as_array().unwrap().iter().all(|v| *v == fill), "{variable:?}, frame {number}");
                }
            }
        }
    }
}

#[test]
fn numpy_and_scipy_read_the_exported_arrays_to_the_same_bits() {
    let desk = Desk::new();
    let (folder, path) = written();
    // The program reads the store that the library has written.
    let run = folder.path().to_str().unwrap();
    desk.run(&format!("export {run} --to npz,mat --output whole")).fine();
    desk.run(&format!("export {run} --to npz,mat --output parts --split --frames 4")).fine();
    let store = Store::open(&path).unwrap();
    let Some(npz) = read_in_python("npz", &desk.path("whole/fields.npz")) else { return };
    let mat = read_in_python("mat", &desk.path("whole/fields.mat")).unwrap();
    let npz_part = read_in_python("npz", &desk.path("parts/npz/000004.npz")).unwrap();
    let mat_part = read_in_python("mat", &desk.path("parts/mat/000004.mat")).unwrap();
    for read in [&npz, &mat, &npz_part, &mat_part] {
        assert_eq!(read["zone_name"]["values"], json!(mesh().zones()));
        let about = read["about"]["values"].to_string();
        for wanted in ["quadrille 0.1.0", "y down", "tensor shear", "[grey levels]", "hencky"] {
            assert!(about.contains(wanted), "'{wanted}' is missing in {about}");
        }
        assert_eq!(read["run_toml"]["values"], json!(header().case.lines().collect::<Vec<_>>()));
        let reference = read["reference_file"]["values"].to_string();
        assert_eq!(reference.replace('\u{fffd}', "😀"), json!(header().reference).to_string());
        assert_eq!(read["pixel_size_mm"]["values"], bits(&Values::F64(vec![0.00193125])));
        assert_eq!(read["image_size_px"]["values"], bits(&Values::F64(vec![64.0, 62.0])));
        assert_eq!(read["node_position_px"]["values"], bits(&Values::F64(mesh().nodes().as_flattened().to_vec())));
    }
    assert_eq!(npz["reference_file"]["values"], json!(header().reference));
    assert_eq!((&npz["frame"]["values"], &mat["frame"]["values"]), (&json!([1, 4]), &json!([1, 4])));
    assert_eq!(npz["frame_file"]["values"], json!([header().frames[0], header().frames[3]]));
    assert_eq!(mat["frame_file"]["shape"], json!([2, 1]));
    assert_eq!(mat_part["frame_file"]["values"], json!([header().frames[3]]));
    assert_eq!((&npz["status"]["values"], &npz_part["status"]["values"]), (&json!([0, 3]), &json!([3])));
    // NumPy counts from 0, MATLAB from 1.
    let corners = mesh().elements().as_flattened().to_vec();
    assert_eq!(npz["element_nodes"]["values"], json!(corners));
    assert_eq!(mat["element_nodes"]["values"], json!(corners.iter().map(|node| node + 1).collect::<Vec<_>>()));
    assert_eq!(mat["element_nodes"]["shape"], json!([mesh().n_elements(), 4]));
    assert_eq!(mat["node_zone"]["values"], json!(mesh().node_zone().iter().map(|zone| zone + 1).collect::<Vec<_>>()));
    for variable in Variable::ALL {
        let (name, n, components) = (variable.name(), rows(variable), variable.n_components());
        let frames = [1, 4].map(|number| bits(&store.values(number, variable).unwrap().unwrap()));
        let frames = frames.map(|frame| frame.as_array().unwrap().clone());
        let axes = |list: &[usize]| if components > 1 { json!([list, &[components]].concat()) } else { json!(list) };
        assert_eq!(npz[name]["type"], type_name(variable.number()), "{name}");
        assert_eq!(mat[name]["type"], type_name(variable.number()), "{name}");
        assert_eq!(npz[name]["shape"], axes(&[2, n]), "{name}");
        assert_eq!(npz[name]["values"], json!(frames.concat()), "{name}");
        assert_eq!(npz_part[name]["shape"], axes(&[n]), "{name}");
        assert_eq!(npz_part[name]["values"], json!(frames[1]), "{name}");
        assert_eq!(mat_part[name]["shape"], json!([n, components]), "{name}");
        assert_eq!(mat_part[name]["values"], json!(frames[1]), "{name}");
        // In MATLAB the frame is the last axis: in the order of C it goes fastest.
        let interleaved: Vec<_> =
            (0..n * components).flat_map(|k| [frames[0][k].clone(), frames[1][k].clone()]).collect();
        let shape = if components > 1 { json!([n, components, 2]) } else { json!([n, 2]) };
        assert_eq!(mat[name]["shape"], shape, "{name}");
        assert_eq!(mat[name]["values"], json!(interleaved), "{name}");
    }
}

#[test]
fn the_python_example_of_the_guide_runs() {
    let guide = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/guide.md")).unwrap();
    let blocks: Vec<_> = guide.split("```python\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    let [example] = blocks[..] else { panic!("docs/guide.md has {} examples in Python", blocks.len()) };
    assert!(example.lines().filter(|line| !line.trim().is_empty()).count() <= 10, "{example}");
    let Some((python, _)) = python() else { return };
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --pixel-size 0.5 --output out ref.png a.png b.png c.png")).fine();
    let check = "
assert xy.shape == (35, 2) and u.shape == (35, 2), (xy.shape, u.shape)
assert list(converged) == [True, True, True]
assert abs(u[:, 0].mean() - 0.75) < 0.01 and abs(u[:, 1].mean() + 0.75) < 0.01, u.mean(axis=0)
assert edge.sum() == 7 and abs(opening_mm.mean() + 0.375) < 0.005, opening_mm
assert exx.shape == (3, 24) and abs(exx).max() < 0.01, exx
";
    desk.write("example.py", format!("{example}{check}"));
    let output = Command::new(python).arg("example.py").current_dir(desk.path("")).output().unwrap();
    assert!(output.status.success(), "{}\n{example}", String::from_utf8_lossy(&output.stderr));
}
