//! Usual tests of adhesives: their builders, beam theory, a published curve, the path through a snap, and supports and
//! loads of case files.

use crate::common::data;
use crate::mechanics_common;
use mechanics_common::*;
use quadrille::io::joint::read_joint;
use quadrille::mechanics::cohesive::law_by_name;
use quadrille::mechanics::substrate::{LinearElastic, PlaneState, SubstrateLaw};
use quadrille::mechanics::{
    BoundaryHistory, Drives, FollowOptions, ForwardOptions, Joint, JointMesh, Model, ModelOptions, NodeGroup, PathEnd,
    Specimen, SpecimenKind, SpecimenOptions, Status, select_nodes,
};
use std::fs;
use std::sync::Arc;

const SUBSTRATE: &str = "[substrate]\nmodel = \"linear-elastic\"\nplane = \"strain\"\nE_MPa = 70000.0\nnu = 0.0\n";

/// The joint of a case file, or what is said of it.
fn joint(mesh: &str, case: &str) -> Result<Joint, String> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("mesh.json"), mesh).unwrap();
    fs::write(folder.path().join("case.toml"), case).unwrap();
    fs::write(folder.path().join("u.csv"), "# a test\nt_s,u_mm\n1,0.1\n2,0.3\n").unwrap();
    let input = read_joint(&folder.path().join("case.toml")).map_err(|error| error.to_string())?;
    Joint::new(&input).map_err(|error| error.to_string())
}

fn bilinear(k: f64, strength: f64, toughness: f64) -> String {
    format!(
        "[cohesive]\nmodel = \"bilinear-benzeggagh-kenane\"\nkinematics = \"objective\"\nK_MPa_per_mm = {k:?}\n\
         T_n0_MPa = {strength:?}\nT_t0_MPa = {strength:?}\nG_Ic_N_per_mm = {toughness:?}\nG_IIc_N_per_mm = {toughness:?}\neta = 1.0\n"
    )
}

/// The case of a specimen with another material and law.
fn with_law(specimen: &Specimen, law: &str) -> String {
    let at = specimen.case.find("[substrate]").unwrap();
    format!("{}{SUBSTRATE}{law}", &specimen.case[..at])
}

#[test]
fn the_arms_of_a_cantilever_bend_as_timoshenko_beams_on_an_elastic_foundation() {
    let (young, h, a, k) = (70_000.0_f64, 3.0_f64, 40.0_f64, 500.0_f64);
    let sizes = SpecimenOptions {
        crack: a,
        adhesive: 0.0,
        element: 0.25,
        opening: 1.0,
        instants: 1,
        ..SpecimenKind::Dcb.defaults()
    };
    let specimen = Specimen::new(SpecimenKind::Dcb, &sizes).unwrap();
    let joint = joint(&specimen.mesh_json(), &with_law(&specimen, &bilinear(k, 1e4, 1e7))).unwrap();
    let solution = joint.model.forward(&*joint.law, &joint.boundary, &ForwardOptions::default()).unwrap();
    let u = &solution.instants[0].displacement;
    let upper: Vec<NodeGroup> = joint.groups.iter().filter(|group| group.name == "upper_pin").cloned().collect();
    let force = joint.model.reactions(&*joint.law, u, &upper)[0][1];
    // An arm on springs of 2 k (the adhesive opens twice as much as it moves), a moment P a and a force P at the tip of
    // the crack; w = exp(-p x) (A cos q x + B sin q x) beyond it.
    let (bend, shear, springs) = (young * h.powi(3) / 12.0, 5.0 / 6.0 * 0.5 * young * h, 2.0 * k);
    let root = 0.5 * (springs / bend).sqrt();
    let (p, q) = ((root + springs / (4.0 * shear)).sqrt(), (root - springs / (4.0 * shear)).sqrt());
    let moment_and_force =
        |[w, d1, d2, d3]: [f64; 4]| [bend * (d2 - springs / shear * w), -bend * (d3 - springs / shear * d1)];
    let of_a = moment_and_force([1.0, -p, p * p - q * q, -p.powi(3) + 3.0 * p * q * q]);
    let of_b = moment_and_force([0.0, q, -2.0 * p * q, 3.0 * p * p * q - q.powi(3)]);
    let det = of_a[0] * of_b[1] - of_a[1] * of_b[0];
    let (ca, cb) = ((a * of_b[1] + of_b[0]) / det, (-of_a[0] - a * of_a[1]) / det);
    let slope = -p * ca + q * cb + 1.0 / shear;
    let wanted = ca - slope * a + a.powi(3) / (3.0 * bend) + a / shear;
    // Bilinear elements are too stiff in bending by half the square of their length over the thickness: 0.35 %; what is
    // left of 1 % is the arm's own compliance across, which the beam does not have.
    assert_close(0.5 / force, wanted, 0.006 * wanted, "deflection under a unit force");
    // Without the rotation of the root it is a tenth less: the comparison sees it.
    assert!(a.powi(3) / (3.0 * bend) < 0.9 * wanted);
}

