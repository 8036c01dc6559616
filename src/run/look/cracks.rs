//! Cracks of a series when it is done: into `summary.json` and `figures`.

use crate::io::quantities::CrackHistory;
use crate::report::summary::Summary;
use crate::report::{CrackSummary, crack_figures};
use crate::run::folder::{FIGURES, RunFolder};
use crate::run::words::{Result, RunError};
use std::fs;

/// Tells of `cracks` in the summary, and draws them.
pub(crate) fn tell(folder: &RunFolder, summary: &mut Summary, cracks: &[CrackHistory]) -> Result<()> {
    if cracks.is_empty() {
        return Ok(());
    }
    summary.cracks = cracks.iter().map(CrackSummary::of).collect();
    folder.write_summary(summary)?;
    let figures = folder.path().join(FIGURES);
    fs::create_dir_all(&figures).map_err(|error| RunError::file(&figures, "made", error))?;
    for (name, plot) in cracks.iter().flat_map(crack_figures) {
        let picture = plot.draw().map_err(|error| error.to_string())?;
        for ending in ["svg", "png"] {
            picture.save(figures.join(format!("{name}.{ending}"))).map_err(|error| error.to_string())?;
        }
    }
    Ok(())
}
