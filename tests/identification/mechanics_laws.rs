//! The laws of the adhesive and of the strips: against 50-digit numbers of an independent program, and every
//! derivative against differences.

use crate::mechanics_common;
use mechanics_common::{assert_close, five_points, get, numbers, reference, table};
use quadrille::mechanics::cohesive::{
    Bilinear, CohesiveLaw, ExponentialDamage, ExtendedXuNeedleman, Jump, LAW_NAMES, LawError, MixedModeCriterion,
    ParkPaulinoRoesler, SmithFerrante, Traction, Trapezoidal, XuNeedleman, law_by_name, parameters_by_name,
};
use quadrille::mechanics::substrate::{
    EngineeringStrain, LinearElastic, Orthotropic, PlaneState, RambergOsgood, SUBSTRATE_NAMES, Stress, SubstrateError,
    SubstrateLaw, Tabulated, substrate_by_name, substrate_parameters,
};

fn cohesive_laws() -> Vec<Box<dyn CohesiveLaw>> {
    let bilinear = [4e5, 60.0, 90.0, 0.4, 1.1, 1.7];
    let trapezoidal = |s: f64| [4e5, 60.0, 90.0, 0.4, 1.1, 1.7, s];
    vec![
        Box::new(ExtendedXuNeedleman::new(1.0, 0.005, 0.05, 4.0).unwrap()),
        Box::new(ExtendedXuNeedleman::new(2.45, 0.0085, 0.085, 1.0).unwrap()),
        Box::new(XuNeedleman::new(1.0, 0.005, 0.02, 0.7, 0.2).unwrap()),
        Box::new(XuNeedleman::new(1.3, 0.004, 0.03, 2.5, 0.0).unwrap()),
        Box::new(Bilinear::new(MixedModeCriterion::BenzeggaghKenane, bilinear).unwrap()),
        Box::new(Bilinear::new(MixedModeCriterion::Power, bilinear).unwrap()),
        Box::new(Trapezoidal::new(MixedModeCriterion::BenzeggaghKenane, trapezoidal(0.4)).unwrap()),
        Box::new(Trapezoidal::new(MixedModeCriterion::Power, trapezoidal(0.0)).unwrap()),
        Box::new(ParkPaulinoRoesler::new([0.4, 1.1, 60.0, 90.0, 3.0, 2.4, 0.02, 0.05]).unwrap()),
        Box::new(ParkPaulinoRoesler::new([1.1, 0.4, 60.0, 30.0, 2.1, 5.0, 0.1, 0.01]).unwrap()),
        Box::new(SmithFerrante::new([0.8, 0.004, 0.3]).unwrap()),
        Box::new(ExponentialDamage::new([0.8, 0.004, 0.3]).unwrap()),
    ]
}

fn substrate_laws() -> Vec<Box<dyn SubstrateLaw>> {
    let mut laws: Vec<Box<dyn SubstrateLaw>> = Vec::new();
    for plane in [PlaneState::PlaneStress, PlaneState::PlaneStrain] {
        laws.push(Box::new(LinearElastic::new(72000.0, 0.33, plane).unwrap()));
        for values in [[72000.0, 0.33, 180.0, 0.06, 7.0], [2e5, 0.3, 300.0, 0.3, 4.5], [2e5, 0.3, 300.0, 0.3, 2.5]] {
            laws.push(Box::new(RambergOsgood::new(values, plane).unwrap()));
        }
        laws.push(Box::new(laminate(30.0, plane)));
        laws.push(Box::new(Tabulated::new([72000.0, 0.33, 1.1], &CURVE, plane).unwrap()));
    }
    laws
}

/// Carbon fibres at `angle` degrees.
fn laminate(angle: f64, plane: PlaneState) -> Orthotropic {
    let values = [140e3, 10e3, 0.3, 5e3, angle, 9e3, 0.25, 0.4];
    Orthotropic::new(&values[..if plane == PlaneState::PlaneStress { 5 } else { 8 }], plane).unwrap()
}

/// Strain and stress (MPa) of an aluminium: elastic up to 150 MPa.
const CURVE: [[f64; 2]; 7] = [
    [0.0, 0.0],
    [100.0 / 72e3, 100.0],
    [150.0 / 72e3, 150.0],
    [0.004, 200.0],
    [0.02, 260.0],
    [0.06, 310.0],
    [0.12, 340.0],
];