#[test]
fn every_specimen_can_be_computed_at_once_and_bad_sizes_are_refused() {
    for kind in SpecimenKind::ALL {
        // As it comes, but coarse, and only its beginning.
        let sizes = kind.defaults();
        let few = SpecimenOptions {
            element: 4.0 * sizes.element,
            rows: 2,
            opening: 0.02 * sizes.opening,
            instants: 2,
            ..sizes
        };
        let specimen = Specimen::new(kind, &few).unwrap();
        let joint =
            joint(&specimen.mesh_json(), &specimen.case).unwrap_or_else(|error| panic!("{}: {error}", kind.name()));
        assert_eq!(joint.groups.len(), specimen.groups().len(), "{}", kind.name());
        let solution = joint.model.forward(&*joint.law, &joint.boundary, &ForwardOptions::default()).unwrap();
        assert!(solution.instants.iter().all(|instant| instant.status == Status::Converged), "{}", kind.name());
    }
    let refused = |kind: SpecimenKind, change: &dyn Fn(&mut SpecimenOptions)| {
        let mut sizes = kind.defaults();
        change(&mut sizes);
        Specimen::new(kind, &sizes).unwrap_err().to_string()
    };
    assert!(refused(SpecimenKind::Dcb, &|s| s.crack = 200.0).contains("leaves no adhesive"));
    assert!(refused(SpecimenKind::Enf, &|s| s.length = -1.0).contains("length = -1"));
    assert!(refused(SpecimenKind::Lap, &|s| s.element = 1e-5).contains("more than a million"));
    assert!(refused(SpecimenKind::Peel, &|s| s.rows = 0).contains("rows = 0"));
    assert!(refused(SpecimenKind::Mmb, &|s| s.adhesive = f64::NAN).contains("adhesive"));
}

/// Source of the curve: github roysondsouza316/diffcohesive, 86bf771 (MIT), Abaqus/Standard on the same mesh with the
/// same law.
#[test]
fn a_published_cantilever_by_abaqus_is_met_on_its_own_mesh() {
    let Some(folder) = data::folder("benchmarks") else { return };
    let text = fs::read_to_string(folder.join("abaqus_dcb_static.csv")).unwrap();
    let curve: Vec<[f64; 2]> = (text.lines().skip(2))
        .map(|line| line.split_once(',').unwrap())
        .map(|(u, force)| [u.parse().unwrap(), force.parse().unwrap()])
        .collect();
    let mut nodes: Vec<[f64; 2]> = Vec::new();
    let mut quads: Vec<[u32; 4]> = Vec::new();
    for arm in 0..2 {
        for row in 0..5 {
            nodes.extend((0..31).map(|k| [0.5 * f64::from(k), f64::from(arm) + 0.25 * f64::from(row)]));
        }
        for cell in (0..4).flat_map(|row| (0..30).map(move |k| 155 * arm as u32 + 31 * row + k)) {
            let (a, b, c, d) = (cell, cell + 1, cell + 32, cell + 31);
            quads.extend([[a, b, c, c], [a, c, d, d]]);
        }
    }
    let faces: Vec<[u32; 4]> = (10..30).map(|k| [124 + k, 125 + k, 155 + k, 156 + k]).collect();
    let mesh = serde_json::json!({ "nodes": nodes, "quads": quads, "cohesive": faces }).to_string();
    let half = |sign: f64| curve.iter().map(|[u, _]| format!("{:?}", 0.5 * sign * u)).collect::<Vec<_>>().join(", ");
    let case = format!(
        "[mesh]\nfile = \"mesh.json\"\n[groups]\nend = \"x = max\"\nupper = \"x = 0 and y = max\"\nlower = \"x = 0 and y = min\"\n\
         [[support]]\ngroup = \"end\"\nu_x_mm = 0\nu_y_mm = 0\n[[support]]\ngroup = \"upper\"\nu_y_mm = [{}]\n\
         [[support]]\ngroup = \"lower\"\nu_y_mm = [{}]\n\
         [substrate]\nmodel = \"linear-elastic\"\nplane = \"strain\"\nE_MPa = 1000\nnu = 0.3\n{}",
        half(1.0),
        half(-1.0),
        bilinear(1e4, 5.0, 0.05)
    );
    let joint = joint(&mesh, &case).unwrap();
    let solution = joint.model.forward(&*joint.law, &joint.boundary, &ForwardOptions::default()).unwrap();
    assert!(solution.converged());
    let upper: Vec<NodeGroup> = joint.groups.iter().filter(|group| group.name == "upper").cloned().collect();
    let forces: Vec<f64> = (solution.instants.iter())
        .map(|instant| joint.model.reactions(&*joint.law, &instant.displacement, &upper)[0][1])
        .collect();
    let top = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let peak = top(&mut curve.iter().map(|[_, force]| *force));
    assert_close(top(&mut forces.iter().copied()), peak, 0.02 * peak, "peak");
    let before = curve.iter().position(|[_, force]| *force == peak).unwrap();
    for ([u, wanted], force) in curve.iter().zip(&forces).take(before) {
        assert_close(*force, *wanted, 0.005 * wanted, format!("force at {u} mm"));
    }
}

