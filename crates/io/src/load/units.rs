//! Units as machines write them, and those that the program counts in.

/// Units with what they are in N, mm, s and MPa: the name, its factor, and whether it is understood at the end of a
/// name (`load_kN`), where a word such as `min` or `in` may be no unit.
const KNOWN: [(&str, &str, f64, bool); 37] = [
    ("N", "N", 1.0, true),
    ("kN", "N", 1e3, true),
    ("KN", "N", 1e3, true),
    ("MN", "N", 1e6, true),
    ("mN", "N", 1e-3, false),
    ("daN", "N", 10.0, true),
    ("kgf", "N", 9.806_65, true),
    ("kp", "N", 9.806_65, false),
    ("lbf", "N", 4.448_221_615_260_5, true),
    ("mm", "mm", 1.0, true),
    ("m", "mm", 1e3, false),
    ("cm", "mm", 10.0, true),
    ("um", "mm", 1e-3, true),
    ("\u{b5}m", "mm", 1e-3, true),
    ("\u{3bc}m", "mm", 1e-3, true),
    ("in", "mm", 25.4, false),
    ("inch", "mm", 25.4, false),
    ("s", "s", 1.0, true),
    ("sec", "s", 1.0, false),
    ("Sec", "s", 1.0, false),
    ("seconds", "s", 1.0, false),
    ("ms", "s", 1e-3, true),
    ("us", "s", 1e-6, false),
    ("\u{b5}s", "s", 1e-6, true),
    ("\u{3bc}s", "s", 1e-6, true),
    ("min", "s", 60.0, false),
    ("h", "s", 3600.0, false),
    ("MPa", "MPa", 1.0, true),
    ("Pa", "MPa", 1e-6, false),
    ("kPa", "MPa", 1e-3, true),
    ("GPa", "MPa", 1e3, true),
    ("bar", "MPa", 0.1, false),
    ("psi", "MPa", 6.894_757_293_168e-3, false),
    ("ksi", "MPa", 6.894_757_293_168, true),
    ("N/mm2", "MPa", 1.0, true),
    ("N/mm\u{b2}", "MPa", 1.0, true),
    ("N/mm^2", "MPa", 1.0, true),
];

/// A column's name with its unit, as it stands in tables.
pub(super) struct Named {
    /// The name without unit.
    pub base: String,
    /// The unit that the program counts in; none where the file says none.
    pub unit: Option<String>,
    /// What its numbers are multiplied by.
    pub factor: f64,
    /// The unit of the file.
    pub given: String,
}

impl Named {
    /// From a cell of the header and, where there is one, the cell with its unit below.
    pub fn new(header: &str, below: Option<&str>) -> Self {
        let (base, unit, is_explicit) = match (split_unit(header), below.map(bare).filter(|unit| !unit.is_empty())) {
            (_, Some(unit)) => (split_unit(header).map_or(header, |(base, _)| base).to_owned(), Some(unit), true),
            (Some((base, unit)), None) => (base.to_owned(), Some(unit), true),
            (None, None) => match header.rsplit_once('_').filter(|(base, unit)| !base.is_empty() && !unit.is_empty()) {
                Some((base, unit)) => (base.to_owned(), Some(unit), false),
                None => (header.to_owned(), below.map(|_| "1"), true),
            },
        };
        let base = base.trim().replace([' ', '\t'], "_");
        let given = unit.unwrap_or_default().to_owned();
        let known = KNOWN.iter().find(|(name, .., at_end)| *name == given && (is_explicit || *at_end));
        let factor = known.map_or(1.0, |known| known.2);
        let unit = unit.map(|unit| match known {
            Some((_, to, ..)) => (*to).to_owned(),
            None if ["-", ""].contains(&unit) => "1".to_owned(),
            None => unit.replace([' ', '\t'], "_"),
        });
        Self { base, unit, factor, given }
    }

    /// Name and unit: `load_N`.
    pub fn name(&self) -> String {
        match &self.unit {
            Some(unit) => format!("{}_{unit}", self.base),
            None => self.base.clone(),
        }
    }
}

/// The unit of this name: what the program counts in, and its factor.
pub(crate) fn unit_of(name: &str) -> Option<(&'static str, f64)> {
    KNOWN.iter().find(|(known, ..)| *known == name).map(|(_, ours, factor, _)| (*ours, *factor))
}

/// Whether a cell holds a unit that is known.
pub(super) fn is_unit(cell: &str) -> bool {
    KNOWN.iter().any(|(name, ..)| *name == bare(cell))
}

/// `load [N]` or `load (N)` as name and unit.
fn split_unit(cell: &str) -> Option<(&str, &str)> {
    [('[', ']'), ('(', ')')].into_iter().find_map(|(open, close)| {
        let (name, unit) = cell.strip_suffix(close)?.rsplit_once(open)?;
        Some((name.trim(), unit.trim()))
    })
}

/// A unit without brackets around it.
fn bare(cell: &str) -> &str {
    let cell = cell.trim();
    let within =
        [('[', ']'), ('(', ')')].into_iter().find_map(|(open, close)| cell.strip_prefix(open)?.strip_suffix(close));
    within.unwrap_or(cell).trim()
}
