//! The mechanics and the identification of a run.

pub(crate) mod case;
pub(crate) mod identification;
pub(crate) mod photograph;
mod reduction;
pub(crate) mod several;
pub(crate) mod simulation;
mod strips;
pub(crate) mod tournament;
pub(crate) mod virtual_joint;

pub use case::{CaseRun, run_case};
pub use identification::identify;
pub(crate) use identification::{FIT, JOINT_SENSITIVITIES, LAW_SENSITIVITIES, outcome_of};
pub use reduction::reduce;
pub(crate) use reduction::{check_reduction, reduce_run};
pub use several::identify_several;
pub use simulation::simulate;
pub(crate) use simulation::write_solution;
pub use tournament::compare_laws;
pub use virtual_joint::{virtual_test, write_virtual_test};