#[test]
fn an_orthotropic_material_turns_with_its_axes_and_is_isotropic_where_its_moduli_are() {
    for plane in [PlaneState::PlaneStress, PlaneState::PlaneStrain] {
        // The strain turned by 25 degrees meets the material turned by as much with the stress turned by as much.
        let (sin, cos) = 25.0_f64.to_radians().sin_cos();
        let turn = |[x, y, shear]: [f64; 3]| {
            [
                cos * cos * x + sin * sin * y - 2.0 * sin * cos * shear,
                sin * sin * x + cos * cos * y + 2.0 * sin * cos * shear,
                sin * cos * (x - y) + (cos * cos - sin * sin) * shear,
            ]
        };
        for strain in STRAINS {
            let straight = laminate(10.0, plane).stress(engineering(strain)).0;
            let [x, y, half] = turn([strain[0], strain[1], 0.5 * strain[2]]);
            let found = laminate(35.0, plane).stress(engineering([x, y, 2.0 * half])).0;
            for (found, wanted) in found.into_iter().zip(turn(straight)) {
                assert_close(found, wanted, 1e-13 * 140e3, format!("{plane:?} {strain:?}"));
            }
            let isotropic = LinearElastic::new(72e3, 0.33, plane).unwrap();
            let shear = 72e3 / (2.0 * 1.33);
            let values = [72e3, 72e3, 0.33, shear, 17.0, 72e3, 0.33, 0.33];
            let n = if plane == PlaneState::PlaneStress { 5 } else { 8 };
            let alike = Orthotropic::new(&values[..n], plane).unwrap();
            let (found, wanted) = (alike.stress(engineering(strain)).0, isotropic.stress(engineering(strain)).0);
            (0..3).for_each(|k| assert_close(found[k], wanted[k], 1e-12 * 72e3 * 0.1, "isotropic"));
            let (found, wanted) = (alike.state(engineering(strain)), isotropic.state(engineering(strain)));
            let (found, wanted) = (found.equivalent_stress, wanted.equivalent_stress);
            assert_close(found, wanted, 1e-10 * wanted.max(1.0), "equivalent stress");
        }
        // Along its fibres it is what its constants say: uniaxial stress.
        let law = laminate(0.0, PlaneState::PlaneStress);
        let Stress(stress) = law.stress(engineering([1e-3, -0.3e-3, 0.0]));
        assert_close(stress[0], 140.0, 1e-10, "along");
        assert_close(stress[1], 0.0, 1e-10, "across");
    }
}

#[test]
fn a_tabulated_material_follows_its_table_in_uniaxial_tension() {
    let law = Tabulated::new([72000.0, 0.33, 1.0], &CURVE, PlaneState::PlaneStress).unwrap();
    for [strain, stress] in &CURVE[1..] {
        // The lateral strain of uniaxial tension: elastic by nu, plastic by a half.
        let lateral = -0.33 * stress / 72e3 - 0.5 * (strain - stress / 72e3);
        let Stress([x, y, _]) = law.stress(engineering([*strain, lateral, 0.0]));
        assert_close(x, *stress, 1e-8 * stress, "along");
        assert_close(y, 0.0, 1e-8 * stress, "across");
        let state = law.state(engineering([*strain, lateral, 0.0]));
        assert_close(state.plastic_strain, strain - stress / 72e3, 1e-10, "plastic strain");
    }
    // A table of the law of Ramberg and Osgood is that law, but for what lies between its rows.
    let wanted = RambergOsgood::new([72000.0, 0.33, 180.0, 0.06, 7.0], PlaneState::PlaneStrain).unwrap();
    let row = |k: u32| {
        let q = 2.5 * f64::from(k);
        [q / 72e3 + 0.06 * 180.0 / 72e3 * (q / 180.0).powi(7), q]
    };
    let curve: Vec<[f64; 2]> = (1..=160).map(row).collect();
    let found = Tabulated::new([72000.0, 0.33, 1.0], &curve, PlaneState::PlaneStrain).unwrap();
    for strain in &STRAINS[..5] {
        let (a, b) = (found.stress(engineering(*strain)).0, wanted.stress(engineering(*strain)).0);
        (0..3).for_each(|k| assert_close(a[k], b[k], 0.05, format!("{strain:?}")));
    }
    assert!((found.yield_strain().unwrap() - 2.5 / 72e3).abs() < 1e-3 && found.known_up_to().unwrap() > 0.03);
}

