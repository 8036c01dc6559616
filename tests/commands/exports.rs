//! What quadrille writes for other programs reads back as it was.

use quadrille::field::{
    Measurement, ModelError, PointField, Status, StrainDefinition, StrainField, StrainWindow, StrainWindows,
    TensorStrain, WindowStrains,
};
use quadrille::io::csv::{CsvError, read_displacements, write_displacements};
use quadrille::io::vtk::{VtkError, write_pvd, write_vtu};
use quadrille::mesh::{Mesh, Roi, Zone};
use quadrille::units::{PixelSize, Px};
use serde_json::json;
use std::io::{self, Write};
use std::path::Path;
use std::process::Command;

/// Two zones with awkward names, 2 x 2 and 3 x 1 elements, numbers that need all their digits, two nodes
/// without measurement (numbers there are not zero, which nothing may show).
fn two_zones() -> Measurement<Px> {
    let zones = [
        Zone::rectangle("upper, \"left\"", Roi { x0: 0.5, y0: 2.0, x1: 33.0, y1: 35.0 }),
        Zone::rectangle("lower -- ü <&>", Roi { x0: 4.0, y0: 40.25, x1: 52.0, y1: 57.0 }),
    ];
    let mesh = Mesh::on_zones(&zones, 16, 64, 64).unwrap();
    let n = mesh.n_nodes();
    let awkward = |k: usize| (k as f64 + 0.1).powi(3) / 7.0 * 10f64.powi(-(k as i32));
    let mut measurement = Measurement {
        status: Status::IterationLimit,
        displacement: (0..n).map(|k| [awkward(k), -awkward(k + 1)]).collect(),
        sigma: (0..n).map(|k| [awkward(k) / 3.0, 0.01]).collect(),
        measured: vec![true; n],
        element_residual: (0..mesh.n_elements()).map(|e| 1.25 + e as f64 / 3.0).collect(),
        model_error: None,
        marks: None,
        points: None,
        mesh: mesh.into(),
    };
    for node in [3, 11] {
        measurement.measured[node] = false;
    }
    measurement
}

/// Its strains, with one more that is not known.
fn strains() -> StrainField {
    let mut strains = StrainField::of(&two_zones(), StrainDefinition::GreenLagrange);
    strains.nodes[1] = None;
    strains
}

fn table(header: &[String], pixel_size: Option<PixelSize>) -> String {
    let mut out = Vec::new();
    let field = two_zones();
    let plane = pixel_size.map(|size| (size, &field));
    write_displacements(&mut out, header, &field, Some(&strains()), plane).unwrap();
    String::from_utf8(out).unwrap()
}

#[test]
fn a_table_of_displacements_reads_back_to_the_same_bits() {
    let measurement = two_zones();
    let size = PixelSize::new(0.00193125).unwrap();
    for pixel_size in [None, Some(size)] {
        let rows = read_displacements(table(&["frame 3".into()], pixel_size).as_bytes()).unwrap();
        let nodes: Vec<usize> = (0..measurement.mesh.n_nodes()).filter(|&k| measurement.measured[k]).collect();
        assert_eq!(rows.iter().map(|row| row.node).collect::<Vec<_>>(), nodes);
        for row in rows {
            assert_eq!(row.zone, measurement.mesh.zones()[measurement.mesh.node_zone()[row.node] as usize]);
            assert_eq!(row.px.position, measurement.mesh.nodes()[row.node]);
            assert_eq!(row.px.displacement, measurement.displacement[row.node]);
            assert_eq!(row.px.sigma.map(|v| v as f32), measurement.sigma[row.node].map(|v| v as f32));
            let strain = |strain: TensorStrain| strain.components().map(|e| e as f32);
            assert_eq!(row.strain.map(strain), strains().nodes[row.node].map(strain));
            assert_eq!(row.mm.is_some(), pixel_size.is_some());
            if let Some(mm) = row.mm {
                assert_eq!(mm.position, row.px.position.map(|v| size.mm_from_px(v)));
                assert_eq!(mm.displacement, row.px.displacement.map(|v| size.mm_from_px(v)));
                let in_mm = |v: f64| size.mm_from_px(f64::from(v as f32)) as f32;
                assert_eq!(mm.sigma.map(|v| v as f32), row.px.sigma.map(in_mm));
            }
        }
    }
}

