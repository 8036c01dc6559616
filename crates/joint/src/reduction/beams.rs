//! The relations of beam theory that standards reduce a test with (THEORY 23): ISO 25217, ISO 15114, ASTM D5528, D6671.
//!
//! Lengths in mm, forces in N, moduli in MPa, energy release rates in N/mm.

/// Width and thickness of an arm, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Section {
    pub(super) width: f64,
    pub(super) arm: f64,
}

/// Modulus along the arm and shear modulus, MPa; without the latter beams do not shear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moduli {
    pub(super) young: f64,
    pub(super) shear: Option<f64>,
}

impl Moduli {
    fn inverse_shear(self) -> f64 {
        self.shear.map_or(0.0, |shear| 1.0 / shear)
    }
}

/// An end block: from its pin to the middle of the arm, and half of its length, mm. Zeros: pins without blocks.
pub(super) type Block = [f64; 2];

/// F of ISO 25217: what large displacements take off.
pub(super) fn large(displacement: f64, crack: f64, [pin, _]: Block) -> f64 {
    1.0 - 0.3 * (displacement / crack).powi(2) - 1.5 * displacement * pin / crack.powi(2)
}

/// N of ISO 25217: what is left of the compliance with end blocks.
pub(super) fn stiffened(displacement: f64, crack: f64, [pin, half]: Block) -> f64 {
    if [pin, half] == [0.0; 2] {
        return 1.0;
    }
    let (turned, share) = (displacement / crack, half / crack);
    1.0 - share.powi(3) - 1.125 * (1.0 - share.powi(2)) * turned * pin / crack - 9.0 / 35.0 * turned.powi(2)
}

/// Corrected beam theory, mode I: `3 P delta / (2 b (a + Delta)) F/N`; a correction that shortens the crack is none.
pub(super) fn corrected_beam([load, u, crack, correction]: [f64; 4], width: f64, block: Block) -> f64 {
    3.0 * load * u / (2.0 * width * (crack + correction.max(0.0))) * large(u, crack, block) / stiffened(u, crack, block)
}

/// Experimental compliance, `C/N ~ a^n`: `n P delta / (2 b a) F/N`.
pub(super) fn experimental([load, u, crack, power]: [f64; 4], width: f64, block: Block) -> f64 {
    power * load * u / (2.0 * width * crack) * large(u, crack, block) / stiffened(u, crack, block)
}

/// Double cantilever beam: compliance `8 a^3/(E b h^3) + 12 a/(5 b h G)`, mm/N.
pub(super) fn dcb_compliance(crack: f64, Section { width, arm }: Section, moduli: Moduli) -> f64 {
    8.0 * crack.powi(3) / (moduli.young * width * arm.powi(3)) + 2.4 * crack / (width * arm) * moduli.inverse_shear()
}

/// Double cantilever beam: `6 P^2/(b^2 h) (2 a^2/(h^2 E) + 1/(5 G))`.
pub(super) fn dcb_release(load: f64, crack: f64, Section { width, arm }: Section, moduli: Moduli) -> f64 {
    let bending = 2.0 * (crack / arm).powi(2) / moduli.young;
    6.0 * (load / width).powi(2) / arm * (bending + 0.2 * moduli.inverse_shear())
}

/// What a double cantilever beam is longer by, since its arms turn at the tip, mm: ISO 15024 for a beam whose modulus
/// across is that along.
pub(super) fn root_correction(arm: f64, moduli: Moduli) -> f64 {
    let Some(shear) = moduli.shear else { return 0.0 };
    let gamma = 1.18 * moduli.young / shear;
    arm * (moduli.young / (11.0 * shear) * (3.0 - 2.0 * (gamma / (1.0 + gamma)).powi(2))).sqrt()
}