#[test]
fn what_no_material_is_is_refused_by_name() {
    let key = |result: Result<Orthotropic, SubstrateError>| match result {
        Err(SubstrateError::Parameter { key, .. }) => key,
        other => panic!("{other:?}"),
    };
    let with = |k: usize, value: f64| {
        let mut values = [140e3, 10e3, 0.3, 5e3, 30.0, 9e3, 0.25, 0.4];
        values[k] = value;
        key(Orthotropic::new(&values, PlaneState::PlaneStrain))
    };
    assert_eq!(with(0, -1.0), "E_1_MPa");
    assert_eq!(with(1, 0.0), "E_2_MPa");
    assert_eq!(with(2, 3.8), "nu_12");
    assert_eq!(with(3, f64::NAN), "G_12_MPa");
    assert_eq!(with(4, f64::INFINITY), "angle_deg");
    assert_eq!(with(6, 4.0), "nu_13");
    assert_eq!(with(7, 1.1), "nu_23");
    let count = Orthotropic::new(&[1.0; 5], PlaneState::PlaneStrain);
    assert!(matches!(count, Err(SubstrateError::Count { needed: 8, given: 5, .. })));
    let curve = |rows: &[[f64; 2]]| match Tabulated::new([72e3, 0.33, 1.0], rows, PlaneState::PlaneStress) {
        Err(SubstrateError::Curve { what }) => what,
        other => panic!("{other:?}"),
    };
    assert!(curve(&[[0.001, 72.0]]).contains("two or more"));
    assert!(
        curve(&[[0.002, 140.0], [0.004, 140.0]]).contains("row 2")
            && curve(&[[0.002, 140.0], [0.001, 150.0]]).contains("rise")
    );
    assert!(curve(&[[0.001, 150.0], [0.002, 160.0]]).contains("give the E of the curve"));
    assert!(curve(&[[0.2, 140.0], [4.0, 200.0]]).contains("not in %"));
}

/// Jumps in every branch, none within a step of a difference from a kink (D_n = 0).
const JUMPS: [Jump; 12] = {
    const fn jump(normal: f64, tangential: f64) -> Jump {
        Jump { normal, tangential }
    }
    [
        jump(5e-5, 0.0),
        jump(5e-5, 2e-5),
        jump(0.0004, -0.0002),
        jump(0.005, 0.01),
        jump(0.011, 0.03),
        jump(0.0142, -0.0171),
        jump(0.0021, 0.045),
        jump(0.03, 0.002),
        jump(0.2, 0.3),
        jump(-0.0004, 0.012),
        jump(-0.003, -0.0001),
        jump(-0.0007, 0.0),
    ]
};

/// Strains from elastic to strongly plastic, both signs, with shear and without.
const STRAINS: [[f64; 3]; 8] = [
    [1e-5, 0.0, 0.0],
    [0.001, -0.0003, 0.0005],
    [0.003, 0.0, 0.0],
    [-0.004, 0.002, 0.006],
    [0.02, -0.01, -0.005],
    [0.0, 0.0, 0.03],
    [0.01, 0.01, 0.0],
    [0.08, 0.03, 0.1],
];

fn engineering([xx, yy, gamma_xy]: [f64; 3]) -> EngineeringStrain {
    EngineeringStrain { xx, yy, gamma_xy }
}

fn both(traction: Traction) -> [f64; 2] {
    [traction.normal, traction.tangential]
}

#[test]
fn the_cohesive_law_has_the_values_of_the_reference() {
    let Some(file) = reference("cohesive_law.json") else { return };
    let sets = file["sets"].as_array().unwrap();
    let mut n = 0;
    for case in file["cases"].as_array().unwrap() {
        let set = &sets[case["set"].as_u64().unwrap() as usize];
        let [phi_n, delta_n, delta_t, r] = ["phin", "dn", "dt", "r"].map(|key| get(set, key));
        let law = ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r).unwrap();
        let jump = Jump { normal: get(case, "Dn"), tangential: get(case, "Dt") };
        let response = law.response(jump);
        let mut by = [Traction::default(); 4];
        law.by_parameters(jump, &mut by);
        // Where terms cancel: 1e-14 of the natural scale.
        let floor = 1e-14 * r * phi_n / (delta_t * delta_t);
        let check = |found: f64, wanted: f64, what: &str| {
            assert_close(found, wanted, (1e-13 * wanted.abs()).max(floor), format!("{what} at {jump:?} of {law:?}"));
        };
        let (traction, tangent, parameters) = (numbers(&case["T"]), table(&case["C"]), table(&case["P"]));
        for row in 0..2 {
            assert_close(
                both(response.traction)[row],
                traction[row],
                1e-13 * traction[row].abs(),
                format!("traction at {jump:?} of {law:?}"),
            );
            (0..2).for_each(|k| check(response.tangent[(row, k)], tangent[row][k], "tangent"));
            (0..4).for_each(|k| check(both(by[k])[row], parameters[row][k], "parameter derivative"));
        }
        n += 1;
    }
    assert!(n > 50, "only {n} cases");
}