#[test]
fn a_table_begins_with_its_comments_and_the_names_of_its_columns() {
    let text = table(&["quadrille 0.1.0".into(), "two\nlines".into()], PixelSize::new(0.002));
    let mut lines = text.lines().skip_while(|line| line.starts_with('#'));
    let px = "node,zone,x_px,y_px,ux_px,uy_px,sigma_ux_px,sigma_uy_px,exx,eyy,exy,e1,e2,e1_direction_deg,shear_max,von_mises";
    assert_eq!(lines.next().unwrap(), format!("{px},x_mm,y_mm,ux_mm,uy_mm,sigma_ux_mm,sigma_uy_mm"));
    assert!(text.starts_with("# quadrille 0.1.0\n# two\n# lines\n# status: iteration_limit\n"), "{text}");
    assert!(text.contains("y down") && text.contains("# 1 px = 0.002 mm"), "{text}");
    assert!(lines.next().unwrap().starts_with("0,\"upper, \"\"left\"\"\",0.5,2.0,"), "{text}");
    for wanted in ["# strain: green-lagrange", "tensor shear", "length scale of a strain: 16 px"] {
        assert!(text.contains(wanted), "'{wanted}' is missing in {text}");
    }
    let unknown = lines.next().unwrap().split(',').filter(|cell| cell.is_empty()).count();
    assert_eq!(unknown, 8, "the strain of node 1 is not known: {text}");
    // Without strains there are no such columns, and the same lines but for them.
    let mut out = Vec::new();
    write_displacements(&mut out, &[], &two_zones(), None, None).unwrap();
    let plain = String::from_utf8(out).unwrap();
    assert!(plain.contains("sigma_uy_px\n") && !plain.contains("strain"), "{plain}");
    assert!(read_displacements(plain.as_bytes()).unwrap().iter().all(|row| row.strain.is_none()));
}

#[test]
fn a_table_and_a_grid_carry_the_model_error_where_it_is_known() {
    let mut field = two_zones();
    let [n, n_elements] = [field.mesh.n_nodes(), field.mesh.n_elements()];
    let nodes: Vec<[f64; 2]> = (0..n).map(|k| [0.5 / (k + 1) as f64, 0.25]).collect();
    field.model_error = Some(ModelError { nodes: nodes.clone(), misfit: vec![0.5; n_elements] });
    for (strains, pixel_size) in [(None, None), (Some(strains()), PixelSize::new(0.002))] {
        let mut out = Vec::new();
        let plane = pixel_size.map(|size| (size, &field));
        write_displacements(&mut out, &[], &field, strains.as_ref(), plane).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert!(text.contains(",model_error_ux_px,model_error_uy_px\n"), "{text}");
        for row in read_displacements(text.as_bytes()).unwrap() {
            assert_eq!(row.model_error_px.unwrap().map(|v| v as f32), nodes[row.node].map(|v| v as f32));
            assert_eq!((row.mm.is_some(), row.px.position), (pixel_size.is_some(), field.mesh.nodes()[row.node]));
        }
    }
    let mut out = Vec::new();
    write_vtu(&mut out, "", &field, None, 255.0).unwrap();
    let text = String::from_utf8(out).unwrap();
    assert!(text.contains("model_error_px") && text.contains("misfit_px"), "{text}");
    let mut out = Vec::new();
    write_vtu(&mut out, "", &two_zones(), None, 255.0).unwrap();
    assert!(!String::from_utf8(out).unwrap().contains("model_error_px"));
}

