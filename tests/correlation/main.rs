//! Correlation: images, meshes, the engine on both devices, accuracy, noise, what is told of a frame.

#[path = "../common/mod.rs"]
mod common;
#[path = "../program/mod.rs"]
mod program;

mod accuracy;
mod cold_start;
mod crack;
mod crack_auto;
mod device_check;
mod engine;
mod gpu_frames;
mod gpu_kernels;
mod images;
mod interpolation_bias;
mod light;
mod linalg;
mod marks;
mod mesh_file;
mod misfit;
mod noise_model;
mod point_values;
mod quantities;
mod real_images;
mod reference_update;
mod regions;
mod regularisation;
mod shaders;
mod splines;
mod status;
mod strain;
mod strain_flattening;
mod strain_gauges;
mod strain_window;
mod stretch;
mod synth;
mod targets;
mod uncertainty;
mod which_reference;
mod zones;