#[test]
fn the_plasticity_has_the_values_of_the_reference() {
    let Some(file) = reference("ramberg_osgood.json") else { return };
    let sets = file["sets"].as_array().unwrap();
    for case in file["cases"].as_array().unwrap() {
        let set = &sets[case["set"].as_u64().unwrap() as usize];
        let values = ["E", "nu", "sigma0", "alpha", "n"].map(|key| get(set, key));
        let law = RambergOsgood::new(values, PlaneState::PlaneStress).unwrap();
        let strain = engineering(numbers(&case["strain"]).try_into().unwrap());
        let response = law.response(strain);
        assert_eq!(law.stress(strain), response.stress);
        let (stress, tangent) = (numbers(&case["stress"]), table(&case["D"]));
        // Relative to the largest entry: single ones cancel (pure shear has no sxx).
        let largest = stress.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let stiffest = tangent.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
        for row in 0..3 {
            assert_close(response.stress.0[row], stress[row], 1e-13 * largest, format!("stress at {strain:?}"));
            for k in 0..3 {
                let what = format!("tangent [{row}][{k}] at {strain:?} of {law:?}");
                assert_close(response.tangent[(row, k)], tangent[row][k], 1e-13 * stiffest, what);
            }
        }
        let q = get(case, "q");
        assert_close(law.state(strain).equivalent_stress, q, 1e-13 * q, format!("q at {strain:?}"));
    }
}

#[test]
fn every_cohesive_tangent_is_the_difference_of_its_traction() {
    for law in cohesive_laws() {
        for jump in JUMPS {
            let tangent = law.response(jump).tangent;
            let h = 1e-5 * (jump.normal.abs() + jump.tangential.abs());
            for row in 0..2 {
                let normal = |x| both(law.response(Jump { normal: x, ..jump }).traction)[row];
                let tangential = |x| both(law.response(Jump { tangential: x, ..jump }).traction)[row];
                let differences = [five_points(normal, jump.normal, h), five_points(tangential, jump.tangential, h)];
                for k in 0..2 {
                    // Round-off of a difference: eps |T|/h.
                    let peak = law.peak().normal.max(law.peak().tangential);
                    // The curvature of the PPR law changes its sign where there is no sliding: of first order in h over
                    // the steep rise.
                    let relative = if jump.tangential == 0.0 { 1e-3 } else { 1e-7 };
                    let tolerance = relative * tangent[(row, k)].abs() + 1e-15 * peak / h + 1e-9;
                    assert_close(
                        tangent[(row, k)],
                        differences[k],
                        tolerance,
                        format!("[{row}][{k}] {law:?} {jump:?}"),
                    );
                }
            }
        }
    }
}

#[test]
fn every_parameter_derivative_of_a_cohesive_law_is_the_difference_of_its_traction() {
    for law in cohesive_laws() {
        let values = law.values();
        for jump in JUMPS {
            let mut by = vec![Traction::default(); values.len()];
            law.by_parameters(jump, &mut by);
            for (k, &value) in values.iter().enumerate() {
                let h = 1e-5 * value.abs().max(0.01);
                // A parameter at the edge of its range (r* = 0) has differences on one side only: move away.
                if value - 2.0 * h < 0.0 {
                    continue;
                }
                for row in 0..2 {
                    let at = |x: f64| {
                        let mut values = values.clone();
                        values[k] = x;
                        both(law.with_values(&values).unwrap().response(jump).traction)[row]
                    };
                    let (found, wanted) = (both(by[k])[row], five_points(at, value, h));
                    // Round-off of the terms that cancel, as large as the elastic traction.
                    let stiffness = law.response(Jump::default()).tangent[(row, row)];
                    let elastic = stiffness * (jump.normal.abs() + jump.tangential.abs());
                    let tolerance = 1e-8 * wanted.abs() + 4e-16 * elastic / h + 1e-12;
                    assert_close(
                        found,
                        wanted,
                        tolerance,
                        format!("{} of {law:?} at {jump:?}", law.parameters()[k].name),
                    );
                }
            }
        }
    }
}