#[test]
fn a_table_and_a_grid_carry_what_windows_flatten_beside_their_sigma_where_it_is_known() {
    let mut field = two_zones();
    field.measured.fill(true);
    let windows = StrainWindows::new(&field.mesh, StrainWindow::new(3).unwrap(), false);
    let mut known = windows.of(&field, StrainDefinition::GreenLagrange);
    let errors: Vec<[f64; 3]> = (0..known.nodes.len()).map(|k| [1e-4 * k as f64, 2e-4, 3e-4]).collect();
    known.model_error = Some(errors.clone());
    let unknown = WindowStrains { model_error: None, ..known.clone() };
    let written = |window: &WindowStrains| {
        let strains = StrainField { window: Some(window.clone()), ..StrainField::of(&field, StrainDefinition::Hencky) };
        let (mut table, mut grid) = (Vec::new(), Vec::new());
        write_displacements(&mut table, &[], &field, Some(&strains), None).unwrap();
        write_vtu(&mut grid, "", &field, Some(&strains), 255.0).unwrap();
        [table, grid].map(|bytes| String::from_utf8(bytes).unwrap())
    };
    let [table, grid] = written(&known);
    assert!(table.contains(",sigma_exy_window,model_error_exx_window,model_error_eyy_window,model_error_exy_window"));
    assert!(grid.contains("model_error_strain_window"));
    for row in read_displacements(table.as_bytes()).unwrap() {
        let want = known.nodes[row.node].map(|_| errors[row.node].map(|v| v as f32));
        assert_eq!(row.window_model_error.map(|error| error.map(|v| v as f32)), want);
    }
    let [table, grid] = written(&unknown);
    assert!(!table.contains("model_error_exx") && !grid.contains("model_error_strain_window"));
    let rows = read_displacements(table.as_bytes()).unwrap();
    assert!(
        rows.iter().all(|row| row.window_model_error.is_none()) && rows.iter().any(|row| row.window_strain.is_some())
    );
}

#[test]
fn a_table_and_a_grid_carry_values_at_points_beside_the_coefficients_where_they_are_known() {
    let mut field = two_zones();
    let n = field.mesh.n_nodes();
    let displacement: Vec<[f64; 2]> = (0..n).map(|k| [0.1 + k as f64 / 3.0, -1e-7 * k as f64]).collect();
    let is_value: Vec<bool> = (0..n).map(|k| k % 4 != 1).collect();
    let sigma = vec![[0.003, 0.25]; n];
    field.points = Some(PointField { displacement: displacement.clone(), sigma, is_value: is_value.clone() });
    let mut out = Vec::new();
    let plane = PixelSize::new(0.5).map(|size| (size, &field));
    write_displacements(&mut out, &[], &field, Some(&strains()), plane).unwrap();
    let text = String::from_utf8(out).unwrap();
    assert!(text.contains(",ux_point_px,uy_point_px,sigma_ux_point_px,sigma_uy_point_px,is_point_value\n"), "{text}");
    let rows = read_displacements(text.as_bytes()).unwrap();
    for row in &rows {
        let point = row.point_px.unwrap();
        assert_eq!((point.displacement, point.is_value), (displacement[row.node], is_value[row.node]));
        assert_eq!(point.sigma.map(|v| v as f32), [0.003, 0.25]);
        assert_eq!(row.px.displacement, field.displacement[row.node]);
    }
    assert_eq!(rows.len(), field.measured.iter().filter(|&&measured| measured).count());
    let mut out = Vec::new();
    write_vtu(&mut out, "frame 3", &field, None, 200.0).unwrap();
    let text = String::from_utf8(out).unwrap();
    for name in ["displacement_px", "displacement_point_px", "sigma_point_px", "is_point_value"] {
        assert!(text.contains(&format!("Name=\"{name}\"")), "{name}");
    }
    let rows = read_displacements(table(&[], None).as_bytes()).unwrap();
    assert!(rows.iter().all(|row| row.point_px.is_none()));
}

#[test]
fn a_damaged_table_is_refused_with_the_line_and_column() {
    let text = table(&["one".into()], None);
    let names = text.lines().position(|line| line.starts_with("node")).unwrap() as u64 + 1;
    let read = |text: &str| read_displacements(text.as_bytes()).unwrap_err();
    let error = read(&text.replacen(",0.5,", ",half,", 1));
    assert!(
        matches!(&error, CsvError::Number { line, column: "x_px", text } if *line == names + 1 && text == "half"),
        "{error:?}"
    );
    assert!(matches!(read(&text.replacen(",0.5,", ",NaN,", 1)), CsvError::Number { .. }));
    assert!(matches!(read(&text.replacen("\n0,", "\n-1,", 1)), CsvError::Number { column: "node", .. }));
    assert!(matches!(read(&text.replacen("uy_px", "uy", 1)), CsvError::MissingColumn { name: "uy_px" }));
    assert!(matches!(read(""), CsvError::MissingColumn { name: "node" }));
    let cut = &text[..text.rfind(',').unwrap()];
    let last = text.lines().count() as u64;
    assert!(matches!(read(cut), CsvError::Row { line, .. } if line == last), "{:?}", read(cut));
    struct Broken;
    impl io::Read for Broken {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            Err(io::Error::other("unplugged"))
        }
    }
    assert!(matches!(read_displacements(Broken).unwrap_err(), CsvError::Read(_)));
}