/// Two soft strips and a brittle adhesive: the load falls faster than the strips can give back.
fn brittle() -> (Model, BoundaryHistory) {
    let mesh = JointMesh::rectangular(2, 10, 1.0, 0.01).unwrap();
    let held = |text: &str, c: usize, to: f64| {
        let name = text.to_owned();
        select_nodes(text, &mesh)
            .unwrap()
            .into_iter()
            .map(move |node| (node, c, vec![to], name.clone()))
            .collect::<Vec<_>>()
    };
    let supports =
        [held("y = min", 0, 0.0), held("y = min", 1, 0.0), held("y = max", 0, 0.0), held("y = max", 1, 1.0)].concat();
    let boundary = BoundaryHistory::of_drives(&Drives { supports, ..Drives::default() }, 1).unwrap();
    let soft: Arc<dyn SubstrateLaw> = Arc::new(LinearElastic::new(100.0, 0.0, PlaneState::PlaneStress).unwrap());
    let materials = vec![Arc::clone(&soft), soft];
    let model = Model::supported(mesh, materials, boundary.supports(), ModelOptions::default()).unwrap();
    (model, boundary)
}

#[test]
fn the_path_through_a_snap_goes_back_and_gives_the_work_of_separation() {
    let (model, boundary) = brittle();
    let law = law_by_name("smith-ferrante", &[0.2, 0.02, 1.0]).unwrap();
    let how = FollowOptions { step: 0.01, ..FollowOptions::default() };
    let path = model.follow(&*law, &boundary, &ForwardOptions::default(), &how, &|_| true).unwrap();
    assert_eq!(path.end, PathEnd::Last);
    let top = NodeGroup::new("top", select_nodes("y = max", model.mesh()).unwrap());
    let points: Vec<[f64; 2]> = (path.solution.instants.iter().zip(&path.times))
        .map(|(instant, &time)| {
            let force = model.reactions(&*law, &instant.displacement, std::slice::from_ref(&top))[0][1];
            [time, force]
        })
        .collect();
    // One bar: the elongation of both strips under the traction, and the opening with it.
    for (instant, &[time, force]) in path.solution.instants.iter().zip(&points) {
        let (traction, opening) = (force / 2.0, model.jumps(&instant.displacement)[1].normal);
        let wanted = law.response(quadrille::mechanics::cohesive::Jump { normal: opening, tangential: 0.0 }).traction;
        assert_close(traction, wanted.normal, 1e-8 * 3.7, "traction");
        assert_close(time, 20.0 * traction / 100.0 + opening, 1e-8, "elongation");
    }
    let back = points.windows(2).filter(|pair| pair[1][0] < pair[0][0]).count();
    assert!(back > 10, "{back} of {} points", points.len());
    // The area under the curve: what is left at the end is less than 1e-6 of it.
    let mut last = [0.0; 2];
    let mut area = 0.0;
    for &[u, force] in &points {
        area += 0.5 * (last[1] + force) * (u - last[0]);
        last = [u, force];
    }
    // Trapezoids over steps of a hundredth of the opening of five delta_c: 1e-3.
    assert_close(area, 0.2 * 2.0, 2e-3 * 0.4, "work of separation");
    // The same history from instant to instant snaps, and ends in the same place.
    let jumped = model.forward(&*law, &boundary, &ForwardOptions::default()).unwrap();
    assert_eq!(jumped.instants[0].status, Status::Rescued);
    let end = &path.solution.instants.last().unwrap().displacement;
    assert!(difference(end, &jumped.instants[0].displacement) < 1e-8);
}