#[test]
fn every_cohesive_secant_gives_back_the_traction_and_no_jump_gives_none() {
    for law in cohesive_laws() {
        assert_eq!(law.response(Jump::default()).traction, Traction::default());
        for jump in JUMPS {
            let (secant, traction) = (law.secant(jump), both(law.response(jump).traction));
            for row in 0..2 {
                let found = secant * jump.vector();
                assert_close(found[row], traction[row], 1e-13 * traction[row].abs(), format!("{law:?} at {jump:?}"));
            }
        }
    }
}

#[test]
fn the_peaks_and_works_of_separation_are_those_asked_for() {
    for law in cohesive_laws() {
        // Trapezoids over a pure opening and a pure sliding.
        let (steps, end) = (400_000, [0.2, 0.6]);
        let mut work = [0.0; 2];
        let mut peak = [0.0_f64; 2];
        for mode in 0..2 {
            let h = end[mode] / f64::from(steps);
            for k in 0..=steps {
                let x = h * f64::from(k);
                let jump = [Jump { normal: x, tangential: 0.0 }, Jump { normal: 0.0, tangential: x }][mode];
                let traction = both(law.response(jump).traction)[mode];
                work[mode] += if k == 0 || k == steps { 0.5 } else { 1.0 } * h * traction;
                peak[mode] = peak[mode].max(traction);
            }
        }
        let values = law.values();
        let wanted = match law.name() {
            ParkPaulinoRoesler::NAME => [values[0], values[1]],
            SmithFerrante::NAME => [values[0]; 2],
            ExponentialDamage::NAME => [values[0], values[0] / 0.09],
            name if name.starts_with("bilinear") || name.starts_with("trapezoidal") => [values[3], values[4]],
            _ => [values[0], values[0] * values[3]],
        };
        // The rounded corner of the bilinear law lowers its peak by ROUNDING lambda_0/lambda_f < 2 %; a plateau keeps
        // it.
        let plateau = law.name().starts_with("trapezoidal") && values[6] > 0.1;
        let below = if values.len() > 5 && values[0] > 1e4 && !plateau { 0.02 } else { 1e-6 };
        for mode in 0..2 {
            assert_close(work[mode], wanted[mode], 1e-6 * wanted[mode], format!("work, mode {mode}, {law:?}"));
            let top = both(law.peak())[mode];
            assert!(
                peak[mode] <= top * (1.0 + 1e-9) && peak[mode] >= (1.0 - below) * top,
                "peak {} of {top}",
                peak[mode]
            );
        }
    }
}

/// Straight pieces written down once more, plainly: K up to the onset of Camanho and Davila, a plateau over the share s
/// of what follows, and a fall to the end at which the area is the toughness of the mix.
#[test]
fn bilinear_and_trapezoidal_tractions_are_straight_lines_between_their_corners() {
    let values = [4e5, 60.0, 90.0, 0.4, 1.1, 1.7];
    let [k, t_n0, t_t0, g_ic, g_iic, eta] = values;
    for (criterion, s) in [
        (MixedModeCriterion::BenzeggaghKenane, 0.0),
        (MixedModeCriterion::Power, 0.0),
        (MixedModeCriterion::BenzeggaghKenane, 0.4),
        (MixedModeCriterion::Power, 0.7),
    ] {
        let with_plateau: [f64; 7] = std::array::from_fn(|j| values.get(j).copied().unwrap_or(s));
        let mut laws: Vec<Box<dyn CohesiveLaw>> = vec![Box::new(Trapezoidal::new(criterion, with_plateau).unwrap())];
        if s == 0.0 {
            laws.push(Box::new(Bilinear::new(criterion, values).unwrap()));
        }
        for (law, angle) in laws.iter().flat_map(|law| [0.0, 0.3, 0.8, 1.2].map(|angle: f64| (law, angle))) {
            let (c, d) = (angle.cos(), angle.sin());
            let strength = 1.0 / ((c / t_n0).powi(2) + (d / t_t0).powi(2)).sqrt();
            let mix = d * d;
            let toughness = match criterion {
                MixedModeCriterion::BenzeggaghKenane => g_ic + (g_iic - g_ic) * mix.powf(eta),
                MixedModeCriterion::Power => {
                    (((1.0 - mix) / g_ic).powf(eta) + (mix / g_iic).powf(eta)).powf(-1.0 / eta)
                }
            };
            let onset = strength / k;
            // Area of rise, plateau and fall: strength/2 (onset + (end - onset)(2 s + 1 - s)) = toughness.
            let end = onset + (2.0 * toughness / strength - onset) / (1.0 + s);
            let plateau = onset + s * (end - onset);
            let fall = strength / (end - plateau);
            let width_end = 0.1 * onset * (k / fall + 1.0).sqrt();
            for step in 1..400 {
                let length = 1.3 * end * f64::from(step) / 400.0;
                let corners = [(onset, 0.1 * onset), (plateau, 0.1 * onset), (end, width_end)];
                if corners.iter().any(|(at, width)| (length - at).abs() < 1.01 * width) {
                    continue;
                }
                let wanted = match length {
                    _ if length < onset => k * length,
                    _ if length < plateau => strength,
                    _ if length < end => strength - fall * (length - plateau),
                    _ => 0.0,
                };
                let found = law.response(Jump { normal: c * length, tangential: d * length }).traction;
                // Differences of numbers as large as the elastic traction.
                let tolerance = 1e-13 * k * length;
                let what = format!("{} at {angle}, {length} of {end} mm", law.name());
                assert_close(found.normal, c * wanted, tolerance, &what);
                assert_close(found.tangential, d * wanted, tolerance, &what);
            }
        }
    }
}

