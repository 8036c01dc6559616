//! What the program cannot know of a test, for the reporting table.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What stands in the reporting table of `report.html` (after the good practice guide of the iDICs) and cannot be seen
/// on the images. What is left out stays blank there.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseReport {
    /// Camera: maker, type, sensor.
    pub camera: Option<String>,
    /// Lens: maker, type, focal length.
    pub lens: Option<String>,
    /// Aperture.
    pub aperture: Option<String>,
    /// Distance from lens to specimen.
    pub stand_off: Option<String>,
    /// Images per second.
    pub image_rate: Option<String>,
    /// Exposure time.
    pub exposure: Option<String>,
    /// Lighting.
    pub light: Option<String>,
    /// How the pattern was made, and the size of its features.
    pub pattern: Option<String>,
    /// The test: specimen, machine, speed.
    pub test: Option<String>,
}

impl CaseReport {
    /// Its entries with what they are called in the table.
    pub fn entries(&self) -> [(&'static str, Option<&str>); 9] {
        [
            ("test", self.test.as_deref()),
            ("camera", self.camera.as_deref()),
            ("lens", self.lens.as_deref()),
            ("aperture", self.aperture.as_deref()),
            ("stand-off distance", self.stand_off.as_deref()),
            ("image acquisition rate", self.image_rate.as_deref()),
            ("exposure time", self.exposure.as_deref()),
            ("lighting", self.light.as_deref()),
            ("patterning technique", self.pattern.as_deref()),
        ]
    }
}
