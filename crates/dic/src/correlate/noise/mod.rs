//! Standard uncertainties: noise of the camera, its correlation, misfit and model error.

pub(crate) mod bend;
pub(crate) mod fixed_pattern;
pub(crate) mod interpolation_bias;
pub(crate) mod misfit;
pub(crate) mod model_error;
pub(crate) mod noise_correlation;
pub(crate) mod noise_model;
pub(crate) mod reference_noise;
pub(crate) mod stretch;
pub(crate) mod uncertainty;