/// A law from a potential has a symmetric tangent, and its work does not depend on the path.
#[test]
fn laws_with_a_potential_do_the_same_work_on_every_path() {
    let laws: [Box<dyn CohesiveLaw>; 4] = [
        Box::new(XuNeedleman::new(1.0, 0.005, 0.02, 0.7, 0.2).unwrap()),
        Box::new(ParkPaulinoRoesler::new([0.4, 1.1, 60.0, 90.0, 3.0, 2.4, 0.02, 0.05]).unwrap()),
        Box::new(ParkPaulinoRoesler::new([1.1, 0.4, 60.0, 30.0, 2.1, 5.0, 0.1, 0.01]).unwrap()),
        Box::new(SmithFerrante::new([0.8, 0.004, 0.3]).unwrap()),
    ];
    for law in laws {
        // Up to jumps at which no mode has stopped to resist.
        let goal = [0.2 * law.front_opening().min(0.02), 0.002];
        let along = |path: &dyn Fn(f64) -> [f64; 2]| {
            let n = 200_000;
            let mut work = 0.0;
            for k in 0..n {
                let [a, b] = [k, k + 1].map(|k| path(f64::from(k) / f64::from(n)));
                let middle = Jump { normal: 0.5 * (a[0] + b[0]), tangential: 0.5 * (a[1] + b[1]) };
                let traction = law.response(middle).traction;
                work += traction.normal * (b[0] - a[0]) + traction.tangential * (b[1] - a[1]);
            }
            work
        };
        let straight = along(&|s| goal.map(|end| s * end));
        let opening_first = along(&|s| [goal[0] * (2.0 * s).min(1.0), goal[1] * (2.0 * s - 1.0).max(0.0)]);
        let sliding_first = along(&|s| [goal[0] * (2.0 * s - 1.0).max(0.0), goal[1] * (2.0 * s).min(1.0)]);
        // The midpoint rule over 200 000 steps leaves 1e-9 of the work.
        assert_close(opening_first, straight, 1e-7 * straight, format!("opening first, {law:?}"));
        assert_close(sliding_first, straight, 1e-7 * straight, format!("sliding first, {law:?}"));
    }
}

#[test]
fn the_tangent_of_a_law_with_corners_is_continuous_along_a_path_of_constant_mix() {
    for law in cohesive_laws().iter().filter(|law| law.values()[0] > 1e4) {
        for angle in [0.0_f64, 0.4, 1.0, 1.5] {
            let at = |x: f64| law.response(Jump { normal: x * angle.cos(), tangential: x * angle.sin() }).tangent;
            let h = 1e-7;
            let mut before = at(h);
            for k in 2..400_000 {
                let x = h * f64::from(k);
                let now = at(x);
                for (now, before) in now.iter().zip(before.iter()) {
                    // The rounding spreads a change of the slope by K + falling over 2 ROUNDING lambda_0 > 2e-5 mm.
                    assert!((now - before).abs() < 5e5 * 4.0 * h / 2e-5, "at {x}: {before} to {now}");
                }
                before = now;
            }
        }
    }
}