/// End-notched flexure, half span `half`: compliance `(3 a^3 + 2 L^3)/(8 E b h^3) + 3 L/(10 G b h)`, mm/N.
pub(super) fn enf_compliance(crack: f64, half: f64, Section { width, arm }: Section, moduli: Moduli) -> f64 {
    (3.0 * crack.powi(3) + 2.0 * half.powi(3)) / (8.0 * moduli.young * width * arm.powi(3))
        + 0.3 * half / (width * arm) * moduli.inverse_shear()
}

/// End-notched flexure: `9 P^2 a^2/(16 b^2 E h^3)`.
pub(super) fn enf_release(load: f64, crack: f64, Section { width, arm }: Section, young: f64) -> f64 {
    9.0 * (load * crack / width).powi(2) / (16.0 * young * arm.powi(3))
}

/// Mixed-mode bending (ASTM D6671) with half span `half` and lever `lever`: the parts of opening and of sliding;
/// `chi_h` is what the crack is longer by in opening.
pub(super) fn mmb_release(
    load: f64,
    crack: f64,
    [half, lever]: [f64; 2],
    Section { width, arm }: Section,
    young: f64,
    chi_h: f64,
) -> [f64; 2] {
    let below = 16.0 * width * width * arm.powi(3) * half * half * young;
    let part =
        |factor: f64, levers: f64, longer: f64| factor * (load * levers).powi(2) / below * (crack + longer).powi(2);
    [part(12.0, 3.0 * lever - half, chi_h), part(9.0, lever + half, 0.42 * chi_h)]
}

/// Mixed-mode bending (ASTM D6671): displacement of the load on the lever by its force, mm/N.
pub(super) fn mmb_compliance(
    crack: f64,
    [half, lever]: [f64; 2],
    Section { width, arm }: Section,
    young: f64,
    chi_h: f64,
) -> f64 {
    let opening = 8.0 * (crack + chi_h).powi(3) * (3.0 * lever - half).powi(2);
    let sliding = (6.0 * (crack + 0.42 * chi_h).powi(3) + 4.0 * half.powi(3)) * (lever + half).powi(2);
    (opening + sliding) / (16.0 * half * half * width * arm.powi(3) * young)
}

