//! Mesh files (Gmsh, VTU, JSON of a joint), laid over an image.
#![no_main]

use libfuzzer_sys::fuzz_target;
use quadrille::io::joint::read_joint_mesh;
use quadrille::io::mesh_file::parse_mesh;
use quadrille::mesh::{Mesh, Zone};
use quadrille_fuzz::with_file;

fuzz_target!(|data: &[u8]| {
    if data.first() == Some(&b'{') {
        with_file(data, "mesh.json", |path| drop(read_joint_mesh(path)));
    }
    let Ok(file) = parse_mesh(data, "mesh".as_ref()) else { return };
    if file.zones.iter().map(|zone| zone.elements.len()).sum::<usize>() > 1000 {
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
});
