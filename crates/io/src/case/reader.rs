//! The sections of a case, and which commands take them.

/// Who takes which sections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reader {
    /// Commands that correlate, or draw from fields.
    Correlation,
    /// Commands that compute a joint, or find its parameters, from what was measured.
    Joint,
    /// From the images to the parameters.
    Run,
    /// The parameters of one law from several tests.
    Tests,
}

impl Reader {
    const ALL: [Self; 3] = [Self::Correlation, Self::Joint, Self::Run];

    /// Its commands.
    pub fn commands(self) -> &'static str {
        match self {
            Self::Correlation => "correlate, watch, slurm, probe, reduce",
            Self::Joint => "simulate, identify",
            Self::Run => "run",
            Self::Tests => "identify",
        }
    }

    /// Whether it takes `section`.
    pub fn takes(self, section: &str) -> bool {
        let of_correlation = || OF_CORRELATION.contains(&section) || section == RECORD;
        let of_joint = || OF_JOINT.contains(&section);
        match self {
            Self::Correlation => of_correlation(),
            Self::Joint => of_joint(),
            // The border of a run is measured.
            Self::Run => of_correlation() || section == INTERFACE || (of_joint() && !DRIVES.contains(&section)),
            Self::Tests => section == TESTS || OF_TESTS.contains(&section),
        }
    }

    /// The commands that take `section`.
    pub(super) fn of(section: &str) -> String {
        if section == TESTS {
            return Self::Tests.commands().to_owned();
        }
        let commands = Self::ALL.into_iter().filter(|reader| reader.takes(section)).map(Self::commands);
        commands.collect::<Vec<_>>().join(", ")
    }
}

const OF_CORRELATION: [&str; 15] = [
    "images",
    "camera",
    "correlation",
    "zone",
    "quantities",
    "load",
    "probe",
    "line",
    "extensometer",
    "region",
    "opening",
    "tension",
    "reduction",
    "crack",
    "report",
];
const INTERFACE: &str = "interface";
pub(super) const OF_JOINT: [&str; 12] = [
    "mesh",
    "groups",
    "boundary",
    "support",
    "applied_load",
    "path",
    "substrate",
    "cohesive",
    "output",
    "measurement",
    "force",
    "fit",
];
/// What drives a joint that no images tell of.
const DRIVES: [&str; 3] = ["support", "applied_load", "path"];
pub(super) const TESTS: &str = "test";
/// What a case of several tests has beside them.
const OF_TESTS: [&str; 3] = ["cohesive", "output", "fit"];
/// Of a finished run.
const RECORD: &str = "run";

/// Every section, as a run goes.
pub(super) fn sections() -> impl Iterator<Item = &'static str> {
    OF_CORRELATION.into_iter().chain([INTERFACE]).chain(OF_JOINT).chain([TESTS]).chain([RECORD])
}