#[test]
fn four_points_at_once_have_the_bits_of_one_after_the_other() {
    for law in substrate_laws() {
        // Elastic, plastic, at rest and far off beside one another: each ends after another number of iterations.
        for strains in STRAINS.windows(2) {
            let four = [strains[0], [0.0; 3], strains[1].map(|e| 40.0 * e), strains[1]].map(engineering);
            let together = law.responses(&four);
            for (strain, together) in four.into_iter().zip(together) {
                assert_eq!(together, law.response(strain), "{law:?} at {strain:?}");
            }
        }
    }
}

#[test]
fn every_substrate_tangent_is_symmetric_positive_definite_and_the_difference_of_its_stress() {
    for law in substrate_laws() {
        assert_eq!(law.stress(EngineeringStrain::default()), Stress::default());
        for strain in STRAINS {
            let tangent = law.response(engineering(strain)).tangent;
            let secant = law.secant(engineering(strain));
            let stress = law.stress(engineering(strain)).0;
            let scale = strain.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for row in 0..3 {
                let again: f64 = (0..3).map(|k| secant[(row, k)] * strain[k]).sum();
                assert_close(again, stress[row], 1e-12 * law.young() * scale, format!("secant of {law:?}"));
                for k in 0..3 {
                    let at = |x: f64| {
                        let mut strain = strain;
                        strain[k] = x;
                        law.stress(engineering(strain)).0[row]
                    };
                    let wanted = five_points(at, strain[k], 1e-4 * scale);
                    let what = format!("tangent [{row}][{k}] at {strain:?} of {law:?}");
                    assert_close(tangent[(row, k)], wanted, 1e-8 * law.young(), &what);
                    assert_close(tangent[(row, k)], tangent[(k, row)], 1e-13 * law.young(), what);
                }
            }
            for matrix in [tangent, secant] {
                let minor = matrix.fixed_view::<2, 2>(0, 0).determinant();
                assert!(matrix.m11 > 0.0 && minor > 0.0 && matrix.determinant() > 0.0, "{matrix:?} of {law:?}");
            }
        }
    }
}

#[test]
fn every_parameter_derivative_of_a_substrate_law_is_the_difference_of_its_stress() {
    for law in substrate_laws() {
        let values = law.values();
        for strain in STRAINS {
            let mut by = vec![Stress::default(); values.len()];
            law.by_parameters(engineering(strain), &mut by);
            for (k, &value) in values.iter().enumerate() {
                for row in 0..3 {
                    let at = |x: f64| {
                        let mut values = values.clone();
                        values[k] = x;
                        law.with_values(&values).unwrap().stress(engineering(strain)).0[row]
                    };
                    let wanted = five_points(at, value, 1e-4 * value);
                    let stress = law.stress(engineering(strain)).0.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                    let tolerance = 1e-8 * wanted.abs() + 1e-10 * stress / value;
                    let what = format!("{} [{row}] at {strain:?} of {law:?}", law.parameters()[k].name);
                    assert_close(by[k].0[row], wanted, tolerance, what);
                }
            }
        }
    }
}

#[test]
fn plane_strain_is_what_a_stress_out_of_the_plane_holds() {
    // Uniaxial strain: q = |sx - sz| with sz from the other direction, sy = sz by symmetry.
    let law = RambergOsgood::new([72000.0, 0.33, 180.0, 0.06, 7.0], PlaneState::PlaneStrain).unwrap();
    let Stress([x, y, shear]) = law.stress(engineering([0.01, 0.0, 0.0]));
    let state = law.state(engineering([0.01, 0.0, 0.0]));
    assert_eq!(shear, 0.0);
    assert_close(state.equivalent_stress, x - y, 1e-10 * x, "equivalent stress");
    let bulk = 72000.0 / (3.0 * (1.0 - 2.0 * 0.33));
    assert_close((x + 2.0 * y) / 3.0, bulk * 0.01, 1e-10 * x, "mean stress");
}

#[test]
fn in_uniaxial_tension_the_plastic_strain_at_the_yield_stress_is_alpha_times_the_elastic() {
    let law = RambergOsgood::new([72000.0, 0.33, 180.0, 0.06, 7.0], PlaneState::PlaneStress).unwrap();
    let elastic = 180.0 / 72000.0;
    let plastic = 0.06 * elastic;
    let strain = [elastic + plastic, -0.33 * elastic - 0.5 * plastic, 0.0];
    let Stress([x, y, _]) = law.stress(engineering(strain));
    assert_close(x, 180.0, 1e-11, "stress");
    assert_close(y, 0.0, 1e-11, "stress across");
    assert_close(law.state(engineering(strain)).plastic_strain, plastic, 1e-13, "plastic strain");
}

