//! What stands for reading a correlation run in a build without its store.

use super::{JointFileError, JointRun};
use std::path::Path;

/// Refuses the run of the store `path`.
pub fn read_joint_run(path: &Path, _: Option<&[String; 2]>) -> Result<JointRun, JointFileError> {
    Err(JointFileError::file(path, "quadrille was built without the stores of correlation runs (its feature `store`)"))
}