#[test]
fn a_path_without_a_snap_passes_the_solutions_from_instant_to_instant() {
    let (model, boundary) = brittle();
    // Tough enough that nothing goes back.
    let law = law_by_name("smith-ferrante", &[4.0, 0.4, 1.0]).unwrap();
    let path =
        model.follow(&*law, &boundary, &ForwardOptions::default(), &FollowOptions::default(), &|_| true).unwrap();
    assert!(path.end == PathEnd::Last && path.times.windows(2).all(|pair| pair[0] < pair[1]), "{:?}", path.times);
    let same = model.forward(&*law, &path.boundary, &ForwardOptions::default()).unwrap();
    for (a, b) in path.solution.instants.iter().zip(&same.instants) {
        assert!(difference(&a.displacement, &b.displacement) < 1e-9, "{:?}", b.status);
    }
}

#[test]
fn supports_and_loads_of_a_case_are_read_with_their_lists_columns_and_groups() {
    let head = "[mesh]\nelement_size_mm = 0.5\ncolumns = 8\nrows = 2\ngap_mm = 0.1\n[groups]\nwall = \"x = 0\"\ntip = [53]\n\
                top = \"y = max and x > 1.9\"\n";
    let law = format!("{SUBSTRATE}{}", bilinear(1e4, 20.0, 0.5));
    let wall = "[[support]]\ngroup = \"wall\"\nu_x_mm = 0\nu_y_mm = 0\n";
    let said = |drives: &str| joint("", &format!("{head}{drives}{law}"));
    let made = said(&format!(
        "{wall}[[support]]\ngroup = \"tip\"\nu_y_mm = {{ file = \"u.csv\", column = \"u_mm\", factor = 2 }}\n\
         [[applied_load]]\ngroup = \"top\"\nT_y_MPa = [1, 2]\n"
    ))
    .unwrap();
    assert_eq!(made.boundary.instants().len(), 2);
    let tip = made.boundary.nodes().iter().position(|&node| node == 53).unwrap();
    assert_eq!(made.boundary.instants().iter().map(|u| u[tip]).collect::<Vec<_>>(), [[0.0, 0.2], [0.0, 0.6]]);
    // Two millimetres of border under 2 MPa.
    let total: f64 = made.boundary.forces(1).iter().map(|force| force[1]).sum();
    assert_close(total, 4.0, 1e-12, "load");
    let refused = |drives: &str, words: &[&str]| {
        let message = said(drives).map(|_| ()).unwrap_err();
        words.iter().for_each(|word| assert!(message.contains(word), "'{word}' in: {message}"));
        assert_eq!(message.lines().count(), 1, "{message}");
    };
    refused("", &["[boundary] is missing", "[[support]]"]);
    refused("[[support]]\ngroup = \"tip\"\nu_y_mm = 0\n", &["body with node 0", "freely"]);
    refused(&wall.replace("wall", "well"), &["well", "\"wall\"", "\"tip\""]);
    refused(&format!("{wall}[[support]]\ngroup = \"tip\"\n"), &["tip", "u_x_mm or u_y_mm"]);
    refused(
        &format!("{wall}[[support]]\ngroup = \"tip\"\nu_y_mm = [1, 2]\n[[support]]\ngroup = \"top\"\nu_y_mm = [1]\n"),
        &["top", "1 instants", "2"],
    );
    refused(
        &format!("{wall}[[support]]\ngroup = \"top\"\nu_y_mm = 1\n[[support]]\ngroup = \"tip\"\nu_y_mm = 2\n"),
        &["node 53", "\"top\"", "\"tip\"", "1 mm", "2 mm"],
    );
    refused(&format!("{wall}[[applied_load]]\ngroup = \"tip\"\n"), &["tip", "F_x_N_per_mm"]);
    refused(&format!("{wall}[[applied_load]]\ngroup = \"tip\"\nT_x_MPa = 1\n"), &["tip", "no edge"]);
    refused(&format!("{wall}[[support]]\ngroup = \"tip\"\nu_y_mm = {{ to = 1 }}\n"), &["u_y_mm", "instants = 40"]);
    let column = "u_y_mm = { file = \"u.csv\", column = \"v_mm\" }";
    refused(&format!("{wall}[[support]]\ngroup = \"tip\"\n{column}\n"), &["v_mm", "u_mm"]);
    let empty = head.replace("x > 1.9", "x > 99");
    let message = joint("", &format!("{empty}{wall}[[support]]\ngroup = \"top\"\nu_y_mm = 1\n{law}")).unwrap_err();
    assert!(message.contains("top") && message.contains("no node"), "{message}");
    let crack = head.replace("gap_mm = 0.1\n", "gap_mm = 0.1\ncrack = \"x > 99\"\n");
    let message = joint("", &format!("{crack}{wall}{law}")).unwrap_err();
    assert!(message.contains("crack") && message.contains("no interface element"), "{message}");
}