#[test]
fn parameters_out_of_their_range_are_refused_by_name() {
    let refused = |name: &str, values: &[f64]| match law_by_name(name, values).unwrap_err() {
        LawError::Parameter { key, .. } => key,
        other => panic!("{other}"),
    };
    assert_eq!(refused("extended-xu-needleman", &[0.0, 0.005, 0.05, 4.0]), "phi_n_N_per_mm");
    assert_eq!(refused("extended-xu-needleman", &[1.0, f64::NAN, 0.05, 4.0]), "delta_n_mm");
    assert_eq!(refused("extended-xu-needleman", &[1.0, 0.005, -0.05, 4.0]), "delta_t_mm");
    assert_eq!(refused("extended-xu-needleman", &[1.0, 0.005, 0.05, f64::INFINITY]), "r");
    assert_eq!(refused("xu-needleman", &[1.0, 0.005, 0.05, 0.5, 1.0]), "r_star");
    assert_eq!(refused("xu-needleman", &[1.0, 0.005, 0.05, 0.5, -0.1]), "r_star");
    assert_eq!(refused("bilinear-power", &[4e5, 60.0, 90.0, 0.4, 1.1, 0.5]), "eta");
    assert_eq!(refused("bilinear-benzeggagh-kenane", &[4e3, 60.0, 90.0, 0.4, 1.1, 1.5]), "G_Ic_N_per_mm");
    let with = |s: f64| vec![4e5, 60.0, 90.0, 0.4, 1.1, 1.5, s];
    assert_eq!(refused("trapezoidal-power", &with(1.0)), "plateau");
    assert_eq!(refused("trapezoidal-power", &with(-0.1)), "plateau");
    // A plateau so long that it falls at once.
    assert_eq!(refused("trapezoidal-benzeggagh-kenane", &with(0.999)), "K_MPa_per_mm");
    assert_eq!(refused("smith-ferrante", &[0.8, 0.0, 0.3]), "delta_c_mm");
    let ppr = |k: usize, value: f64| {
        let mut values = [0.4, 1.1, 60.0, 90.0, 3.0, 2.4, 0.02, 0.05];
        values[k] = value;
        refused("park-paulino-roesler", &values)
    };
    assert_eq!((ppr(4, 1.9), ppr(5, 1.0)), ("alpha".to_owned(), "beta".to_owned()));
    assert_eq!((ppr(6, 0.6), ppr(7, 0.7)), ("lambda_n".to_owned(), "lambda_t".to_owned()));
    assert!(matches!(law_by_name("glue", &[]), Err(LawError::Unknown { .. })));
    assert!(matches!(parameters_by_name("glue"), Err(LawError::Unknown { .. })));
    for name in LAW_NAMES {
        let needed = parameters_by_name(name).unwrap().len();
        assert!(
            matches!(law_by_name(name, &[1.0; 2]), Err(LawError::Count { needed: n, given: 2, .. }) if n == needed)
        );
    }
    let refused = |values: &[f64]| match substrate_by_name("ramberg-osgood", values, PlaneState::PlaneStress) {
        Err(SubstrateError::Parameter { key, .. }) => key,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&[-1.0, 0.33, 180.0, 0.06, 7.0]), "E_MPa");
    assert_eq!(refused(&[72e3, 0.5, 180.0, 0.06, 7.0]), "nu");
    assert_eq!(refused(&[72e3, f64::NAN, 180.0, 0.06, 7.0]), "nu");
    assert_eq!(refused(&[72e3, 0.33, 0.0, 0.06, 7.0]), "sigma_0_MPa");
    assert_eq!(refused(&[72e3, 0.33, 180.0, 0.0, 7.0]), "alpha");
    assert_eq!(refused(&[72e3, 0.33, 180.0, 0.06, 0.5]), "n");
    for name in SUBSTRATE_NAMES {
        let needed = substrate_parameters(name, PlaneState::PlaneStress).unwrap().len();
        let error = substrate_by_name(name, &[1.0; 1], PlaneState::PlaneStress).unwrap_err();
        assert!(matches!(error, SubstrateError::Count { needed: n, given: 1, .. } if n == needed));
    }
    assert!(matches!(substrate_parameters("wood", PlaneState::PlaneStress), Err(SubstrateError::Unknown { .. })));
    assert!(substrate_by_name("wood", &[], PlaneState::PlaneStress).is_err());
}