/// The crack of a beam whose compliance `of` grows with it; `None` where none in 0 to `most` has this `compliance`.
pub(super) fn equivalent_crack(compliance: f64, most: f64, of: impl Fn(f64) -> f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, most);
    if !(of(low) <= compliance && compliance <= of(high)) {
        return None;
    }
    // Halved to round-off: each relation grows.
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        *(if of(middle) < compliance { &mut low } else { &mut high }) = middle;
    }
    Some(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECTION: Section = Section { width: 25.0, arm: 3.0 };
    const STEEL: Moduli = Moduli { young: 210_000.0, shear: Some(80_000.0) };

    /// `dC/da` by differences of five points: their error is below 1e-9 of the slope here.
    fn slope(of: impl Fn(f64) -> f64, at: f64) -> f64 {
        let h = 1e-2 * at;
        (8.0 * (of(at + h) - of(at - h)) - (of(at + 2.0 * h) - of(at - 2.0 * h))) / (12.0 * h)
    }

    /// `P^2/(2 b) dC/da`: what every relation of a beam has to be.
    fn irwin(load: f64, slope: f64) -> f64 {
        load * load / (2.0 * SECTION.width) * slope
    }

    #[test]
    fn release_rates_are_those_of_the_compliance() {
        let (load, crack) = (120.0, 55.0);
        for moduli in [STEEL, Moduli { shear: None, ..STEEL }] {
            let of = irwin(load, slope(|a| dcb_compliance(a, SECTION, moduli), crack));
            assert!((dcb_release(load, crack, SECTION, moduli) / of - 1.0).abs() < 1e-8);
            let of = irwin(load, slope(|a| enf_compliance(a, 80.0, SECTION, moduli), crack));
            assert!((enf_release(load, crack, SECTION, STEEL.young) / of - 1.0).abs() < 1e-8);
        }
        // Both parts together, the crack as long in opening as in sliding.
        let [opening, sliding] = mmb_release(load, crack, [60.0, 40.0], SECTION, 70_000.0, 0.0);
        let of = irwin(load, slope(|a| mmb_compliance(a, [60.0, 40.0], SECTION, 70_000.0, 0.0), crack));
        assert!(((opening + sliding) / of - 1.0).abs() < 1e-8, "{opening} + {sliding} for {of}");
    }

    #[test]
    fn methods_of_one_beam_agree() {
        // Without shear and correction, and far from large displacements.
        let (load, crack) = (20.0, 60.0);
        let moduli = Moduli { shear: None, ..STEEL };
        let displacement = load * dcb_compliance(crack, SECTION, moduli);
        let exact = dcb_release(load, crack, SECTION, moduli);
        let exact = exact * (1.0 - 0.3 * (displacement / crack).powi(2));
        let of = |last: f64| [load, displacement, crack, last];
        assert!((corrected_beam(of(0.0), 25.0, [0.0; 2]) / exact - 1.0).abs() < 1e-12);
        assert!((experimental(of(3.0), 25.0, [0.0; 2]) / exact - 1.0).abs() < 1e-12);
    }

    #[test]
    fn end_blocks_change_the_compliance_and_not_the_release_rate() {
        // Rigid up to 12 mm, the pin in the middle of the arm, displacements that are small: C = 8 (a^3 - l^3)/(E b h^3).
        let (load, crack, block) = (1e-3, 60.0, [0.0, 12.0]);
        let moduli = Moduli { shear: None, ..STEEL };
        let displacement = load * (dcb_compliance(crack, SECTION, moduli) - dcb_compliance(12.0, SECTION, moduli));
        let exact = dcb_release(load, crack, SECTION, moduli);
        let found = corrected_beam([load, displacement, crack, 0.0], 25.0, block);
        assert!((found / exact - 1.0).abs() < 1e-9, "{found} for {exact}");
        // ISO 25217, by hand: u = 6, a = 60, l_1 = 10, l_2 = 12.
        assert!((large(6.0, 60.0, [10.0, 12.0]) - (1.0 - 0.003 - 0.025)).abs() < 1e-12);
        let n = 1.0 - 0.008 - 1.125 * 0.96 * 60.0 / 3600.0 - 9.0 / 35.0 * 0.01;
        assert!((stiffened(6.0, 60.0, [10.0, 12.0]) - n).abs() < 1e-12);
    }

    #[test]
    fn an_equivalent_crack_is_the_crack_of_its_compliance() {
        for crack in [1e-3, 7.0, 55.0, 400.0] {
            let found =
                equivalent_crack(dcb_compliance(crack, SECTION, STEEL), 1e3, |a| dcb_compliance(a, SECTION, STEEL));
            assert!((found.unwrap() / crack - 1.0).abs() < 1e-12);
        }
        let of = |a| enf_compliance(a, 80.0, SECTION, STEEL);
        assert_eq!(equivalent_crack(0.5 * of(0.0), 1e3, of), None, "stiffer than without crack");
        assert!((equivalent_crack(of(33.0), 1e3, of).unwrap() - 33.0).abs() < 1e-9);
    }

    #[test]
    fn the_arms_of_a_beam_that_shears_turn_at_the_tip() {
        // For an isotropic beam, nu = 0.3: chi = sqrt(2.6/11 (3 - 2 (3.068/4.068)^2)) = 0.66348, by hand.
        let moduli = Moduli { young: 1.0, shear: Some(1.0 / 2.6) };
        assert!((root_correction(2.0, moduli) / 2.0 - 0.663_48).abs() < 1e-5, "{}", root_correction(2.0, moduli));
        assert_eq!(root_correction(2.0, Moduli { shear: None, ..moduli }), 0.0);
    }
}