/// A disk with room for `room` bytes.
struct Disk {
    room: usize,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = bytes.len().min(self.room);
        self.room -= written;
        if written == 0 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(written) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_an_error_however_late_it_fills() {
    let measurement = two_zones();
    let mut vtu = Vec::new();
    write_vtu(&mut vtu, "", &measurement, Some(&strains()), 255.0).unwrap();
    for room in [0, 100, vtu.len() - 1] {
        let error = write_vtu(Disk { room }, "", &measurement, Some(&strains()), 255.0).unwrap_err();
        assert!(matches!(error, VtkError::Write(_)), "{room}: {error:?}");
    }
    let bytes = table(&[], None).len();
    for room in [0, 100, bytes - 1] {
        let error = write_displacements(Disk { room }, &[], &measurement, Some(&strains()), None).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull, "{room}");
    }
}

#[test]
fn residuals_in_per_cent_of_nothing_are_refused() {
    for range in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = write_vtu(Vec::new(), "", &two_zones(), None, range).unwrap_err();
        assert!(matches!(error, VtkError::DynamicRange { .. }), "{range}");
    }
}

#[test]
fn the_head_of_a_grid_names_status_units_and_zones() {
    let mut out = Vec::new();
    write_vtu(&mut out, "frame 3 --- of\u{1}7 -->", &two_zones(), Some(&strains()), 255.0).unwrap();
    let text = String::from_utf8(out).unwrap();
    let (start, end) = (text.find("<!--").unwrap() + 4, text.find("-->").unwrap());
    let head = &text[start..end];
    assert!(!head.contains("--") && !head.contains('\u{1}'), "{head}");
    for wanted in [
        "frame 3 - - - of 7",
        "status: iteration_limit",
        "y down",
        "1 = lower - - ü <&>",
        "of 255 grey levels",
        "strain: green-lagrange",
    ] {
        assert!(head.contains(wanted), "'{wanted}' is missing in {head}");
    }
    assert!(text[end..].starts_with("-->\n<VTKFile"));
}

#[test]
fn a_series_lists_times_and_files() {
    let mut out = Vec::new();
    write_pvd(&mut out, &[(0.0, "vtu/a.vtu".into()), (2.5, "vtu/\"b\" & <c>.vtu".into())]).unwrap();
    let text = String::from_utf8(out).unwrap();
    assert!(text.contains(r#"<DataSet timestep="0.0" part="0" file="vtu/a.vtu"/>"#), "{text}");
    assert!(text.contains(r#"timestep="2.5" part="0" file="vtu/&quot;b&quot; &amp; &lt;c&gt;.vtu""#), "{text}");
}

/// The Python to read with; `None`, after saying so, when meshio is not there and nobody asked for it.
fn python(script: &Path) -> Option<String> {
    let asked = std::env::var("QUADRILLE_PYTHON").ok();
    let python = asked.clone().unwrap_or_else(|| "python3".into());
    let available = Command::new(&python).arg(script).arg("--available").output();
    match available {
        Ok(output) if output.status.success() => return Some(python),
        Ok(output) => println!("{python}: {}", String::from_utf8_lossy(&output.stderr)),
        Err(error) => println!("{python}: {error}"),
    }
    assert!(asked.is_none(), "QUADRILLE_PYTHON is '{python}', which cannot import meshio");
    println!("SKIPPED: no meshio in {python}; pip install -r scripts/requirements.txt and set QUADRILLE_PYTHON");
    None
}

#[test]
fn a_grid_reads_back_in_meshio_to_the_same_bits() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/check_vtu.py");
    let Some(python) = python(&script) else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.vtu");
    let measurement = two_zones();
    write_vtu(std::fs::File::create(&path).unwrap(), "frame 3", &measurement, Some(&strains()), 255.0).unwrap();
    let output = Command::new(python).arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();

    let mesh = &measurement.mesh;
    let bits = |values: &[f64]| json!(values.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
    let short_bits = |values: &[f64]| json!(values.iter().map(|&v| (v as f32).to_bits()).collect::<Vec<_>>());
    let spatial =
        |pairs: &[[f64; 2]]| json!(pairs.iter().map(|v| [v[0], v[1], 0.0].map(f64::to_bits)).collect::<Vec<_>>());
    let kept = |pairs: &[[f64; 2]]| -> Vec<[f64; 2]> {
        let all = pairs.iter().zip(&measurement.measured);
        all.map(|(&v, &measured)| if measured { v } else { [0.0; 2] }).collect()
    };
    let short_spatial = |pairs: Vec<[f64; 2]>| {
        json!(pairs.iter().map(|v| [v[0], v[1], 0.0].map(|v| (v as f32).to_bits())).collect::<Vec<_>>())
    };
    let strain_bits = |strains: &[Option<TensorStrain>]| {
        let of = |strain: &Option<TensorStrain>| {
            strain.map_or([f32::NAN; 3], |strain| strain.components().map(|e| e as f32))
        };
        json!(strains.iter().map(|strain| of(strain).map(f32::to_bits)).collect::<Vec<_>>())
    };
    assert_eq!(read["cell_type"], "quad");
    assert_eq!(read["points"], spatial(mesh.nodes()));
    assert_eq!(read["cells"], json!(mesh.elements()));
    assert_eq!(read["type_of_cells"], "int64"); // meshio makes unsigned ones float64, no longer an index
    let (point, cell) = (&read["point_data"], &read["cell_data"]);
    assert_eq!(point["displacement_px"], spatial(&kept(&measurement.displacement)));
    assert_eq!(point["sigma_px"], short_spatial(kept(&measurement.sigma)));
    assert_eq!(point["strain_node"], strain_bits(&strains().nodes));
    let larger = |strain: &Option<TensorStrain>| {
        let e1 = |e: &TensorStrain| 0.5 * (e.xx + e.yy) + (0.25 * (e.xx - e.yy).powi(2) + e.xy * e.xy).sqrt();
        (strain.as_ref().map_or(f64::NAN, e1) as f32).to_bits()
    };
    let near = |(a, b): (&serde_json::Value, u32)| a.as_u64().unwrap().abs_diff(u64::from(b)) <= 1;
    let written = point["e1"].as_array().unwrap();
    assert!(written.iter().zip(strains().nodes.iter().map(larger)).all(near), "{written:?}");
    assert_eq!(cell["strain_element"], strain_bits(&strains().elements));
    assert_eq!(point["measured"], json!(measurement.measured.iter().map(|&m| u8::from(m)).collect::<Vec<_>>()));
    assert_eq!(read["type_of_measured"], "uint8");
    // What is not measured is hidden, nodes by bit 1 and elements by bit 5.
    let hidden: Vec<u8> = measurement.measured.iter().map(|&measured| if measured { 0 } else { 2 }).collect();
    assert!(hidden.contains(&2));
    assert_eq!(point["vtkGhostType"], json!(hidden));
    let has_all = |nodes: &[u32; 4]| nodes.iter().all(|&node| measurement.measured[node as usize]);
    let hidden: Vec<u8> = mesh.elements().iter().map(|nodes| if has_all(nodes) { 0 } else { 32 }).collect();
    assert!(hidden.contains(&32) && hidden.contains(&0));
    assert_eq!(cell["vtkGhostType"], json!(hidden));
    if let Some(visible) = read.get("visible_in_vtk") {
        let n = hidden.iter().filter(|&&hidden| hidden == 0).count();
        assert_eq!(visible, &json!(n), "VTK draws as many elements as are measured");
    }
    let residual = measurement.element_residual.iter().map(|&r| f64::from(r as f32));
    let percent: Vec<f64> = residual.map(|r| 100.0 * r / 255.0).collect();
    assert_eq!(cell["residual_grey"], short_bits(&measurement.element_residual));
    assert_eq!(cell["residual_percent"], short_bits(&percent));
    assert_eq!(cell["zone"], json!(mesh.element_zone()));
    assert_eq!(read["field_data"]["converged"], json!([0]));
    assert_eq!(read["field_data"]["dynamic_range_grey"], bits(&[255.0]));
}
